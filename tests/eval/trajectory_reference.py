"""ATE and RPE of two TUM trajectories, computed with numpy straight from their definitions (Umeyama
alignment; Sturm et al. 2012), as a second opinion on the C++ code.

usage: trajectory_reference.py ESTIMATE GROUND_TRUTH sim3|se3|none MAX_DT DELTA
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
        (abs(a - b), i, j)
        for i, a in enumerate(times_a)
        for j, b in enumerate(times_b)
        if abs(a - b) <= max_dt
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


def main():
    estimate_file, truth_file, align, max_dt, delta = sys.argv[1:6]
    delta = int(delta)
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
    relative = [
        inverse(inverse(truth[i]) @ truth[i + delta]) @ inverse(estimate[i]) @ estimate[i + delta]
        for i in range(len(pairs) - delta)
    ]
    difference = estimate[:, :3, 3] - truth[:, :3, 3]
    print(
        json.dumps(
            {
                "num_pairs": len(pairs),
                "ate_translation": statistics(np.linalg.norm(difference, axis=1)),
                "ate_rotation_deg": statistics(
                    [angle_deg(inverse(t[:3, :3]) @ e[:3, :3]) for t, e in zip(truth, estimate)]
                ),
                "ate_rmse_per_axis": np.sqrt((difference**2).mean(0)).tolist(),
                "rpe_translation": statistics([np.linalg.norm(e[:3, 3]) for e in relative]),
                "rpe_rotation_deg": statistics([angle_deg(e[:3, :3]) for e in relative]),
            }
        )
    )


if __name__ == "__main__":
    main()
