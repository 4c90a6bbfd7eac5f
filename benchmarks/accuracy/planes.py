"""Compares fitted planes with the true ones."""

import json
import math
import statistics

# Up to this angle a fitted plane may be the true plane of the same class.
MAX_MATCH_DEG = 20.0


def rotate(wxyz, v):
    """The vector turned by a unit quaternion."""
    w, q = wxyz[0], wxyz[1:]
    t = [2 * c for c in cross(q, v)]
    return [a + w * b + c for a, b, c in zip(v, t, cross(q, t))]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def angle_deg(a, b):
    """Between the lines along two vectors, 0 to 90."""
    cosine = dot(a, b) / (math.hypot(*a) * math.hypot(*b))
    # From the half chord: an arc cosine has no digits left near zero.
    return math.degrees(2 * math.asin(min(1.0, math.sqrt(max(0.0, (1 - abs(cosine)) / 2)))))


def true_plane(name, class_name, known, frame, parallel):
    """A plane of objects.json, in one of its frames ("gt", "sfm")."""
    centroid = known[f"centroid_{frame}"]
    return {"name": name, "class": class_name, "normal": known[f"plane_{frame}"]["n"],
            "centroid": centroid, "parallel": parallel,
            "radius": max(math.dist(centroid, corner) for corner in known[f"polygon_{frame}"])}


def read_planes(path, truth_from_estimate):
    """Planes of semantics.json or planes.json in the frame of the ground truth."""
    turn, scale = truth_from_estimate["rotation_wxyz"], truth_from_estimate["scale"]
    shift = truth_from_estimate["translation"]
    return [{"class": plane["class"],
             "normal": rotate(turn, plane["normal_in_world"]),
             "centroid": [scale * c + t for c, t in zip(rotate(turn, plane["centroid_in_world"]),
                                                        shift)],
             "axes": [rotate(turn, plane[f"axis_{axis}_in_world"]) for axis in "uv"],
             "extent": [[scale * c for c in corner] for corner in plane["extent_uv"]]}
            for plane in json.loads(path.read_text())["planes"]]


def distance(plane, point):
    """Of a point from what was seen of a plane: from the box around its outline."""
    offset = [a - b for a, b in zip(point, plane["centroid"])]
    parts = [dot(plane["normal"], offset)]
    for axis, along in zip(plane["axes"], zip(*plane["extent"])):
        place = dot(axis, offset)
        parts.append(max(min(along) - place, place - max(along), 0.0))
    return math.hypot(*parts)


def compare(planes, truth):
    """How far fitted planes are from the true ones.

    `truth` has {name, class, normal, centroid, radius, parallel}: planes with the same `parallel`
    are parallel in reality. Every true plane is judged by the fitted one of its class and about its
    direction that is nearest to its centroid, at most its radius away.
    """
    matched = {}
    for true_plane in truth:
        near = [(distance(plane, true_plane["centroid"]), index)
                for index, plane in enumerate(planes) if plane["class"] == true_plane["class"] and
                angle_deg(plane["normal"], true_plane["normal"]) <= MAX_MATCH_DEG]
        if near and min(near)[0] <= true_plane["radius"]:
            matched[true_plane["name"]] = planes[min(near)[1]]
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
