#!/usr/bin/env python3
"""Time and memory of s3-lift beside a program that only decodes the same masks.

Takes what s3-slam made of a sequence and lifts onto models in which every k-th frame is an image, so
that the cost is seen to grow with the frames and the memory not. A loop that decodes one mask after the
other, one that decodes on all cores, and s3-lift run alternately; medians are printed. Build
s3-decode-masks with -DS3LAM_BENCHMARKS=ON.

  lifting_cost.py --slam DIR --masks DIR --classes FILE --bin DIR --output DIR
                  [--every 8 4 2 1] [--repeats 5] [--set KEY.PATH=VALUE]
"""
import argparse
import json
import pathlib
import resource
import statistics
import struct
import subprocess
import sys
import time

from planes import rotate

KEYPOINT = struct.Struct("<ddq")
WALL, CPU = 0, 1  # Of what run() returns.


def read_keyframes(slam):
    """Frame number by image id, and the bytes of its points2D."""
    data = (slam / "images.bin").read_bytes()
    offset, frames = 8, {}
    for _ in range(struct.unpack_from("<Q", data)[0]):
        (image_id,) = struct.unpack_from("<I", data, offset)
        end = data.index(b"\0", offset + 64)
        (count,) = struct.unpack_from("<Q", data, end + 1)
        name = data[offset + 64:end].decode()
        begin = end + 9
        offset = begin + KEYPOINT.size * count
        frames[image_id] = (name, data[begin:offset])
    return frames


def read_observations(slam):
    """Of the frames that are no keyframes: time, [(point id, x, y)]."""
    data = (slam / "observations.bin").read_bytes()
    assert data[:8] == b"S3OBSV01"
    offset, frames = 16, []
    for _ in range(struct.unpack_from("<Q", data, 8)[0]):
        time_s, _, count = struct.unpack_from("<dIQ", data, offset)
        offset += 20
        records = struct.iter_unpack("<Qfff", data[offset:offset + 20 * count])
        frames.append((time_s, [(point, x, y) for point, x, y, _ in records]))
        offset += 20 * count
    return frames


def read_poses(path):
    """Time and cam_from_world (qw, qx, qy, qz, tx, ty, tz) of every pose."""
    poses = []
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            continue
        t, x, y, z, qx, qy, qz, qw = map(float, line.split())
        turned = rotate((qw, -qx, -qy, -qz), (x, y, z))
        poses.append((t, (qw, -qx, -qy, -qz, *(-c for c in turned))))
    return poses


def make_model(slam, mask_names, every, output):
    """A binary COLMAP model whose images are every k-th frame; returns their number. An image has the
    name of its frame's mask: the frames are those of the masks, in order."""
    poses = read_poses(slam / "frames.txt")
    assert len(poses) == len(mask_names), "a mask and a pose of every frame are needed"
    number_of_time = {t: i for i, (t, _) in enumerate(poses)}
    keypoints = {}
    for time_s, seen in read_observations(slam):
        keypoints[nearest(number_of_time, time_s)] = [(x, y, p) for p, x, y in seen]
    key_times = [t for t, _ in read_poses(slam / "keyframes.txt")]
    key_frames = sorted(read_keyframes(slam).values())
    for time_s, (_, packed) in zip(key_times, key_frames):
        keypoints[nearest(number_of_time, time_s)] = [
            k for k in KEYPOINT.iter_unpack(packed) if k[2] >= 0]
    tracks, images = {}, []
    for number in range(0, len(poses), every):
        seen = keypoints.get(number, [])
        for index, (_, _, point) in enumerate(seen):
            tracks.setdefault(point, []).append((number + 1, index))
        images.append(struct.pack("<I7dI", number + 1, *poses[number][1], 1) +
                      mask_names[number].encode() + b"\0" + struct.pack("<Q", len(seen)) +
                      b"".join(KEYPOINT.pack(*k) for k in seen))
    output.mkdir(parents=True, exist_ok=True)
    (output / "cameras.bin").write_bytes((slam / "cameras.bin").read_bytes())
    (output / "images.bin").write_bytes(struct.pack("<Q", len(images)) + b"".join(images))
    write_points(slam, tracks, output / "points3D.bin")
    return len(images)


def nearest(number_of_time, time_s):
    return number_of_time[min(number_of_time, key=lambda t: abs(t - time_s))]


def write_points(slam, tracks, path):
    data = (slam / "points3D.bin").read_bytes()
    offset, records = 8, []
    for _ in range(struct.unpack_from("<Q", data)[0]):
        (point,) = struct.unpack_from("<Q", data, offset)
        (length,) = struct.unpack_from("<Q", data, offset + 43)
        if point in tracks:
            records.append(data[offset:offset + 43] + struct.pack("<Q", len(tracks[point])) +
                           b"".join(struct.pack("<II", *t) for t in tracks[point]))
        offset += 51 + 8 * length
    path.write_bytes(struct.pack("<Q", len(records)) + b"".join(records))


def run(command):
    """Wall time and CPU time [s]."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
    wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(arguments, every, mask_names):
    model = arguments.output / f"every_{every}"
    count = make_model(arguments.slam, mask_names, every, model)
    masks = arguments.output / "masks.txt"
    masks.write_text("".join(f"{arguments.masks / name}\n" for name in mask_names[::every]))
    lift = [arguments.bin / "s3-lift", "--model", model, "--masks", arguments.masks, "--classes",
            arguments.classes, "--output", arguments.output / "lift", "--overwrite", "--quiet",
            "--progress", "none"]
    for setting in arguments.settings:
        lift += ["--set", setting]
    decode = [arguments.bin / "s3-decode-masks", masks]
    rounds = [(run([*decode, "1"]), run([*decode, "0"]), run(lift))
              for _ in range(arguments.repeats)]
    loop, all_cores, lifted = zip(*rounds)
    report = json.loads((arguments.output / "lift" / "report.json").read_text())
    return {"images": count,
            "loop s": statistics.median(wall for wall, _ in loop),
            "all cores s": statistics.median(wall for wall, _ in all_cores),
            "lift s": statistics.median(wall for wall, _ in lifted),
            "to loop": median_ratio(lifted, loop, WALL),
            "to all cores": median_ratio(lifted, all_cores, WALL),
            "cpu ratio": median_ratio(lifted, loop, CPU),
            "peak MiB": report["peak_memory_mib"], "steps s": report["seconds"]}


def median_ratio(runs, others, which):
    return statistics.median(run[which] / other[which] for run, other in zip(runs, others))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("slam", "masks", "classes", "bin", "output"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("--every", type=int, nargs="+", default=[8, 4, 2, 1])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--set", action="append", default=[], dest="settings",
                        metavar="KEY.PATH=VALUE", help="for s3-lift")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    mask_names = sorted(p.name for p in arguments.masks.glob("*.png"))
    results = []
    columns = ("images", "loop s", "all cores s", "lift s", "to loop", "to all cores", "cpu ratio",
               "peak MiB")
    print("".join(f"{c:>15}" for c in columns))
    for every in arguments.every:
        results.append(measure(arguments, every, mask_names))
        print("".join(f"{results[-1][c]:>15.2f}" for c in columns), flush=True)
    (arguments.output / "lifting_cost.json").write_text(json.dumps(results, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
