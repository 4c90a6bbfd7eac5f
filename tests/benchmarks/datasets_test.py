#!/usr/bin/env python3
"""Public data sets laid out in small like the originals: fetching, resuming, ground truth."""

import contextlib
import http.server
import io
import json
import math
import pathlib
import subprocess
import sys
import tarfile
import tempfile
import threading
import unittest
import zipfile

ACCURACY = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "accuracy"
sys.path.insert(0, str(ACCURACY))

import fetch  # noqa: E402
import ground_truth  # noqa: E402
import presets  # noqa: E402


def write(path, text="x"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def read_tum(path):
    return [[float(word) for word in line.split()] for line in path.read_text().splitlines()
            if not line.startswith("#")]


def zip_folder(folder, path):
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder))


class RangeServer(http.server.BaseHTTPRequestHandler):
    """Serves one file, with ranges; the first answer to a whole request breaks off half way."""

    content = b""
    requests = []

    def do_GET(self):
        wanted = self.headers.get("Range")
        self.requests.append(wanted)
        start = int(wanted[len("bytes="):-1]) if wanted else 0
        if start >= len(self.content):
            self.send_error(416)
            return
        self.send_response(206 if wanted else 200)
        self.send_header("Content-Length", str(len(self.content) - start))
        self.end_headers()
        end = len(self.content) if wanted else len(self.content) // 2
        self.wfile.write(self.content[start:end])

    def log_message(self, *arguments):
        pass


class TestWithFolder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_fetch(self, script, *arguments):
        return subprocess.run([ACCURACY / script, *map(str, arguments)], capture_output=True,
                              text=True)

    def fetch_from(self, script, name):
        run = self.run_fetch(script, "--from", self.folder / "there", "--to", self.folder / "data",
                             name)
        self.assertEqual(run.returncode, 0, run.stderr)


def make_tum(folder):
    write(folder / "rgb.txt", "# color images\n1.0 rgb/1.0.png\n")
    write(folder / "rgb" / "1.0.png")
    write(folder / "groundtruth.txt", "1.0 0 0 0 0 0 0 1\n")


def make_kitti_calibration(folder):
    # Axes as in the car: the IMU and the scanner look ahead along x, the camera along z.
    write(folder / "calib_imu_to_velo.txt",
          "calib_time: 25-May-2012 16:47:16\nR: 1 0 0 0 1 0 0 0 1\nT: -0.81 0.32 -0.80\n")
    write(folder / "calib_velo_to_cam.txt",
          "calib_time: 15-Mar-2012 11:37:16\nR: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.07 -0.27\ndelta_f: 0 0\n")
    write(folder / "calib_cam_to_cam.txt",
          "calib_time: 09-Jan-2012 13:57:47\nR_rect_00: 1 0 0 0 1 0 0 0 1\n"
          "P_rect_00: 700 0 600 0 0 700 180 0 0 0 1 0\n"
          "P_rect_02: 700 0 600 42 0 700 180 0 0 0 1 0\n")


LATITUDE = 49.0


def make_kitti_raw(day, camera="00", yaw=0.0, metres_per_frame=2.0):
    """A drive to the east (or turned by yaw) at the equator's scale of Karlsruhe."""
    make_kitti_calibration(day)
    drive = day / "2011_09_26_drive_0011_sync"
    stamps = []
    for i in range(5):
        write(drive / f"image_{camera}" / "data" / f"{i:010d}.png")
        stamps.append(f"2011-09-26 13:02:2{i}.250000000")
        east, north = (i * metres_per_frame * f(yaw) for f in (math.cos, math.sin))
        degrees = 180 / math.pi / ground_truth.EARTH_RADIUS_M
        latitude = LATITUDE + north * degrees
        longitude = 8.4 + east * degrees / math.cos(math.radians(LATITUDE))
        write(drive / "oxts" / "data" / f"{i:010d}.txt",
              f"{latitude:.12f} {longitude:.12f} 115.0 0 0 {yaw} " + "0 " * 24)
    write(drive / f"image_{camera}" / "timestamps.txt", "\n".join(stamps) + "\n")
    write(drive / "oxts" / "timestamps.txt", "\n".join(stamps) + "\n")
    return drive


class Fetching(TestWithFolder):
    def test_unpacked_sequence_is_linked_and_its_source_left_alone(self):
        drive = make_kitti_raw(self.folder / "there" / "deep" / "2011_09_26")
        before = sorted(p.name for p in drive.iterdir())
        self.fetch_from("fetch_kitti_raw.sh", "kitti_raw_0011")
        made = self.folder / "data" / "kitti-raw" / presets.ALL["kitti_raw_0011"].folder
        self.assertTrue((made / "image_00").is_symlink())
        self.assertTrue((made.parent / "calib_cam_to_cam.txt").exists())
        self.assertEqual(len(read_tum(made / "groundtruth.txt")), 5)
        self.assertEqual(sorted(p.name for p in drive.iterdir()), before)

    def test_archive_is_unpacked_and_recorded(self):
        name = "rgbd_dataset_freiburg1_floor"
        make_tum(self.folder / "raw" / name)
        archive = self.folder / "there" / f"{name}.tgz"
        archive.parent.mkdir()
        with tarfile.open(archive, "w:gz") as tar:
            tar.add(self.folder / "raw" / name, arcname=name)
        self.fetch_from("fetch_tum.sh", "fr1_floor")
        home = self.folder / "data" / "tum"
        self.assertTrue((home / name / "rgb" / "1.0.png").is_file())
        record = json.loads((home / "downloaded.json").read_text())[archive.name]
        self.assertEqual(record["size"], archive.stat().st_size)
        self.assertEqual(record["sha256"], fetch.sha256_of(archive))
        # A second run finds it in place, even if the archive has gone.
        archive.unlink()
        self.fetch_from("fetch_tum.sh", "fr1_floor")

    def test_archive_of_the_wrong_size_is_refused(self):
        write(self.folder / "there" / "rgbd_dataset_freiburg1_xyz.tgz", "short")
        run = self.run_fetch("fetch_tum.sh", "fr1_xyz", "--from", self.folder / "there", "--to",
                             self.folder / "data")
        self.assertEqual(run.returncode, 3)
        self.assertIn("5 bytes instead of 448204271", run.stderr)

    def test_what_is_missing_is_named_and_the_rest_is_done(self):
        make_tum(self.folder / "there" / "rgbd_dataset_freiburg2_xyz")
        run = self.run_fetch("fetch_tum.sh", "fr1_desk", "fr2_xyz", "--from",
                             self.folder / "there", "--to", self.folder / "data")
        self.assertEqual(run.returncode, 3)
        self.assertIn("fr1_desk: rgbd_dataset_freiburg1_desk.tgz: neither it", run.stderr)
        self.assertIn("fr2_xyz: ready", run.stderr)

    def test_broken_archive_is_refused(self):
        write(self.folder / "there" / "rgbd_dataset_freiburg2_xyz.tgz", "no archive")
        run = self.run_fetch("fetch_tum.sh", "fr2_xyz", "--from", self.folder / "there", "--to",
                             self.folder / "data")
        self.assertEqual(run.returncode, 3)
        self.assertIn("broken archive", run.stderr)

    def test_archive_that_leaves_its_folder_is_refused(self):
        path = self.folder / "evil.tgz"
        with tarfile.open(path, "w:gz") as tar:
            member = tarfile.TarInfo("../outside.txt")
            member.size = 1
            tar.addfile(member, io.BytesIO(b"x"))
        with self.assertRaisesRegex(fetch.FetchFailed, "outside"):
            fetch.unpack(path, self.folder / "in")
        self.assertFalse((self.folder / "outside.txt").exists())

    def test_archive_with_links_is_refused(self):
        for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE):
            path = self.folder / "evil.tgz"
            with tarfile.open(path, "w:gz") as tar:
                link = tarfile.TarInfo("images")
                link.type, link.linkname = kind, "../.."
                tar.addfile(link)
                member = tarfile.TarInfo("images/outside.txt")
                member.size = 1
                tar.addfile(member, io.BytesIO(b"x"))
            with self.assertRaisesRegex(fetch.FetchFailed, "neither a file nor a folder"):
                fetch.unpack(path, self.folder / "a" / "in")
        self.assertFalse((self.folder / "outside.txt").exists())

    def test_failing_disk_is_told_apart_from_a_broken_archive(self):
        make_tum(self.folder / "raw")
        path = self.folder / "good.tgz"
        with tarfile.open(path, "w:gz") as tar:
            tar.add(self.folder / "raw", arcname="raw")
        write(self.folder / "in" / "raw", "a file in the way")
        with self.assertRaisesRegex(fetch.FetchFailed, "cannot unpack into .*/in: "):
            fetch.unpack(path, self.folder / "in")
        content = path.read_bytes()
        broken = content[:-20] + bytes(20)  # No checksum, and zeros where the data end.
        for bad in (content[:len(content) // 2], broken, content[:20] + b"\xff" * 40):
            path.write_bytes(bad)
            with self.assertRaisesRegex(fetch.FetchFailed, "broken archive"):
                fetch.unpack(path, self.folder / "elsewhere")

    def test_seven_scenes_has_archives_in_archives(self):
        sequence = self.folder / "raw" / "seq" / "seq-01"
        make_seven_scenes(sequence)
        scene = self.folder / "raw" / "scene"
        zip_folder(sequence.parent, scene / "heads" / "seq-01.zip")
        zip_folder(scene, self.folder / "there" / "heads.zip")
        preset = presets.ALL["7scenes_heads"]
        small = presets.dataclasses.replace(
            preset, archives=(presets.Archive(preset.archives[0].url),))
        home = self.folder / "data" / "7-scenes"
        home.mkdir(parents=True)
        fetch.fetch(small, home, self.folder / "there", None, False,
                    fetch.Record(home / "downloaded.json"))
        self.assertEqual(len(read_tum(home / "heads" / "seq-01" / "groundtruth.txt")), 2)

    def test_download_goes_on_where_it_stopped(self):
        content = bytes(range(256)) * 4000
        RangeServer.content, RangeServer.requests = content, []
        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), RangeServer) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            path = self.folder / "archive.zip"
            url = f"http://127.0.0.1:{server.server_port}/archive.zip"
            fetch.download(url, path)
            self.assertEqual(path.read_bytes(), content)
            self.assertEqual(RangeServer.requests, [None, f"bytes={len(content) // 2}-"])
            # All is there, but an interruption came before the last step.
            path.rename(self.folder / "archive.zip.part")
            fetch.download(url, path)
            self.assertEqual(path.read_bytes(), content)
            server.shutdown()


def make_seven_scenes(folder):
    for i, pose in ((0, "1 0 0 0.5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"), (1, "nan " * 16),
                    (3, "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n")):
        write(folder / f"frame-{i:06d}.color.png")
        write(folder / f"frame-{i:06d}.depth.png")
        write(folder / f"frame-{i:06d}.pose.txt", pose)


class GroundTruth(TestWithFolder):
    def test_kitti_raw_is_metric_and_in_the_cameras_axes(self):
        yaw = 0.7
        drive = make_kitti_raw(self.folder / "2011_09_26", yaw=yaw)
        ground_truth.prepare("kitti-raw", drive)
        poses = read_tum(drive / "groundtruth.txt")
        self.assertAlmostEqual(poses[1][0] - poses[0][0], 1.0)
        self.assertEqual(poses[0][0], 1317042140.25)  # 2011-09-26 13:02:20.25 UTC
        for a, b in zip(poses, poses[1:]):
            self.assertAlmostEqual(math.dist(a[1:4], b[1:4]), 2.0, places=4)
        # The camera looks where the car drives: its z axis in the world is the way.
        x, y, z, w = poses[2][4:]
        forward = [row[2] for row in ground_truth.rotation_from_quaternion(w, x, y, z)]
        way = [(b - a) / 2.0 for a, b in zip(poses[2][1:4], poses[3][1:4])]
        for f, s, expected in zip(forward, way, (math.cos(yaw), math.sin(yaw), 0.0)):
            self.assertAlmostEqual(f, expected, places=9)
            self.assertAlmostEqual(s, expected, places=4)

    def test_kitti_raw_places_the_camera_beside_the_imu(self):
        drive = make_kitti_raw(self.folder / "2011_09_26")
        ground_truth.prepare("kitti-raw", drive)
        # With yaw 0: x ahead, y left, z up. In the camera (ahead z) the IMU's origin is at
        # R T_imu + T = (-0.32, 0.80 - 0.07, -0.81 - 0.27); the camera is opposite, in IMU axes.
        first = read_tum(drive / "groundtruth.txt")[0]
        for value, expected in zip(first[1:4], (1.08, -0.32, 0.73)):
            self.assertAlmostEqual(value, expected, places=6)

    def test_kitti_raw_colour_camera_is_shifted(self):
        places = []
        for number in ("00", "02"):
            drive = make_kitti_raw(self.folder / number / "2011_09_26", camera=number)
            ground_truth.prepare("kitti-raw", drive)
            places.append(read_tum(drive / "groundtruth.txt")[0][1:4])
        # 42 / 700 = 0.06 along the negative x of the camera, which is to the left: y of the world.
        self.assertAlmostEqual(places[1][1] - places[0][1], 0.06, places=9)
        self.assertAlmostEqual(places[1][0], places[0][0], places=9)

    def test_kitti_raw_skips_no_frames_silently(self):
        drive = make_kitti_raw(self.folder / "2011_09_26")
        write(drive / "oxts" / "data" / "0000000009.txt", f"{LATITUDE} 8.4 0 0 0 0")
        with self.assertRaisesRegex(ground_truth.BadData, "no time for frame 9"):
            ground_truth.prepare("kitti-raw", drive)

    def test_kitti_odometry(self):
        dataset = self.folder / "dataset"
        sequence = dataset / "sequences" / "07"
        write(sequence / "image_0" / "000000.png")
        write(sequence / "calib.txt", "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n")
        write(sequence / "times.txt", "0.0\n0.1\n")
        write(dataset / "poses" / "07.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 2 0 0 1 3\n")
        ground_truth.prepare("kitti-odometry", sequence)
        self.assertEqual(read_tum(sequence / "groundtruth.txt")[1],
                         [0.1, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])
        (sequence / "groundtruth.txt").unlink()
        write(sequence / "times.txt", "0.0\n")
        with self.assertRaisesRegex(ground_truth.BadData, "07.txt: 2 poses for 1 times"):
            ground_truth.prepare("kitti-odometry", sequence)

    def test_euroc_takes_the_body_to_the_camera(self):
        sequence = self.folder / "MH_05_difficult"
        write(sequence / "mav0" / "cam0" / "sensor.yaml",
              "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
              "  data: [0.0, -1.0, 0.0, 0.5,\n   1.0, 0.0, 0.0, 0.0,\n   0.0, 0.0, 1.0, 0.0,\n"
              "   0.0, 0.0, 0.0, 1.0]\n")
        write(sequence / "mav0" / "state_groundtruth_estimate0" / "data.csv",
              "#timestamp, p, q, v, b\n1403636580838555648,1,2,3,0,0,0,1,0,0,0\n")
        ground_truth.prepare("euroc", sequence)
        row = read_tum(sequence / "groundtruth.txt")[0]
        self.assertAlmostEqual(row[0], 1403636580.838555648, places=6)
        # The body is turned half about z (w = 0, z = 1), so its x points along -x.
        for value, expected in zip(row[1:4], (0.5, 2.0, 3.0)):
            self.assertAlmostEqual(value, expected)
        self.assertAlmostEqual(abs(row[6]), math.sin(math.radians(135)))

    def test_seven_scenes_lists_colour_and_skips_lost_frames(self):
        folder = self.folder / "seq-01"
        make_seven_scenes(folder)
        ground_truth.prepare("7-scenes", folder)
        listed = [line for line in (folder / "rgb.txt").read_text().splitlines()
                  if not line.startswith("#")]
        self.assertEqual(listed, ["0.000000 frame-000000.color.png",
                                  "0.033333 frame-000001.color.png",
                                  "0.100000 frame-000003.color.png"])
        poses = read_tum(folder / "groundtruth.txt")
        self.assertEqual(len(poses), 2)
        self.assertAlmostEqual(poses[1][0], 0.1)
        self.assertEqual(poses[1][1:4], [1.0, 2.0, 3.0])
        self.assertAlmostEqual(poses[1][6], math.sqrt(0.5))

    def test_missing_files_are_named(self):
        with self.assertRaisesRegex(ground_truth.BadData, "rgb.txt: no such file"):
            ground_truth.prepare("tum", self.folder)


class Presets(unittest.TestCase):
    def test_cameras_and_classes_exist(self):
        for preset in presets.ALL.values():
            self.assertTrue((presets.ROOT / "configs" / "classes" / preset.classes).is_file())
            if preset.camera:
                camera = presets.camera_file(preset, pathlib.Path("nowhere"))
                self.assertTrue(camera.is_file(), camera)

    def test_each_tum_sequence_has_the_camera_of_its_number(self):
        self.assertEqual(len(presets.TUM), 9)
        for preset in presets.TUM:
            self.assertEqual(preset.camera, f"tum_fr{preset.name[2]}")
            self.assertIn(f"freiburg{preset.name[2]}_", preset.folder)
        model = {i: json.loads((presets.ROOT / "configs" / "cameras" / f"tum_fr{i}.json")
                               .read_text())["model"] for i in (1, 2, 3)}
        self.assertEqual(model, {1: "FULL_OPENCV", 2: "FULL_OPENCV", 3: "PINHOLE"})

    def test_published_figures_name_known_sequences(self):
        published = json.loads((ACCURACY / "published.json").read_text())
        self.assertLessEqual(published["ate"].keys(), presets.ALL.keys())
        for figures in published["ate"].values():
            self.assertLessEqual(figures.keys(), published["systems"].keys())

    def test_list_prints_every_archive_once(self):
        run = subprocess.run([ACCURACY / "fetch_kitti_raw.sh", "--list", "--to", "x"],
                             capture_output=True, text=True, check=True)
        self.assertEqual(len(run.stdout.splitlines()), 5)  # Four drives, one calibration.


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        unittest.main()
