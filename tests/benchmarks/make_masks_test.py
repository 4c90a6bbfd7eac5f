#!/usr/bin/env python3
"""The part of make_masks.py that needs no network: encoding, annotations, distributions."""

import importlib.util
import json
import os
import pathlib
import struct
import sys
import tempfile
import unittest
import zlib

SKIPPED = 77  # What ctest takes for skipped.
SYSTEM_PYTHON = "/usr/bin/python3"
if importlib.util.find_spec("numpy") is None:
    if sys.executable != SYSTEM_PYTHON and os.path.exists(SYSTEM_PYTHON):
        os.execv(SYSTEM_PYTHON, [SYSTEM_PYTHON, *sys.argv])
    print("skipped: python3 has no numpy")
    sys.exit(SKIPPED)

import numpy as np  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks" / "accuracy"))

import make_masks  # noqa: E402


def read_png(path):
    """An 8-bit RGB PNG without filters, as pixels."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    offset, chunks = 8, {}
    while offset < len(data):
        (size,) = struct.unpack_from(">I", data, offset)
        kind, body = data[offset + 4:offset + 8], data[offset + 8:offset + 8 + size]
        (checksum,) = struct.unpack_from(">I", data, offset + 8 + size)
        assert checksum == zlib.crc32(kind + body)
        chunks[kind] = body
        offset += 12 + size
    width, height = struct.unpack_from(">II", chunks[b"IHDR"])
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, -1)
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(height, width, 3)


def read_ids(path):
    pixels = read_png(path).astype(np.int64)
    return pixels[..., 0] + 256 * pixels[..., 1] + 65536 * pixels[..., 2]


SEGMENTATION = np.array([[0, 7, 7, 3], [0, 7, 3, 3], [-1, 7, 3, 9]])
SEGMENTS = [{"id": 7, "label": 1, "score": 0.9}, {"id": 3, "label": 0, "score": 0.5},
            {"id": 5, "label": 1, "score": 0.8}]  # 9 is not listed, of 5 nothing is left.
CLASS_IDS = [67, 84]


class Encoding(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_ids_come_back_from_the_file(self):
        ids = np.array([[0, 1, 255], [256, 70000, (1 << 24) - 1]])
        make_masks.write_png(self.folder / "a.png", make_masks.encode_ids(ids))
        np.testing.assert_array_equal(read_ids(self.folder / "a.png"), ids)
        with self.assertRaises(ValueError):
            make_masks.encode_ids([[1 << 24]])

    def test_annotation_has_what_coco_has(self):
        pixels, annotation = make_masks.annotation("a.png", SEGMENTATION, SEGMENTS, CLASS_IDS)
        make_masks.write_png(self.folder / "a.png", pixels)
        np.testing.assert_array_equal(read_ids(self.folder / "a.png"),
                                      [[0, 2, 2, 1], [0, 2, 1, 1], [0, 2, 1, 0]])
        by_id = {s["id"]: s for s in annotation["segments_info"]}
        self.assertEqual(by_id.keys(), {1, 2})
        self.assertEqual((by_id[2]["category_id"], by_id[1]["category_id"]), (84, 67))
        self.assertEqual(by_id[2]["bbox"], [1, 0, 2, 3])
        self.assertEqual(by_id[1]["area"], 4)
        self.assertEqual(by_id[2]["score"], 0.9)

    def test_distribution_sums_to_one_over_classes(self):
        made = make_masks.distribution([0.7, 0.2, 0.099, 0.001], [67, 84, 67, 1])
        self.assertEqual(made.keys(), {"67", "84"})
        self.assertAlmostEqual(sum(made.values()), 1.0, places=12)
        self.assertAlmostEqual(made["67"], 0.799 / 0.999)

    def test_distributions_come_from_the_queries_of_the_segment(self):
        classes = np.array([[0.6, 0.4], [0.1, 0.9], [0.3, 0.7]])
        masks = np.zeros((3, *SEGMENTATION.shape))
        masks[0][SEGMENTATION == 3] = 1.0
        masks[1][SEGMENTATION == 7] = 1.0
        masks[2][SEGMENTATION == 0] = 1.0  # Lies elsewhere: does not count.
        found = make_masks.segment_distributions(SEGMENTATION, SEGMENTS[:2], classes, masks)
        np.testing.assert_allclose(found[7], [0.1, 0.9])
        np.testing.assert_allclose(found[3], [0.6, 0.4])

    def test_class_table_is_found_by_name(self):
        classes = make_masks.Classes(ROOT / "configs" / "classes" / "coco.json")
        self.assertEqual(classes.id_of("Dining Table"), 67)
        self.assertEqual(classes.ids_of(["wall-other-merged", "book"]), [199, 84])
        with self.assertRaisesRegex(SystemExit, "no hovercraft"):
            classes.ids_of(["book", "hovercraft"])

    def test_folder_is_done_once(self):
        class Network:
            class_ids = CLASS_IDS
            runs = []

            def run(self, path, with_distributions):
                self.runs.append(path.name)
                return SEGMENTATION, SEGMENTS, {7: [0.2, 0.8], 3: [0.9, 0.1]}

        classes = make_masks.Classes(ROOT / "configs" / "classes" / "coco.json")
        network, output = Network(), self.folder / "panoptic"
        images = [self.folder / "b.jpg", self.folder / "a.jpg"]
        make_masks.process(network, classes, images[:1], output, True)
        make_masks.process(network, classes, images, output, True)
        self.assertEqual(network.runs, ["b.jpg", "a.jpg"])
        document = json.loads((self.folder / "panoptic.json").read_text())
        self.assertEqual([a["file_name"] for a in document["annotations"]], ["a.png", "b.png"])
        infos = document["annotations"][0]["segments_info"]
        self.assertEqual(infos[0]["distribution"], {"67": 0.2, "84": 0.8})
        self.assertTrue((output / "a.png").exists())


if __name__ == "__main__":
    unittest.main()
