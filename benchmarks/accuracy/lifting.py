#!/usr/bin/env python3
"""Measures s3-lift on sequences with ground truth: class accuracy, instances, planes.

The truth files only judge; they are never an input of s3-lift. Needs numpy and Pillow.

  lifting.py --data DIR --bin DIR --output DIR [--parts redkitchen kitti07 synthetic cameras colmap]
             [--redkitchen-models DIR...] [--kitti-models DIR...] [--lift-seeds N...]
"""
import argparse
import itertools
import json
import pathlib
import shutil
import struct
import subprocess
import sys
import time

import numpy as np
from PIL import Image

import identity
import stages

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
MIN_OBSERVATIONS = 3  # Of a point, to be judged.
MIN_OBJECT_POINTS = 50  # On a plane, to be judged.
MAX_OFF_PLANE = 0.02  # Of a point that is on a true plane: of its distance from the nearest camera.
CAMERA_HEIGHT_M = 1.655  # Of kitti07, by its README.


# ---- reading -------------------------------------------------------------------------------------


def read_model(directory):
    """Images {id: (name, R, t, keypoints, point ids)} and points {id: xyz} of a binary model."""
    data = (directory / "images.bin").read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    offset, images = 8, {}
    for _ in range(count):
        image_id, qw, qx, qy, qz, tx, ty, tz, _ = struct.unpack_from("<I7dI", data, offset)
        offset += 64
        end = data.index(b"\0", offset)
        name = data[offset:end].decode()
        (num,) = struct.unpack_from("<Q", data, end + 1)
        offset = end + 9
        table = np.frombuffer(data, np.dtype([("xy", "<f8", 2), ("id", "<i8")]), num, offset)
        offset += 24 * num
        images[image_id] = (name, rotation(qw, qx, qy, qz), np.array([tx, ty, tz]),
                            table["xy"], table["id"])
    data = (directory / "points3D.bin").read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    offset, points = 8, {}
    for _ in range(count):
        point_id, x, y, z = struct.unpack_from("<Q3d", data, offset)
        (length,) = struct.unpack_from("<Q", data, offset + 43)
        offset += 51 + 8 * length
        points[point_id] = np.array([x, y, z])
    return images, points


def rotation(w, x, y, z):
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def read_tum(path):
    rows = [line.split() for line in path.read_text().splitlines() if line and line[0] != "#"]
    return np.array([[float(x) for x in row] for row in rows])


def align(to, source):
    """Scale, rotation and translation with to = s R source + t (Umeyama)."""
    mean_to, mean_source = to.mean(0), source.mean(0)
    u, singular, vt = np.linalg.svd((to - mean_to).T @ (source - mean_source) / len(to))
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = u @ sign @ vt
    scale = np.trace(np.diag(singular) @ sign) / ((source - mean_source) ** 2).sum(1).mean()
    return scale, turn, mean_to - scale * turn @ mean_source


def camera_centres(images, trajectory, rate_hz):
    """Centres in the model and in the trajectory, frame numbers being the digits of the names."""
    model, truth = [], []
    for name, turn, shift, _, _ in images.values():
        stamp = frame_number(name) / rate_hz if rate_hz else None
        row = np.argmin(abs(trajectory[:, 0] - stamp)) if rate_hz else frame_number(name)
        model.append(-turn.T @ shift)
        truth.append(trajectory[row, 1:4])
    return np.array(model), np.array(truth)


def frame_number(name):
    return int("".join(c for c in pathlib.Path(name).name.split(".")[0] if c.isdigit()))


# ---- truth ---------------------------------------------------------------------------------------


class Truth:
    """True class and object of every point, from the clean masks at the point's keypoints.

    `folder` is redkitchen or what s3-synth wrote; `world` says which of its planes are meant ("sfm"
    or "gt"), and `rate_hz` how frame numbers become times (None: they count the trajectory's lines).
    """

    def __init__(self, folder, images, points, world="sfm", trajectory="trajectory_colour_sfm.txt",
                 rate_hz=30.0, classes="coco.json"):
        self.world = world
        self.objects = {o["id"]: o for o in json.loads((folder / "objects.json").read_text())
                        ["objects"]}
        frames = json.loads((folder / "truth_clean.json").read_text())["frames"]
        table = json.loads((REPOSITORY / "configs" / "classes" / classes).read_text())
        self.things = {c["id"] for c in table["classes"] if c["thing"]}
        centres, truth = camera_centres(images, read_tum(folder / trajectory), rate_hz)
        self.centres = truth
        self.alignment = align(truth, centres)
        scale, turn, shift = self.alignment
        self.alignment_rms = np.sqrt(
            ((scale * centres @ turn.T + shift - truth) ** 2).sum(1).mean())
        self.xyz = {i: scale * turn @ x + shift for i, x in points.items()}
        masks = next(folder / name for name in ("panoptic_clean", "panoptic")
                     if (folder / name).is_dir())
        self._vote(masks, {frame_number(name): name for name in frames}, frames, images)

    def plane(self, object_id):
        """Normal and offset; None for an object that is not flat."""
        plane = self.objects.get(object_id, {}).get(f"plane_{self.world}")
        return (np.array(plane["n"]), plane["d"]) if plane else None

    def is_on_plane(self, object_id, point):
        """Whether the map has a point where the object's plane is; masks are wider than surfaces."""
        x = self.xyz[point]
        nearest = np.sqrt(((self.centres - x) ** 2).sum(1).min())
        return abs(self._distance(object_id, x)) <= MAX_OFF_PLANE * nearest

    def _vote(self, masks, mask_of_frame, frames, images):
        votes = {}
        for name, _, _, keypoints, ids in images.values():
            file = mask_of_frame[frame_number(name)]
            pixels = np.asarray(Image.open(masks / file)).astype(np.int64)
            segment_ids = pixels[..., 0] + 256 * pixels[..., 1] + 65536 * pixels[..., 2]
            height, width = segment_ids.shape
            for (x, y), point in zip(keypoints, ids):
                u, v = int(np.floor(x)), int(np.floor(y))
                if point < 0 or not (0 <= u < width and 0 <= v < height):
                    continue
                info = frames[file].get(str(segment_ids[v, u]))
                if info is None:
                    continue
                key = (info["category_id"], self._object(info, int(point)))
                votes.setdefault(int(point), {}).setdefault(key, 0)
                votes[int(point)][key] += 1
        self.class_of, self.object_of, self.count = {}, {}, {}
        for point, found in votes.items():
            by_class = {}
            for (category, _), n in found.items():
                by_class[category] = by_class.get(category, 0) + n
            self.class_of[point] = max(by_class, key=lambda c: (by_class[c], -c))
            best = max(found, key=lambda k: (found[k], k))
            self.object_of[point] = best[1]
            self.count[point] = sum(found.values())

    def _object(self, info, point):
        """A stuff segment may span several planar objects: take the one whose plane is nearest."""
        if info["category_id"] in self.things or len(info["objects"]) < 2:
            return info["object"]
        candidates = [int(i) for i in info["objects"] if self.plane(int(i))]
        if not candidates:
            return info["object"]
        return min(candidates, key=lambda i: abs(self._distance(i, self.xyz[point])))

    def _distance(self, object_id, x):
        normal, offset = self.plane(object_id)
        return normal @ x + offset


# ---- measures --------------------------------------------------------------------------------------


class Lifted:
    """A result of s3-lift."""

    def __init__(self, folder):
        document = json.loads((folder / "semantics.json").read_text())
        self.classes = document["class_table"]["classes"]
        self.clusters = document["clusters"]
        self.planes = document["planes"]
        self.points = document["points"]
        self.observations = dict(zip(self.points, document["num_mask_observations"]))
        distributions = np.load(folder / "distributions.npy")
        best = distributions.argmax(1)
        self.confidence = dict(zip(self.points, distributions.max(1)))
        self.point_class = {p: self.classes[b]["id"] for p, b in zip(self.points, best)}
        self.label = dict(self.point_class)
        self.cluster_of = {}
        for cluster in self.clusters:
            for point in cluster["points"]:
                self.label[point] = cluster["class_id"]
                self.cluster_of[point] = cluster["id"]


def judged_points(lifted, truth):
    return [p for p in lifted.points
            if lifted.observations[p] >= MIN_OBSERVATIONS and p in truth.class_of]


def class_measures(lifted, truth):
    points = judged_points(lifted, truth)
    right = np.array([lifted.point_class[p] == truth.class_of[p] for p in points])
    confidence = np.array([lifted.confidence[p] for p in points])
    calibration = 0.0
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (confidence > low) & (confidence <= low + 0.1)
        if inside.any():
            calibration += inside.mean() * abs(confidence[inside].mean() - right[inside].mean())
    final = np.mean([lifted.label[p] == truth.class_of[p] for p in points])
    return {"points judged": len(points), "point accuracy": float(right.mean()),
            "final accuracy": float(final), "calibration error": float(calibration)}


def instance_measures(lifted, truth):
    """Things only. Purity over the points of thing clusters, completeness over those of objects."""
    points = judged_points(lifted, truth)
    thing_clusters = {c["id"] for c in lifted.clusters if c["class_id"] in truth.things}
    in_cluster, of_object = {}, {}
    for p in points:
        cluster, thing = lifted.cluster_of.get(p), truth.object_of[p]
        if cluster in thing_clusters:
            in_cluster.setdefault(cluster, []).append(thing)
        if truth.class_of[p] in truth.things:
            of_object.setdefault(thing, []).append(cluster if cluster in thing_clusters else None)
    most = {c: max(set(v), key=lambda o: (v.count(o), -o)) for c, v in in_cluster.items()}
    pure = sum(v.count(most[c]) for c, v in in_cluster.items())
    complete = sum(max([v.count(c) for c in set(v) if c is not None], default=0)
                   for v in of_object.values())
    owners = [o for o in most.values() if o in of_object]
    missed = [o for o, v in of_object.items() if len(v) >= 10 and o not in owners]
    return {"purity": pure / max(1, sum(map(len, in_cluster.values()))),
            "completeness": complete / max(1, sum(map(len, of_object.values()))),
            "clusters per object": len(most) / max(1, len(set(owners))),
            "objects": len(of_object), "missed objects": missed,
            "split objects": sorted({o for o in owners if owners.count(o) > 1})}


def plane_in_truth(plane, alignment):
    scale, turn, shift = alignment
    normal = turn @ np.array(plane["normal_in_world"])
    return normal, scale * plane["offset"] - normal @ shift


def plane_measures(lifted, truth):
    on_object = {}
    for p in judged_points(lifted, truth):
        on_object.setdefault(truth.object_of[p], set()).add(p)
    rows, normals = [], {}
    for object_id, info in sorted(truth.objects.items()):
        points = on_object.get(object_id, set())
        if not info.get("plane_reliable"):
            continue
        if sum(truth.is_on_plane(object_id, p) for p in points) < MIN_OBJECT_POINTS:
            continue
        shared = [(len(points & set(plane["inliers"])), -i) for i, plane in
                  enumerate(lifted.planes)]
        count, index = max(shared, default=(0, 0))
        row = {"object": info["name"], "points": len(points), "inliers": count}
        if count >= len(points) / 4:
            normal, offset = plane_in_truth(lifted.planes[-index], truth.alignment)
            true_normal, true_offset = truth.plane(object_id)
            centre = np.array(info.get(f"centroid_{truth.world}") or
                              np.mean([truth.xyz[p] for p in points], axis=0))
            centre = centre - (true_normal @ centre + true_offset) * true_normal
            row["normal_deg"] = float(np.degrees(np.arccos(np.clip(
                abs(normal @ true_normal), 0, 1))))
            row["offset_cm"] = float(100 * abs(normal @ centre + offset))
            normals[info["name"]] = normal
        rows.append(row)
    found = [r for r in rows if "normal_deg" in r]
    flat = [n for n in ("table_top", "floor_carpet", "worktop") if n in normals]
    angles = [float(np.degrees(np.arccos(np.clip(abs(normals[a] @ normals[b]), 0, 1))))
              for i, a in enumerate(flat) for b in flat[i + 1:]]
    return {"planes due": len(rows), "planes found": len(found),
            "normal deg (median)": float(np.median([r["normal_deg"] for r in found] or [np.nan])),
            "offset cm (median)": float(np.median([r["offset_cm"] for r in found] or [np.nan])),
            "horizontal planes apart deg (max)": max(angles, default=float("nan")),
            "horizontal planes": flat, "wrong planes": wrong_planes(lifted, truth),
            "per object": rows}


def wrong_planes(lifted, truth):
    """Planes most of whose inliers lie on an object of a class that is not planar."""
    planar_classes = {c["id"] for c in lifted.classes if c["planar"]}
    wrong = []
    for plane in lifted.planes:
        owners = [truth.object_of[p] for p in plane["inliers"] if p in truth.object_of]
        if not owners:
            continue
        owner = max(set(owners), key=owners.count)
        if owner in truth.objects and truth.objects[owner]["category_id"] not in planar_classes:
            wrong.append(truth.objects[owner]["name"])
    return wrong


def road_measures(lifted, images, points, trajectory):
    """Height of the cameras above the road plane each sees most of, in metres."""
    centres, truth = camera_centres(images, trajectory, None)
    scale, _, _ = align(truth, centres)
    roads = [(set(p["inliers"]), np.array(p["normal_in_world"]), p["offset"])
             for p in lifted.planes if p["class"] == "road"]
    heights = []
    for name, turn, shift, _, ids in images.values():
        seen = set(int(i) for i in ids if i >= 0)
        counts = [len(seen & inliers) for inliers, _, _ in roads]
        if not counts or max(counts) < 10:
            continue
        _, normal, offset = roads[int(np.argmax(counts))]
        heights.append(scale * abs(normal @ (-turn.T @ shift) + offset))
    height = float(np.median(heights)) if heights else float("nan")
    angles = [np.degrees(np.arccos(np.clip(abs(a[1] @ b[1]), 0, 1)))
              for i, a in enumerate(roads) for b in roads[i + 1:]]
    return {"road planes": len(roads), "cameras above a road": len(heights),
            "camera height m (median)": height,
            "camera height m (10 %, 90 %)": [float(x) for x in np.percentile(heights, [10, 90])]
            if heights else [],
            "height error %": 100 * abs(height / CAMERA_HEIGHT_M - 1),
            "road planes apart deg (max)": float(max(angles, default=0.0))}


# ---- running ---------------------------------------------------------------------------------------

ARMS = {
    "default": [],
    "iou": ["instances=iou"],
    "iou, reprojection": ["instances=iou", "clusters.merge=reprojection"],
    "consensus": ["instances=consensus"],
    "paper's Bayes": ["fusion.use_scores=false", "fusion.drop_border=false", "fusion.tempering=0"],
    "majority": ["fusion.method=majority"],
    "confusion": ["fusion.confusion=estimated"],
}


def lift(binary, model, masks, classes, output, settings, seed=0):
    command = [str(binary), "--model", str(model), "--masks", str(masks), "--classes",
               str(REPOSITORY / "configs" / "classes" / classes), "--output", str(output),
               "--seed", str(seed), "--overwrite", "--quiet", "--progress", "none"]
    for setting in settings:
        command += ["--set", setting]
    start = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return Lifted(output), time.monotonic() - start


HEADER = ("class %", "final %", "ECE", "purity", "complete", "per object", "missed", "planes", "deg",
          "cm", "parallel", "wrong", "s")


def measure(lifted, truth, seconds):
    return {**class_measures(lifted, truth), **instance_measures(lifted, truth),
            **plane_measures(lifted, truth), "seconds": seconds}


def print_row(label, measured):
    print(("{:<32}{:>10.2f}{:>10.2f}" + "{:>10.3f}" * 3 + "{:>10.2f}{:>10}{:>10}"
           "{:>10.2f}{:>10.2f}{:>10.2f}{:>10}{:>10.2f}").format(
        label, 100 * measured["point accuracy"], 100 * measured["final accuracy"],
        measured["calibration error"], measured["purity"], measured["completeness"],
        measured["clusters per object"], len(measured["missed objects"]),
        f"{measured['planes found']}/{measured['planes due']}", measured["normal deg (median)"],
        measured["offset cm (median)"], measured["horizontal planes apart deg (max)"],
        len(measured["wrong planes"]), measured["seconds"]), flush=True)


def print_header():
    print(("{:<32}" + "{:>10}" * len(HEADER)).format("", *HEADER))


def run_kitchen(arguments, results):
    folder = arguments.data / "redkitchen"
    for model in arguments.redkitchen_models or [folder / "colmap_model"]:
        images, points = read_model(model)
        truth = Truth(folder, images, points)
        print(f"\nredkitchen, {model.name}: {len(images)} images, {len(points)} points, "
              f"camera centres within {1000 * truth.alignment_rms:.1f} mm RMS")
        print_header()
        for masks in ("clean", "noisy"):
            rows = []
            for arm, seed in itertools.product(arguments.arms, arguments.lift_seeds):
                lifted, seconds = lift(arguments.bin / "s3-lift", model,
                                       folder / f"panoptic_{masks}", "coco.json",
                                       arguments.output / "lift", ARMS[arm] + arguments.settings,
                                       seed)
                measured = measure(lifted, truth, seconds)
                label = f"{masks} {arm}" + (f" seed {seed}" if seed else "")
                results[f"redkitchen {model.name} {label}"] = measured
                print_row(label, measured)
                rows.append(measured)
            print_planes(rows[0])


# ---- synthetic scenes ------------------------------------------------------------------------------


def run_program(binary, *arguments):
    subprocess.run([str(binary), *map(str, arguments), "--overwrite", "--quiet", "--progress",
                    "none"], check=True, stdout=subprocess.DEVNULL)


def map_scene(programs, scene, seed, folder, model):
    """The model that s3-slam makes of a scene, on whose images no corruption of masks has a part."""
    slam = ["s3-slam", "--sequence", folder, "--output", model]
    made_by = identity.of(programs, [["s3-synth", "--scene", scene, "--seed", seed], slam])
    record = model.with_name(model.name + ".json")
    if model.is_dir() and identity.is_done(record, made_by):
        return
    record.unlink(missing_ok=True)
    run_program(programs / slam[0], *slam[1:])
    stages.write_json(record, {"made_by": made_by})


def run_synthetic(arguments, results):
    """Every scene and seed at every level of corruption, on the model that s3-slam makes of it."""
    print("\nsynthetic scenes: masks corrupted by 0 (exact) to 0.4 (hardly usable)")
    print_header()
    for scene in arguments.scenes:
        rows = {}
        for seed in arguments.seeds:
            folder = arguments.output / f"{scene}_{seed}"
            for level in arguments.levels:
                run_program(arguments.bin / "s3-synth", "--scene", scene, "--seed", seed,
                            "--mask-corruption", level, "--output", folder)
                model = arguments.output / f"{scene}_{seed}_slam"
                map_scene(arguments.bin, scene, seed, folder, model)
                for arm in ("default", "iou"):
                    measured = measure_synthetic(arguments, scene, folder, model, arm)
                    results[f"{scene} {seed} {level} {arm}"] = measured
                    rows.setdefault((level, arm), []).append(measured)
            shutil.rmtree(folder)
        for (level, arm), measured in rows.items():
            print_row(f"{scene} {level:.2f} {arm} ({len(measured)} seeds)", average(measured))


def measure_synthetic(arguments, scene, folder, model, arm):
    is_drive = (folder / "panoptic").is_dir()
    classes = "cityscapes.json" if is_drive else "coco.json"
    images, points = read_model(model)
    truth = Truth(folder, images, points, "gt", "groundtruth.txt", None, classes)
    masks = "panoptic_noisy"
    lifted, seconds = lift(arguments.bin / "s3-lift", model, folder / masks, classes,
                           arguments.output / "lift", ARMS[arm] + arguments.settings)
    return measure(lifted, truth, seconds)


def average(rows):
    """Means over seeds; lists are put one behind the other, counts of planes added."""
    result = {}
    for key, value in rows[0].items():
        values = [row[key] for row in rows]
        if isinstance(value, list):
            result[key] = sum(values, [])
        elif key in ("planes due", "planes found"):
            result[key] = sum(values)
        elif isinstance(value, (int, float)):
            known = [v for v in values if not np.isnan(v)]
            result[key] = float(np.mean(known)) if known else float("nan")
    return result


# ---- other models ----------------------------------------------------------------------------------


def split_into_cameras(model, masks, output, num_cameras=2):
    """The same model and masks with the images dealt out to cameras of their own in sub-folders."""
    (output / "model").mkdir(parents=True, exist_ok=True)
    shutil.copy(model / "points3D.bin", output / "model")
    cameras = (model / "cameras.bin").read_bytes()
    assert struct.unpack_from("<Q", cameras) == (1,), "one camera expected"
    (output / "model" / "cameras.bin").write_bytes(struct.pack("<Q", num_cameras) + b"".join(
        struct.pack("<I", i + 1) + cameras[12:] for i in range(num_cameras)))
    data = (model / "images.bin").read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    offset, records, folder_of = 8, [struct.pack("<Q", count)], {}
    for i in range(count):
        end = data.index(b"\0", offset + 64)
        (num,) = struct.unpack_from("<Q", data, end + 1)
        next_offset = end + 9 + 24 * num
        name = pathlib.Path(data[offset + 64:end].decode()).name
        folder = f"cam{i % num_cameras}"
        folder_of[frame_number(name)] = folder
        records.append(data[offset:offset + 60] + struct.pack("<I", i % num_cameras + 1) +
                       f"{folder}/{name}".encode() + data[end:next_offset])
        offset = next_offset
    (output / "model" / "images.bin").write_bytes(b"".join(records))
    document = json.loads(masks.with_suffix(".json").read_text())
    kept = []
    for annotation in document["annotations"]:
        folder = folder_of.get(frame_number(annotation["file_name"]))
        if folder is None:
            continue
        (output / "masks" / folder).mkdir(parents=True, exist_ok=True)
        shutil.copy(masks / annotation["file_name"], output / "masks" / folder)
        kept.append({**annotation, "file_name": f"{folder}/{annotation['file_name']}"})
    (output / "masks.json").write_text(json.dumps({"annotations": kept}))


def run_cameras(arguments, results):
    """A model of two cameras in sub-folders must give what the same model of one camera gives."""
    folder, model = arguments.output / "cameras_scene", arguments.output / "cameras_slam"
    run_program(arguments.bin / "s3-synth", "--scene", "desk", "--output", folder)
    run_program(arguments.bin / "s3-slam", "--sequence", folder, "--output", model)
    output = arguments.output / "cameras"
    split_into_cameras(model, folder / "panoptic_noisy", output)
    print("\ntwo cameras in sub-folders (desk, noisy)")
    print_header()
    for label, one_model, masks in (("one camera", model, folder / "panoptic_noisy"),
                                    ("two cameras", output / "model", output / "masks")):
        images, points = read_model(one_model)
        truth = Truth(folder, images, points, "gt", "groundtruth.txt", None)
        lifted, seconds = lift(arguments.bin / "s3-lift", one_model, masks, "coco.json",
                               arguments.output / "lift", [])
        results[label] = measure(lifted, truth, seconds)
        print_row(label, results[label])
        run_program(arguments.bin / "s3-refine", "--model", one_model, "--semantics",
                    arguments.output / "lift", "--output", arguments.output / "refine")


# ---- models that COLMAP made, through refinement too ------------------------------------------------


def centre_rms(model, trajectory, rate_hz):
    """Camera centres of a model against a trajectory after alignment, RMS [m]."""
    centres, truth = camera_centres(read_model(model)[0], trajectory, rate_hz)
    scale, turn, shift = align(truth, centres)
    return float(np.sqrt(((scale * centres @ turn.T + shift - truth) ** 2).sum(1).mean()))


# Arms of s3-refine on models that COLMAP made; the camera's height counts where there is a road.
REFINE_ARMS = {
    "without planes": ["planes.mode=off"],
    "planes": ["camera_height.mode=off"],
    "planes, camera height, camera as given": ["camera_height.refine_camera=none"],
    "planes, camera height, distortion": ["camera_height.refine_camera=distortion"],
    "planes, camera height": [],
    "without planes, distortion refined": ["planes.mode=off", "intrinsics.distortion=true"],
}


def run_colmap_models(arguments, results):
    """Stages 2 and 3 on the models beside the real sequences, which `colmap` reconstructed."""
    print("\nmodels that colmap made, noisy masks: camera centres off after alignment, RMS [m]\n")
    print(f"| sequence | as given | {' | '.join(REFINE_ARMS)} |")
    print("|---" * (len(REFINE_ARMS) + 2) + "|")
    for name, classes, reference, rate_hz in (
            ("redkitchen", "coco.json", "trajectory_colour_sfm.txt", 30.0),
            ("kitti07", "cityscapes.json", "groundtruth.txt", None)):
        folder = arguments.data / name
        model, semantics = folder / "colmap_model", arguments.output / "lift"
        refined = arguments.output / "refine"
        lift(arguments.bin / "s3-lift", model, folder / "panoptic_noisy", classes, semantics,
             arguments.settings)
        trajectory = read_tum(folder / reference)
        centres = {"as given": centre_rms(model, trajectory, rate_hz)}
        for arm, settings in REFINE_ARMS.items():
            run_program(arguments.bin / "s3-refine", "--model", model, "--semantics", semantics,
                        "--output", refined, *(word for key in settings for word in ("--set", key)))
            centres[arm] = centre_rms(refined, trajectory, rate_hz)
        results[f"colmap {name}"] = {"centres m": centres}
        print(f"| {name} | {' | '.join(f'{error:.4f}' for error in centres.values())} |")


def print_planes(measured):
    for row in measured["per object"]:
        error = (f"{row['normal_deg']:8.2f} deg{row['offset_cm']:8.2f} cm"
                 if "normal_deg" in row else "  not found")
        print(f"    {row['object']:<28}{row['inliers']:>5} of {row['points']:>4} points{error}")


def run_kitti(arguments, results):
    folder = arguments.data / "kitti07"
    for model in arguments.kitti_models or [folder / "colmap_model"]:
        run_kitti_model(arguments, results, folder, model)


def run_kitti_model(arguments, results, folder, model):
    images, points = read_model(model)
    trajectory = read_tum(folder / "groundtruth.txt")
    print(f"\nkitti07, {model.name}: {len(images)} images, {len(points)} points")
    for masks in ("panoptic", "panoptic_noisy"):
        lifted, seconds = lift(arguments.bin / "s3-lift", model, folder / masks, "cityscapes.json",
                               arguments.output / "lift", arguments.settings)
        measured = road_measures(lifted, images, points, trajectory)
        results[f"kitti07 {model.name} {masks}"] = {**measured, "seconds": seconds}
        print(f"{masks:<16}camera height {measured['camera height m (median)']:.3f} m, "
              f"{measured['height error %']:.1f} % off; {measured['road planes']} road planes, "
              f"{measured['cameras above a road']} cameras, {seconds:.2f} s")


PARTS = {"redkitchen": run_kitchen, "kitti07": run_kitti, "synthetic": run_synthetic,
         "cameras": run_cameras, "colmap": run_colmap_models}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--bin", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--redkitchen-models", type=pathlib.Path, nargs="+",
                        help="default: the colmap_model beside the sequence")
    parser.add_argument("--kitti-models", type=pathlib.Path, nargs="+")
    parser.add_argument("--arms", nargs="+", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--scenes", nargs="+",
                        default=["desk", "floor", "posters", "room", "street"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3, 4, 5])
    parser.add_argument("--levels", nargs="+", type=float,
                        default=[0.0, 0.1, 0.15, 0.2, 0.3, 0.4])
    parser.add_argument("--lift-seeds", nargs="+", type=int, default=[0],
                        help="of the samples that s3-lift draws, on redkitchen")
    parser.add_argument("--set", action="append", default=[], dest="settings",
                        metavar="KEY.PATH=VALUE", help="for s3-lift, on top of every arm")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    results = {}
    for part in arguments.parts:
        PARTS[part](arguments, results)
    (arguments.output / "lifting.json").write_text(json.dumps(results, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
