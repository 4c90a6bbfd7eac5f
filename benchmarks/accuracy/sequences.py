"""What is known of each sequence: where its masks, references and true planes are."""

import dataclasses
import json
import pathlib

import planes

ROOT = pathlib.Path(__file__).resolve().parents[2]
CLASSES = ROOT / "configs" / "classes"


@dataclasses.dataclass
class Sequence:
    name: str
    folder: pathlib.Path
    references: list           # Trajectory files; the first one also aligns the planes.
    masks: dict                # name -> folder
    classes: pathlib.Path | None = None
    true_planes: list = dataclasses.field(default_factory=list)
    # Where no plane is known by itself: planes of this class are parallel in reality.
    parallel_class: str | None = None


def class_names(table):
    return {c["id"]: c["name"] for c in json.loads(table.read_text())["classes"]}


def redkitchen(folder):
    # The official trajectory is bent by some degrees, so planes are compared in the refined one.
    names = class_names(CLASSES / "coco.json")
    horizontal = {"table_top", "floor_carpet", "worktop"}
    objects = json.loads((folder / "objects.json").read_text())["objects"]
    planes = [{"name": o["name"], "class": names[o["category_id"]],
               "normal": o["plane_sfm"]["n"],
               "parallel": "horizontal" if o["name"] in horizontal else None}
              for o in objects if o.get("plane_reliable")]
    return Sequence("redkitchen", folder,
                    [folder / "trajectory_colour_sfm.txt", folder / "groundtruth.txt"],
                    {"clean": folder / "panoptic_clean", "noisy": folder / "panoptic_noisy"},
                    CLASSES / "coco.json", planes)


def kitti07(folder):
    return Sequence("kitti07", folder, [folder / "groundtruth.txt"],
                    {"clean": folder / "panoptic", "noisy": folder / "panoptic_noisy"},
                    CLASSES / "cityscapes.json", parallel_class="road")


def mh05(folder):
    return Sequence("mh05", folder, [folder / "groundtruth.txt"], {})


REAL = {"redkitchen": redkitchen, "kitti07": kitti07, "mh05": mh05}


def real_sequence(name, data):
    return REAL[name](data / name)


def synthetic_sequence(name, folder):
    """What s3-synth wrote, in the layout of redkitchen or of kitti07."""
    kitti = (folder / "image_0").is_dir()
    classes = CLASSES / ("cityscapes.json" if kitti else "coco.json")
    names = class_names(classes)
    objects = json.loads((folder / "objects.json").read_text())["objects"]
    true_planes, directions = [], []
    for o in objects:
        if not o.get("plane_reliable"):
            continue
        normal = o["plane_gt"]["n"]
        group = next((i for i, d in enumerate(directions) if planes.angle_deg(d, normal) < 0.1),
                     len(directions))
        if group == len(directions):
            directions.append(normal)
        # Things may share a name; the id does not repeat.
        true_planes.append({"name": f"{o['id']} {o['name']}", "class": names[o["category_id"]],
                            "normal": normal, "parallel": group})
    clean = folder / ("panoptic" if kitti else "panoptic_clean")
    return Sequence(name, folder, [folder / "groundtruth.txt"],
                    {"clean": clean, "noisy": folder / "panoptic_noisy"}, classes, true_planes)


SCENES = ["desk", "floor", "posters", "room", "street"]
