#!/usr/bin/env python3
"""Writes the seeds of the fuzz targets: for each a few small inputs, most of them valid.

  make_seeds.py OUTPUT_DIR
"""
import io
import json
import os
import struct
import sys
import zipfile
import zlib


def camera_bin(id, model, params):
    return struct.pack("<IiQQ", id, model, 640, 480) + struct.pack(f"<{len(params)}d", *params)


def image_bin(id, name, keypoints):
    head = struct.pack("<I7dI", id, 1, 0, 0, 0, 0.1 * id, 0, 0, 1)
    points = b"".join(struct.pack("<ddQ", *k) for k in keypoints)
    return head + name + b"\0" + struct.pack("<Q", len(keypoints)) + points


def point_bin(id, track):
    head = struct.pack("<Q3d3Bd", id, 0.5, -0.25, 3.0, 10, 20, 30, 0.7)
    return head + struct.pack("<Q", len(track)) + b"".join(struct.pack("<II", *t) for t in track)


def counted(items):
    return struct.pack("<Q", len(items)) + b"".join(items)


NO_POINT = 2**64 - 1
CAMERAS = counted([camera_bin(1, 1, [500, 500, 320, 240]),
                   camera_bin(2, 2, [500, 320, 240, -0.03]),
                   camera_bin(3, 4, [500, 500, 320, 240, 0.1, -0.1, 0, 0]),
                   camera_bin(4, 5, [300, 300, 320, 240, 0, 0, 0, 0])])
IMAGES = counted([image_bin(1, b"a/1.png", [(10.5, 20.25, 7), (1, 2, NO_POINT)]),
                  image_bin(2, b"2.png", [(11.5, 21.25, 7)]), image_bin(3, b"3.png", [])])
POINTS = counted([point_bin(7, [(1, 0), (2, 0)])])

CAMERAS_TXT = b"""# Camera list
# Number of cameras: 2
1 PINHOLE 640 480 500 500 320 240
2 OPENCV 640 480 500 500.5 320 240 1e-1 -0.1 +0 0
"""
IMAGES_TXT = b"""# Number of images: 2, mean observations per image: 1.5
1 1 0 0 0 0.1 0 0 1 a/1.png
10.5 20.25 7 1 2 -1
2 0.5 0.5 0.5 0.5 0.2 -1e-3 0 1 with blank.png

"""
POINTS_TXT = b"""# Number of points: 1, mean track length: 2
7 0.5 -0.25 3 10 20 30 0.7 1 0 2 0
"""


def npy(dtype, order, shape, data, version=(1, 0)):
    header = f"{{'descr': '{dtype}', 'fortran_order': {order}, 'shape': {shape}, }}"
    header += " " * (-(10 + len(header) + 1) % 64) + "\n"
    return b"\x93NUMPY" + bytes(version) + struct.pack("<H", len(header)) + header.encode() + data


def npz(dtype, data, method=zipfile.ZIP_DEFLATED):
    """Probabilities of three classes in an image of 1 x 2 pixels."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        entry = zipfile.ZipInfo("probabilities.npy")
        entry.compress_type = method
        archive.writestr(entry, npy(dtype, False, (3, 1, 2), data))
    return file.getvalue()


def png(width, height, bits, colour_type, rows, extra=b""):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))

    raw = b"".join(b"\0" + row for row in rows)
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0)) +
            extra + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))


def palette_chunk(colours):
    data = b"".join(bytes(c) for c in colours)
    return (struct.pack(">I", len(data)) + b"PLTE" + data +
            struct.pack(">I", zlib.crc32(b"PLTE" + data)))


ONE = bytes([1, 0, 0])  # Segment 1 of the COCO folder, class 1 of KITTI-STEP.
TWO = bytes([7, 1, 0])
PNGS = {
    "rgb": png(3, 2, 8, 2, [ONE * 3, TWO * 3]),
    "rgba": png(2, 2, 8, 6, [(ONE + b"\xff") * 2, (TWO + b"\xff") * 2]),
    "palette": png(4, 1, 8, 3, [bytes([0, 1, 0, 1])], palette_chunk([ONE, TWO])),
    "palette_2_bits": png(4, 1, 2, 3, [bytes([0b00010001])], palette_chunk([ONE, TWO])),
    "gray": png(2, 2, 8, 0, [b"\1\1", b"\7\7"]),
    "gray_1_bit": png(8, 1, 1, 0, [b"\xaa"]),
    "gray_alpha": png(1, 1, 8, 4, [b"\1\xff"]),
    "gray_16_bits": png(1, 1, 16, 0, [b"\0\1"]),
    "rgb_16_bits": png(1, 1, 16, 2, [b"\0\1\0\0\0\0"]),
    "one_pixel": png(1, 1, 8, 2, [ONE]),
    "claims_a_gigapixel": png(32000, 32000, 8, 2, [ONE]),
    "ends_early": png(3, 200, 8, 2, [ONE * 3]),
}
NETPBM = {"pgm": b"P5 2 2 255\n\0\1\2\3", "ppm": b"P6\n# c\n1 1 255\n\1\2\3",
          "pgm_cut": b"P5 30 30 255\n\0"}
# 8 x 8, gray, quality 75.
JPEG = bytes.fromhex(
    "ffd8ffe000104a46494600010101000000000000ffdb004300080606070605080707070909080a0c140d0c0b0b0c19"
    "12130f141d1a1f1e1d1a1c1c20242e2720222c231c1c2837292c30313434341f27393d38323c2e333432ffc0000b"
    "080008000801011100ffc4001f0000010501010101010100000000000000000102030405060708090a0bffc400b5"
    "100002010303020403050504040000017d01020300041105122131410613516107227114328191a1082342b1c115"
    "52d1f02433627282090a161718191a25262728292a3435363738393a434445464748494a535455565758595a6364"
    "65666768696a737475767778797a838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5b6b7"
    "b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae1e2e3e4e5e6e7e8e9eaf1f2f3f4f5f6f7f8f9faffda000801"
    "0100003f00f928a28affd9")

CLASS = {"id": 1, "name": "book", "thing": True, "planar": True, "dynamic": False,
         "min_plane_inliers": 20, "orientation": "any", "color": [1, 2, 3]}
STUFF = {"id": 7, "name": "wall", "thing": False, "planar": True, "dynamic": False,
         "color": [255, 0, 0]}
TABLE = {"name": "small", "classes": [CLASS, STUFF]}
PLANE = {"id": 0, "cluster_id": 4, "class_id": 1, "class": "book", "normal_in_world": [0, 0, 1],
         "offset": -2.5, "centroid_in_world": [0, 0, 2.5], "axis_u_in_world": [1, 0, 0],
         "axis_v_in_world": [0, 1, 0], "extent_uv": [[0, 0], [1, 0], [0, 1]], "rms": 0.1,
         "rms_sigma": 1.0, "covariance": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "inliers": [3]}
SEMANTICS = {"format": "s3lam-semantics", "version": 1, "model_fingerprint": "1-2-3",
             "class_table": TABLE, "points": [3, 9], "num_mask_observations": [2, 0],
             "cluster_of_point": [4, None], "planes": [PLANE],
             "clusters": [{"id": 4, "class_id": 1, "class": "book", "centroid_in_world": [0, 0, 1],
                           "points": [3], "segments": [[1, 263]]}]}
COCO = {"annotations": [{"file_name": "a.png", "image_id": 1, "segments_info": [
    {"id": 1, "category_id": 1, "iscrowd": 0, "area": 3, "bbox": [0, 0, 1, 1]},
    {"id": 263, "category_id": 7, "score": 0.25}]}]}
CAMERA = {"model": "SIMPLE_RADIAL", "width": 640, "height": 480,
          "params": [523.2, 319.8, 246.1, -0.0286], "fps": 30}
CONFIG = {"enabled": False, "name": "y", "names": ["b", "c"], "numbers": [1, 2.5e-3],
          "inner": {"count": 5, "size": 0.25, "mode": "on"}}
SENSOR = b"""# a camera
sensor_type: camera
resolution: [752, 480]
intrinsics: [458.654, 457.296,
  367.215, 248.375] # fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]
"""


def text(document):
    return json.dumps(document).encode()


DEEP = b"[" * 100000
def exif(order, tags):
    """A JPEG file's beginning with these tags, (tag, type, number or pair), in its EXIF data."""
    tiff = (b"II" if order == "<" else b"MM") + struct.pack(
        order + "HIHHHIII", 42, 8, 1, 0x8769, 4, 1, 26, 0)
    entries, values = b"", b""
    for tag, kind, value in tags:
        entries += struct.pack(order + "HHI", tag, kind, 1)
        if kind == 5:
            entries += struct.pack(order + "I", 26 + 2 + 12 * len(tags) + 4 + len(values))
            values += struct.pack(order + "II", *value)
        else:
            entries += struct.pack(order + ("HH" if kind == 3 else "I"), *([value, 0][:4 - kind + 1]))
    tiff += struct.pack(order + "H", len(tags)) + entries + bytes(4) + values
    segment = b"Exif\0\0" + tiff
    return b"\xff\xd8\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + b"\xff\xd9"


SEEDS = {
    "cameras_bin": {"cameras": CAMERAS, "claims_many": struct.pack("<Q", 2**60) + CAMERAS[8:]},
    "images_bin": {"images": IMAGES, "escapes": counted([image_bin(1, b"../1.png", [])]),
                   "absolute": counted([image_bin(1, b"/etc/1.png", [])])},
    "points_bin": {"points": POINTS, "claims_many": struct.pack("<Q", 2**61) + POINTS[8:]},
    "cameras_txt": {"cameras": CAMERAS_TXT},
    "images_txt": {"images": IMAGES_TXT, "no_comment": IMAGES_TXT.split(b"\n", 1)[1]},
    "points_txt": {"points": POINTS_TXT},
    "whole_model": {"model": b"".join(struct.pack("<H", len(f)) + f
                                      for f in (CAMERAS, IMAGES, POINTS))},
    "descriptors": {"two": b"S3DESC01" + counted([struct.pack("<Q", i) + bytes(range(32))
                                                  for i in (3, 9)]),
                    "version": b"S3DESC02" + counted([])},
    "npy": {"two": npy("<f4", False, (2, 3), struct.pack("<6f", *range(6))),
            "empty": npy("<f4", False, (0, 7), b""),
            "double": npy("<f8", False, (1, 1), bytes(8)),
            "overflow": npy("<f4", False, (2**62, 4), b""),
            "version_2": npy("<f4", False, (0, 7), b"", (2, 0))},
    "trajectory": {"tum": b"# Number of poses: 2\n# t\n0 0 0 0 0 0 0 1\n0.5 1 2 3 0.5 0.5 0.5 0.5\n",
                   "kitti": b"1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1e-1 0 1 0 0 0 0 1 0\n",
                   "nan": b"0 nan 0 0 0 0 0 1\n"},
    "class_table": {"small": text(TABLE)},
    "camera_json": {"simple_radial": text(CAMERA), "too_large": b'{"width": 1e999}',
                    "deep": DEEP},
    "config_json": {"all": text(CONFIG), "deep": b'{"name": ' + DEEP},
    "set_argument": {"nested": b"inner.count=7", "text": b"name=hello", "list": b"numbers=[1,2]",
                     "large": b"inner.size=1e999", "bytes": b"inner.mode=\xff\xfe"},
    "frame_range": {"all": b"3:100:2", "open": b":"},
    "semantics_json": {"small": text(SEMANTICS), "version_0": text(SEMANTICS | {"version": 0})},
    "coco_json": {"one": text(COCO), "deep_score": b'{"annotations": [{"file_name": "a.png", '
                  b'"segments_info": [{"id": 1, "category_id": 1, "score": ' + b"[" * 50 +
                  b"]" * 50 + b"}]}]}"},
    "coco_png": PNGS,
    "kitti_step_png": PNGS,
    "cityscapes_png": PNGS | {"ids": png(2, 1, 16, 0, [struct.pack(">HH", 7, 1001)])},
    "labels_png": PNGS,
    "divisor_npy": {"int32": npy("<i4", False, (2, 2), struct.pack("<4i", 7000, 1001, -1, 0)),
                    "version_2": npy("<i2", False, (1, 1), bytes(2), (2, 0))},
    "volume_npz": {"float": npz("<f4", struct.pack("<6f", 1, 0, 0, 1, 0, 0)),
                   "stored": npz("|u1", bytes([255, 0, 0, 255, 0, 0]), zipfile.ZIP_STORED)},
    "segments_json": {"detectron": text({"segments_info": [
        {"id": 1, "category_id": 1, "isthing": True, "score": 0.5},
        {"id": 263, "category_id": 7, "isthing": False}]}),
        "hugging_face": text({"segments_info": [
            {"id": 1, "label_id": 1, "was_fused": False,
             "distribution": {"1": 0.75, "7": 0.25}}, {"id": 263, "label_id": 7}]})},
    "label_map": {"json": text({"1": 7, "2": None}),
                  "apart": text({"things": {"1": 7}, "stuff": {"0": None, "1": 1}})},
    "observations": {"two": b"S3OBSV01" + counted(
        [struct.pack("<dIQQfff", t, 1, 1, 7, 1.5, 2.5, 0.5) for t in (0.0, 0.5)])},
    "keypoint_sigmas": {"two": b"S3KSIG01" + counted(
        [struct.pack("<IQff", i, 2, 0.5, 1.25) for i in (1, 4)])},
    "image_file": PNGS | NETPBM | {"jpeg": JPEG},
    "exif": {"film": exif("<", [(0xA405, 3, 28)]),
             "plane": exif(">", [(0x920A, 5, (50, 10)), (0xA002, 4, 4000),
                                 (0xA20E, 5, (4000, 1)), (0xA210, 3, 3)])},
    "tum_list": {"three": b"# t path\n0.1 rgb/0.png\n0.2 rgb/1.png\n0.3 rgb/2.png\n",
                 "escapes": b"0.1 ../rgb/0.png\n0.2 rgb/1.png\n"},
    "kitti_times": {"three": b"0\n1.0e-1\n2.0e-1\n"},
    "kitti_calib": {"p0": b"P0: 700 0 600 0 0 700 180 0 0 0 1 0\ncalib_time: 09-Jan-2012 13:57:47\n"},
    "kitti_raw_times": {"three": b"2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.06\n"
                                 b"2011-09-26 13:02:26.2\n"},
    "euroc_list": {"three": b"#timestamp [ns],filename\n1403636579763555584,0.png\n"
                            b"1403636579813555456,1.png\r\n1403636579863555584,2.png\n"},
    "euroc_sensor": {"radtan": SENSOR,
                     "equidistant": SENSOR.replace(b"radial-tangential", b"equidistant")},
}


def main():
    root = sys.argv[1]
    for target, seeds in SEEDS.items():
        os.makedirs(os.path.join(root, target), exist_ok=True)
        for name, content in seeds.items():
            with open(os.path.join(root, target, name), "wb") as file:
                file.write(content)


if __name__ == "__main__":
    main()
