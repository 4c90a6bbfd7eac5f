"""Compares fitted planes with the true ones."""

import json
import math
import statistics

# Up to this angle a fitted plane is taken for the true plane of the same class.
MAX_MATCH_DEG = 20.0


def rotate(wxyz, v):
    """The vector turned by a unit quaternion."""
    w, q = wxyz[0], wxyz[1:]
    t = [2 * c for c in cross(q, v)]
    return [a + w * b + c for a, b, c in zip(v, t, cross(q, t))]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def angle_deg(a, b):
    """Between the lines along two vectors, 0 to 90."""
    dot = sum(x * y for x, y in zip(a, b)) / (math.hypot(*a) * math.hypot(*b))
    # From the half chord: an arc cosine has no digits left near zero.
    return math.degrees(2 * math.asin(min(1.0, math.sqrt(max(0.0, (1 - abs(dot)) / 2)))))


def read_planes(path, truth_from_estimate):
    """Planes of semantics.json or planes.json, their normals in the frame of the ground truth."""
    turn = truth_from_estimate["rotation_wxyz"]
    return [{"class": plane["class"], "size": num_points(plane),
             "normal": rotate(turn, plane["normal_in_world"])}
            for plane in json.loads(path.read_text())["planes"]]


def num_points(plane):
    """semantics.json lists the points of a plane, planes.json counts them."""
    return len(plane["inliers"]) if "inliers" in plane else plane["points"]


def compare(planes, truth):
    """How far fitted planes are from the true ones.

    `truth` has {name, class, normal, parallel}: planes with the same `parallel` are parallel in
    reality. For every true plane, the largest fitted plane of its class that is near it is judged.
    """
    matched = {}
    for true_plane in truth:
        near = [plane for plane in planes if plane["class"] == true_plane["class"] and
                angle_deg(plane["normal"], true_plane["normal"]) <= MAX_MATCH_DEG]
        if near:
            matched[true_plane["name"]] = max(near, key=lambda plane: plane["size"])
    errors = {p["name"]: angle_deg(matched[p["name"]]["normal"], p["normal"])
              for p in truth if p["name"] in matched}
    return {"due": len(truth), "normal_errors_deg": errors,
            "parallel_deg": parallel_angles(matched, truth)}


def parallel_angles(matched, truth):
    """Angles between the fitted planes of truly parallel ones, by the names of the two."""
    groups = {}
    for plane in truth:
        if plane.get("parallel") is not None and plane["name"] in matched:
            groups.setdefault(plane["parallel"], []).append(plane["name"])
    return {f"{a}, {b}": angle_deg(matched[a]["normal"], matched[b]["normal"])
            for group in groups.values() for i, a in enumerate(group) for b in group[i + 1:]}


def summarise(arms):
    """Medians over what all arms found, so that an arm gains nothing by finding less."""
    summaries = []
    for arm in arms:
        summary = {"due": arm.get("due"), "found": len(arm.get("normal_errors_deg", {}))}
        for key, name in (("normal_errors_deg", "normal_error_deg"),
                          ("parallel_deg", "parallel_off_deg")):
            common = set.intersection(*(set(a.get(key, {})) for a in arms))
            values = [arm[key][c] for c in common]
            summary[name] = statistics.median(values) if values else None
        summaries.append(summary)
    return summaries


def parallel_in_class(planes, name):
    """As compare() where no true plane is known: the planes of a class are parallel in reality.

    They have no names that hold across arms, so the one figure is their median angle.
    """
    normals = [plane["normal"] for plane in planes if plane["class"] == name]
    angles = [angle_deg(a, b) for i, a in enumerate(normals) for b in normals[i + 1:]]
    return {"parallel_deg": {name: statistics.median(angles)} if angles else {}}
