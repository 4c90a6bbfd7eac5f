"""ATE and RPE of two TUM trajectories, computed with numpy straight from their definitions (Umeyama
alignment; Sturm et al. 2012; the KITTI odometry benchmark's segments), as a second opinion on the C++
code.

usage: trajectory_reference.py ESTIMATE GROUND_TRUTH sim3|se3|none MAX_DT DELTA DELTA_M STEP LENGTH...
Prints JSON.
"""

import json
import sys

import numpy as np


def read(path):
    rows = np.loadtxt(path, ndmin=2)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for pose, row in zip(poses, rows):
        x, y, z, w = row[4:8] / np.linalg.norm(row[4:8])
        pose[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        pose[:3, 3] = row[1:4]
    return rows[:, 0], poses


def associate(times_a, times_b, max_dt):
    """Every pair within max_dt by increasing distance in time, each pose once."""
    candidates = sorted(
        (abs(times_a[i] - times_b[j]), i, j)
        for i in range(len(times_a))
        for j in np.flatnonzero(np.abs(times_b - times_a[i]) <= max_dt)
    )
    used_a, used_b, pairs = set(), set(), []
    for _, i, j in candidates:
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            pairs.append((i, j))
    return sorted(pairs)


def umeyama(target, source, with_scale):
    mean_t, mean_s = target.mean(0), source.mean(0)
    u, d, vt = np.linalg.svd((target - mean_t).T @ (source - mean_s) / len(target))
    s = np.diag([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ s @ vt
    variance = ((source - mean_s) ** 2).sum(1).mean()
    scale = np.trace(np.diag(d) @ s) / variance if with_scale else 1.0
    return scale, rotation, mean_t - scale * rotation @ mean_s


def angle_deg(rotation):
    skew = rotation - rotation.T
    sine = 0.5 * np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]])
    return np.degrees(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1)))


def statistics(errors):
    errors = np.asarray(errors)
    return {
        "count": len(errors),
        "rmse": float(np.sqrt((errors**2).mean())),
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "std": float(errors.std()),
        "min": float(errors.min()),
        "max": float(errors.max()),
    }


def relative(truth, estimate, i, j):
    inverse = np.linalg.inv
    error = inverse(inverse(truth[i]) @ truth[j]) @ inverse(estimate[i]) @ estimate[j]
    return np.linalg.norm(error[:3, 3]), angle_deg(error[:3, :3])


def per_length(truth, estimate, path, delta):
    """Between every pose and the first one at least `delta` farther, over the way between them."""
    errors = []
    for i in range(len(path)):
        ends = [j for j in range(i, len(path)) if path[j] >= path[i] + delta]
        if ends:
            way = path[ends[0]] - path[i]
            errors.append([e / way for e in relative(truth, estimate, i, ends[0])])
    return errors


def segments(truth, estimate, path, lengths, step):
    by_length, everything = [], []
    for length in lengths:
        errors = []
        for i in range(0, len(path), step):
            ends = [j for j in range(i, len(path)) if path[j] > path[i] + length]
            if ends:
                errors.append([e / length for e in relative(truth, estimate, i, ends[0])])
        everything += errors
        if errors:
            by_length.append([length, len(errors), *np.mean(errors, axis=0).tolist()])
    mean = np.mean(everything, axis=0).tolist() if everything else [0, 0]
    return {"by_length": by_length, "all": [0, len(everything), *mean]}


def rms(values, axis=None):
    return np.sqrt((np.asarray(values) ** 2).mean(axis)).tolist()


def travel_directions(centres):
    padded = np.concatenate([centres[:1], centres, centres[-1:]])
    steps = padded[2:] - padded[:-2]
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


def main():
    estimate_file, truth_file, align, max_dt, delta, delta_m, step, *lengths = sys.argv[1:]
    delta, step = int(delta), int(step)
    times_e, estimate = read(estimate_file)
    times_t, truth = read(truth_file)
    pairs = associate(times_e, times_t, float(max_dt))
    estimate = estimate[[i for i, _ in pairs]]
    truth = truth[[j for _, j in pairs]]
    if align != "none":
        scale, rotation, shift = umeyama(truth[:, :3, 3], estimate[:, :3, 3], align == "sim3")
        estimate[:, :3, 3] = scale * estimate[:, :3, 3] @ rotation.T + shift
        estimate[:, :3, :3] = rotation @ estimate[:, :3, :3]
    inverse = np.linalg.inv
    consecutive = [relative(truth, estimate, i, i + delta) for i in range(len(pairs) - delta)]
    centres = truth[:, :3, 3]
    path = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    over_way = per_length(truth, estimate, path, float(delta_m))
    difference = estimate[:, :3, 3] - centres
    directions = travel_directions(centres)
    along = (difference * directions).sum(1)
    print(
        json.dumps(
            {
                "num_pairs": len(pairs),
                "path_length": float(path[-1]),
                "ate_translation": statistics(np.linalg.norm(difference, axis=1)),
                "ate_rotation_deg": statistics(
                    [angle_deg(inverse(t[:3, :3]) @ e[:3, :3]) for t, e in zip(truth, estimate)]
                ),
                "ate_rmse_per_axis": rms(difference, 0),
                "ate_rmse_in_camera": rms(
                    [t[:3, :3].T @ d for t, d in zip(truth, difference)], 0
                ),
                "ate_rmse_along": rms(along),
                "ate_rmse_across": rms(
                    np.linalg.norm(difference - along[:, None] * directions, axis=1)
                ),
                "rpe_translation": statistics([e for e, _ in consecutive]),
                "rpe_rotation_deg": statistics([e for _, e in consecutive]),
                "rpe_per_length_translation": statistics([e for e, _ in over_way]),
                "rpe_per_length_rotation_deg": statistics([e for _, e in over_way]),
                "segments": segments(truth, estimate, path, [float(l) for l in lengths], step),
            }
        )
    )


if __name__ == "__main__":
    main()
