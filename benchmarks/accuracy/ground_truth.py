"""Brings the ground truth of each data set into one form: groundtruth.txt (TUM) in the sequence's
folder, world_from_camera of the camera whose images s3-slam reads. Python's standard library only.
"""

import calendar
import math
import pathlib
import re
import time

EARTH_RADIUS_M = 6378137.0


class BadData(Exception):
    """A file of the data set is missing or not what it should be; names the file."""


# ---- rigid transforms: 4x4 as lists of rows --------------------------------------------------------


def multiply(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def rigid(rotation, translation):
    return [list(row) + [t] for row, t in zip(rotation, translation)] + [[0.0, 0.0, 0.0, 1.0]]


def inverse(transform):
    turn = [[transform[j][i] for j in range(3)] for i in range(3)]
    return rigid(turn, [-sum(turn[i][k] * transform[k][3] for k in range(3)) for i in range(3)])


def rotation_from_quaternion(w, x, y, z):
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def quaternion_xyzw(m):
    """Of the rotation in the upper left, unit; the largest component first, which is safe to divide
    by."""
    squares = [1 + m[0][0] - m[1][1] - m[2][2], 1 - m[0][0] + m[1][1] - m[2][2],
               1 - m[0][0] - m[1][1] + m[2][2], 1 + m[0][0] + m[1][1] + m[2][2]]
    off = [[0, m[0][1] + m[1][0], m[0][2] + m[2][0], m[2][1] - m[1][2]],
           [m[0][1] + m[1][0], 0, m[1][2] + m[2][1], m[0][2] - m[2][0]],
           [m[0][2] + m[2][0], m[1][2] + m[2][1], 0, m[1][0] - m[0][1]],
           [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 0]]
    largest = max(range(4), key=lambda i: squares[i])
    q = list(off[largest])
    q[largest] = squares[largest]
    norm = math.hypot(*q)
    return [c / norm for c in q]


def write_tum(path, poses):
    """`poses` has (time, world_from_camera)."""
    lines = ["# time_s tx ty tz qx qy qz qw (world_from_camera)"]
    for stamp, pose in poses:
        numbers = [pose[i][3] for i in range(3)] + quaternion_xyzw(pose)
        lines.append(" ".join([f"{stamp:.9f}"] + [repr(float(n)) for n in numbers]))
    beside = path.with_name(path.name + ".tmp")
    beside.write_text("\n".join(lines) + "\n")
    beside.replace(path)


# ---- files -----------------------------------------------------------------------------------------


def read_text(path):
    if not path.is_file():
        raise BadData(f"{path}: no such file")
    return path.read_text()


def numbers(text, path, count):
    try:
        values = [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise BadData(f"{path}: {error}") from error
    if len(values) < count:
        raise BadData(f"{path}: {len(values)} numbers where {count} are due")
    return values


def read_calibration(path):
    """'key: numbers' lines; what is not numbers (a date) is left out."""
    values = {}
    for line in read_text(path).splitlines():
        key, _, rest = line.partition(":")
        try:
            values[key.strip()] = [float(word) for word in rest.split()]
        except ValueError:
            continue
    return values


def entry(calibration, key, count, path):
    if len(calibration.get(key, ())) != count:
        raise BadData(f"{path}: no {key} of {count} numbers")
    return calibration[key]


def rows(values, columns):
    return [values[i:i + columns] for i in range(0, len(values), columns)]


def first_camera(folder, pattern):
    """The camera that s3-slam takes: the first whose images are there."""
    for i in range(4):
        if (folder / pattern.format(i)).is_dir():
            return i
    raise BadData(f"{folder}: no images {pattern.format(0)}")


def camera0_from_camera(projection):
    """Rectified cameras differ by a shift along x, which the projection has times the focal length."""
    shift = -projection[3] / projection[0]
    return rigid([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [shift, 0, 0])


# ---- KITTI raw -------------------------------------------------------------------------------------


def mercator(latitude_deg, longitude_deg, scale):
    x = scale * EARTH_RADIUS_M * math.radians(longitude_deg)
    y = scale * EARTH_RADIUS_M * math.log(math.tan(math.radians(90 + latitude_deg) / 2))
    return x, y


def world_from_imu(packet, scale):
    """Latitude, longitude, altitude, roll, pitch, yaw: the first six of an oxts packet."""
    latitude, longitude, altitude, roll, pitch, yaw = packet[:6]
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    rotation = [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr]]
    return rigid(rotation, [*mercator(latitude, longitude, scale), altitude])


def parse_date(line, path):
    """'2011-09-26 13:02:25.964389445' in seconds since 1970."""
    match = re.fullmatch(r"(\d+-\d+-\d+ \d+:\d+:\d+)(\.\d+)?", line.strip())
    if not match:
        raise BadData(f"{path}: not a date and time: '{line}'")
    whole = calendar.timegm(time.strptime(match.group(1), "%Y-%m-%d %H:%M:%S"))
    return whole + float(match.group(2) or 0)


def kitti_raw(folder):
    """From oxts and the three calibration files of the day."""
    day = folder.parent
    imu_path, velo_path, cam_path = (day / f"calib_{name}.txt" for name in
                                     ("imu_to_velo", "velo_to_cam", "cam_to_cam"))
    transforms = []
    for path in (imu_path, velo_path):
        calibration = read_calibration(path)
        transforms.append(rigid(rows(entry(calibration, "R", 9, path), 3),
                                entry(calibration, "T", 3, path)))
    cam = read_calibration(cam_path)
    rectify = rigid(rows(entry(cam, "R_rect_00", 9, cam_path), 3), [0, 0, 0])
    number = first_camera(folder, "image_{:02d}/data")
    shift = camera0_from_camera(entry(cam, f"P_rect_{number:02d}", 12, cam_path))
    camera_from_imu = multiply(inverse(shift), multiply(rectify, multiply(transforms[1],
                                                                        transforms[0])))
    imu_from_camera = inverse(camera_from_imu)
    stamps_path = folder / f"image_{number:02d}" / "timestamps.txt"
    stamps = [parse_date(line, stamps_path) for line in read_text(stamps_path).splitlines() if line]
    poses, scale, origin = [], None, None
    for path in sorted((folder / "oxts" / "data").glob("*.txt")):
        packet = numbers(read_text(path), path, 6)
        scale = math.cos(math.radians(packet[0])) if scale is None else scale
        pose = world_from_imu(packet, scale)
        # Millions of metres from the origin of Mercator's map, few digits are left for the way.
        origin = origin or [pose[i][3] for i in range(3)]
        for i in range(3):
            pose[i][3] -= origin[i]
        index = int(path.stem)
        if index >= len(stamps):
            raise BadData(f"{stamps_path}: no time for frame {index}")
        poses.append((stamps[index], multiply(pose, imu_from_camera)))
    if not poses:
        raise BadData(f"{folder / 'oxts' / 'data'}: no packets")
    return poses


# ---- the others ------------------------------------------------------------------------------------


def kitti_odometry(folder):
    """From dataset/poses/NN.txt and the sequence's times."""
    path = folder.parent.parent / "poses" / f"{folder.name}.txt"
    number = first_camera(folder, "image_{}")
    calibration = folder / "calib.txt"
    shift = camera0_from_camera(entry(read_calibration(calibration), f"P{number}", 12, calibration))
    stamps = numbers(read_text(folder / "times.txt"), folder / "times.txt", 1)
    matrices = [numbers(line, path, 12) for line in read_text(path).splitlines() if line.strip()]
    if len(matrices) != len(stamps):
        raise BadData(f"{path}: {len(matrices)} poses for {len(stamps)} times")
    return [(stamp, multiply(rows(m, 4) + [[0, 0, 0, 1]], shift))
            for stamp, m in zip(stamps, matrices)]


def euroc(folder):
    """From the state estimate, whose body frame is the IMU's, and cam0's T_BS."""
    yaml = folder / "mav0" / "cam0" / "sensor.yaml"
    match = re.search(r"T_BS:.*?data:\s*\[(.*?)\]", read_text(yaml), re.DOTALL)
    if not match:
        raise BadData(f"{yaml}: no T_BS")
    body_from_camera = rows(numbers(match.group(1), yaml, 16), 4)
    path = folder / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    poses = []
    for line in read_text(path).splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        values = numbers(line, path, 8)
        body = rigid(rotation_from_quaternion(*values[4:8]), values[1:4])
        poses.append((int(line.split(",")[0]) * 1e-9, multiply(body, body_from_camera)))
    if not poses:
        raise BadData(f"{path}: no poses")
    return poses


FRAME_PERIOD_S = 1.0 / 30.0


def seven_scenes(folder):
    """From frame-NNNNNN.pose.txt. Writes rgb.txt too, since colour and depth share the folder."""
    images = sorted(p for p in folder.glob("frame-*.color.*") if p.suffix in (".png", ".jpg"))
    if not images:
        raise BadData(f"{folder}: no frame-*.color.png")
    lines, poses = ["# timestamp filename"], []
    for image in images:
        stamp = int(image.name[len("frame-"):].split(".")[0]) * FRAME_PERIOD_S
        lines.append(f"{stamp:.6f} {image.name}")
        path = folder / (image.name.split(".")[0] + ".pose.txt")
        if path.exists():
            values = numbers(read_text(path), path, 16)
            if all(math.isfinite(v) for v in values):  # NaN where the tracking was lost.
                poses.append((stamp, rows(values, 4)))
    if not poses:
        raise BadData(f"{folder}: no frame-*.pose.txt")
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
    return poses


def tum(folder):
    """Has groundtruth.txt already."""
    read_text(folder / "rgb.txt")
    read_text(folder / "groundtruth.txt")


READERS = {"tum": tum, "kitti-raw": kitti_raw, "kitti-odometry": kitti_odometry, "euroc": euroc,
           "7-scenes": seven_scenes}


def prepare(dataset, folder):
    """Checks the sequence and writes its groundtruth.txt, unless it is there. Throws BadData."""
    folder = pathlib.Path(folder)
    truth = folder / "groundtruth.txt"
    if truth.exists() and not (dataset == "7-scenes" and not (folder / "rgb.txt").exists()):
        if dataset == "tum":
            tum(folder)
        return
    poses = READERS[dataset](folder)
    if poses is not None:
        write_tum(truth, poses)
