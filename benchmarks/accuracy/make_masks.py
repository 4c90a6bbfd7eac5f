#!/usr/bin/env python3
"""Panoptic masks of a folder of images, by a network: COCO panoptic PNGs and their JSON.

Beside the stages, which never run a network: this is one way to get what s3-lift reads. Needs numpy
and, for a model of Hugging Face, torch, transformers and Pillow; for one of detectron2, torch,
detectron2 and OpenCV. Weights are downloaded by those libraries.

  make_masks.py --images rgb --output panoptic --classes configs/classes/coco.json
  make_masks.py --images rgb --output panoptic --classes configs/classes/coco.json --detectron2 \\
      --model COCO-PanopticSegmentation/panoptic_fpn_R_101_3x.yaml

Writes <output>/<name>.png and <output>.json. Images whose mask is there are skipped, so an
interrupted run goes on; --names takes the images to do from a file (e.g. only the keyframes).
"""

import argparse
import json
import pathlib
import struct
import sys
import zlib

import numpy as np

IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}
MIN_PROBABILITY = 0.005  # Less is left out of a distribution.


# ---- encoding: needs neither weights nor images ----------------------------------------------------


class Classes:
    """A class table of this project, by name."""

    def __init__(self, path):
        table = json.loads(pathlib.Path(path).read_text())
        self.categories = [{"id": c["id"], "name": c["name"], "isthing": int(c["thing"])}
                           for c in table["classes"]]
        self._id_of = {self._plain(c["name"]): c["id"] for c in table["classes"]}

    @staticmethod
    def _plain(name):
        return "".join(c for c in name.lower() if c.isalnum())

    def id_of(self, name):
        """Throws KeyError for a name the table does not have."""
        return self._id_of[self._plain(name)]

    def ids_of(self, names):
        """Class id of each label 0, 1, ... of a network; an error names all that are missing."""
        missing = [name for name in names if self._plain(name) not in self._id_of]
        if missing:
            sys.exit(f"the class table has no {', '.join(missing)}: another table fits this model")
        return [self.id_of(name) for name in names]


def encode_ids(ids):
    """COCO panoptic: id = R + 256 G + 65536 B, 0 is void."""
    ids = np.asarray(ids)
    if ids.min(initial=0) < 0 or ids.max(initial=0) >= 1 << 24:
        raise ValueError("segment ids must be in [0, 2^24)")
    ids = ids.astype(np.uint32)
    return np.stack([ids & 255, ids >> 8 & 255, ids >> 16 & 255], axis=-1).astype(np.uint8)


def write_png(path, rgb):
    """8-bit RGB, whole or not at all."""
    height, width, _ = rgb.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), rgb.reshape(height, -1)], axis=1)

    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data +
                struct.pack(">I", zlib.crc32(kind + data)))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    beside = path.with_name(path.name + ".tmp")
    beside.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) +
                       chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)) + chunk(b"IEND", b""))
    beside.replace(path)


def segment_ids(segmentation):
    """The ids of a network's map as 1, 2, ..., void (0 or below, by convention) as 0."""
    found = [int(i) for i in np.unique(segmentation) if i > 0]
    ids = np.zeros(segmentation.shape, np.uint32)
    for new, old in enumerate(found, start=1):
        ids[segmentation == old] = new
    return ids, {old: new for new, old in enumerate(found, start=1)}


def annotation(file_name, segmentation, segments, class_ids, distributions=None):
    """PNG pixels and COCO annotation of one image.

    `segments` has {id, label, score}, label being the network's (0, 1, ...) and `class_ids` what it
    is in the class table; `distributions` has per segment id the probabilities of all labels.
    """
    ids, renamed = segment_ids(np.asarray(segmentation))
    infos = []
    for segment in segments:
        if segment["id"] not in renamed:
            continue  # Nothing of it is left.
        rows, columns = np.nonzero(ids == renamed[segment["id"]])
        x, y = int(columns.min()), int(rows.min())
        info = {"id": renamed[segment["id"]], "category_id": class_ids[segment["label"]],
                "iscrowd": 0, "area": len(rows),
                "bbox": [x, y, int(columns.max()) - x + 1, int(rows.max()) - y + 1],
                "score": round(min(1.0, max(0.0, float(segment["score"]))), 6)}
        if distributions is not None:
            info["distribution"] = distribution(distributions[segment["id"]], class_ids)
        infos.append(info)
    known = {info["id"] for info in infos}
    ids[~np.isin(ids, list(known))] = 0
    return encode_ids(ids), {"file_name": file_name, "segments_info": infos}


def distribution(probabilities, class_ids):
    """{class id: probability}, small ones left out, the rest summing to one."""
    by_class = {}
    for label, p in enumerate(np.asarray(probabilities, np.float64)):
        by_class[class_ids[label]] = by_class.get(class_ids[label], 0.0) + float(p)
    most = max(by_class.values())
    kept = {c: p for c, p in by_class.items() if p >= MIN_PROBABILITY or p == most}
    total = sum(kept.values())
    return {str(c): p / total for c, p in sorted(kept.items())}


def segment_distributions(segmentation, segments, class_probabilities, mask_probabilities):
    """What a mask-classification network thought of each segment.

    `class_probabilities` is queries x labels (without "no object"), `mask_probabilities` queries x
    rows x columns. A segment's distribution is the mean of the queries whose likeliest label it has,
    weighted by how much of their masks lies in it.
    """
    likeliest = class_probabilities.argmax(1)
    distributions = {}
    for segment in segments:
        inside = segmentation == segment["id"]
        queries = np.flatnonzero(likeliest == segment["label"])
        weights = np.array([mask_probabilities[q][inside].sum() /
                            max(mask_probabilities[q].sum(), 1e-9) for q in queries])
        if weights.sum() > 0:
            mean = (weights[:, None] * class_probabilities[queries]).sum(0) / weights.sum()
            mean = mean / mean.sum()
        else:
            mean = np.eye(class_probabilities.shape[1])[segment["label"]]
        distributions[segment["id"]] = mean
    return distributions


# ---- networks --------------------------------------------------------------------------------------


class HuggingFace:
    """MaskFormer, Mask2Former, OneFormer, ... of transformers."""

    DEFAULT = "facebook/mask2former-swin-large-coco-panoptic"

    def __init__(self, name, classes, device):
        import torch
        import transformers

        self._torch, self._device = torch, device
        self._processor = transformers.AutoImageProcessor.from_pretrained(name)
        self._model = transformers.AutoModelForUniversalSegmentation.from_pretrained(name)
        self._model.to(device).eval()
        names = [self._model.config.id2label[i] for i in range(len(self._model.config.id2label))]
        self.class_ids = classes.ids_of(names)

    def run(self, path, with_distributions):
        from PIL import Image

        image = Image.open(path).convert("RGB")
        size = (image.height, image.width)
        inputs = self._processor(images=image, return_tensors="pt").to(self._device)
        with self._torch.no_grad():
            outputs = self._model(**inputs)
        result = self._processor.post_process_panoptic_segmentation(
            outputs, target_sizes=[size])[0]
        segmentation = result["segmentation"].cpu().numpy().astype(np.int64)
        # Void is -1 or 0, by version; segments may be numbered from 0 then.
        segments = [{"id": s["id"] + 1, "label": s["label_id"], "score": s["score"]}
                    for s in result["segments_info"]]
        listed = np.isin(segmentation, [s["id"] - 1 for s in segments])
        segmentation = np.where(listed, segmentation + 1, 0)
        if not with_distributions:
            return segmentation, segments, None
        probabilities = outputs.class_queries_logits[0].softmax(-1)[:, :-1].cpu().numpy()
        masks = self._torch.nn.functional.interpolate(
            outputs.masks_queries_logits, size=size, mode="bilinear", align_corners=False)
        return segmentation, segments, segment_distributions(
            segmentation, segments, probabilities, masks[0].sigmoid().cpu().numpy())


class Detectron2:
    """Panoptic FPN and others of detectron2's model zoo. It gives no distributions."""

    DEFAULT = "COCO-PanopticSegmentation/panoptic_fpn_R_101_3x.yaml"

    def __init__(self, name, classes, device):
        from detectron2 import model_zoo
        from detectron2.config import get_cfg
        from detectron2.data import MetadataCatalog
        from detectron2.engine import DefaultPredictor

        config = get_cfg()
        config.merge_from_file(model_zoo.get_config_file(name))
        config.MODEL.WEIGHTS = model_zoo.get_checkpoint_url(name)
        config.MODEL.DEVICE = device
        self._predictor = DefaultPredictor(config)
        metadata = MetadataCatalog.get(config.DATASETS.TRAIN[0])
        # Its category_id is contiguous within things and within stuff.
        self._things = len(metadata.thing_classes)
        self.class_ids = classes.ids_of(list(metadata.thing_classes) +
                                        list(metadata.stuff_classes))

    def run(self, path, with_distributions):
        import cv2

        if with_distributions:
            sys.exit("--distributions: detectron2's panoptic models give none")
        segmentation, infos = self._predictor(cv2.imread(str(path)))["panoptic_seg"]
        segments = [{"id": s["id"], "score": s.get("score", 1.0),
                     "label": s["category_id"] + (0 if s["isthing"] else self._things)}
                    for s in infos]
        return segmentation.cpu().numpy(), segments, None


# ---- the folder ------------------------------------------------------------------------------------


def list_images(folder, names_file):
    if names_file is not None:
        return [folder / line.strip() for line in names_file.read_text().splitlines()
                if line.strip()]
    return sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGES)


def write_document(path, classes, annotations):
    document = {"categories": classes.categories,
                "annotations": [annotations[name] for name in sorted(annotations)]}
    beside = path.with_name(path.name + ".tmp")
    beside.write_text(json.dumps(document) + "\n")
    beside.replace(path)


def process(network, classes, images, output, with_distributions):
    """Runs the network over what is not done yet; the JSON is kept up to date on the way."""
    document = output.with_name(output.name + ".json")
    annotations = {}
    if document.exists():
        annotations = {a["file_name"]: a
                       for a in json.loads(document.read_text())["annotations"]}
    output.mkdir(parents=True, exist_ok=True)
    for count, image in enumerate(images, start=1):
        name = image.stem + ".png"
        if name in annotations and (output / name).exists():
            continue
        segmentation, segments, distributions = network.run(image, with_distributions)
        pixels, annotations[name] = annotation(name, segmentation, segments, network.class_ids,
                                               distributions)
        write_png(output / name, pixels)
        write_document(document, classes, annotations)
        print(f"\r{count}/{len(images)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--classes", type=pathlib.Path, required=True, help="class table")
    parser.add_argument("--names", type=pathlib.Path, help="file with the images to do")
    parser.add_argument("--model", help=f"default: {HuggingFace.DEFAULT}")
    parser.add_argument("--detectron2", action="store_true", help="the model is detectron2's")
    parser.add_argument("--distributions", action="store_true",
                        help="write each segment's class distribution too")
    parser.add_argument("--device", default="cpu", help="cpu, cuda, ...")
    arguments = parser.parse_args()
    classes = Classes(arguments.classes)
    images = list_images(arguments.images, arguments.names)
    if not images:
        sys.exit(f"{arguments.images}: no images")
    kind = Detectron2 if arguments.detectron2 else HuggingFace
    network = kind(arguments.model or kind.DEFAULT, classes, arguments.device)
    process(network, classes, images, arguments.output, arguments.distributions)


if __name__ == "__main__":
    main()
