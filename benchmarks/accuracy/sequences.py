"""What is known of each sequence: where its masks, references and true planes are."""

import argparse
import dataclasses
import json
import os
import pathlib

import planes
import presets

ROOT = pathlib.Path(__file__).resolve().parents[2]
CLASSES = ROOT / "configs" / "classes"
CAMERAS = {"redkitchen": "seven_scenes_colour.json", "kitti07": "kitti_04-12.json",
           "mh05": "euroc_cam0.json"}


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
    camera: pathlib.Path | None = None  # Where the sequence brings none.
    slam: tuple = ()                    # Settings of s3-slam.
    road: bool = False                  # The camera is at one height above it.
    known_planes: pathlib.Path | None = None  # objects.json, and its frame.
    frame: str = "gt"


def preset_camera(name):
    """The known camera of a real sequence, as in a camera.json."""
    return json.loads((ROOT / "configs" / "cameras" / CAMERAS[name]).read_text())


def right_camera(sequence):
    """What the sequence brings, or the preset that says the same."""
    own = sequence.folder / "camera.json"
    return json.loads(own.read_text()) if own.exists() else preset_camera(sequence.name)


def num_focals(camera):
    return 1 if camera["model"] in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL") else 2


def class_names(table):
    return {c["id"]: c["name"] for c in json.loads(table.read_text())["classes"]}


def redkitchen(folder):
    # The official trajectory is bent by some degrees, so planes are compared in the refined one.
    names = class_names(CLASSES / "coco.json")
    horizontal = {"table_top", "floor_carpet", "worktop"}
    objects = json.loads((folder / "objects.json").read_text())["objects"]
    true_planes = [planes.true_plane(o["name"], names[o["category_id"]], o, "sfm",
                                      "horizontal" if o["name"] in horizontal else None)
                   for o in objects if o.get("plane_reliable")]
    return Sequence("redkitchen", folder,
                    [folder / "trajectory_colour_sfm.txt", folder / "groundtruth.txt"],
                    {"clean": folder / "panoptic_clean", "noisy": folder / "panoptic_noisy"},
                    CLASSES / "coco.json", true_planes,
                    known_planes=folder / "objects.json", frame="sfm")


def kitti07(folder):
    return Sequence("kitti07", folder, [folder / "groundtruth.txt"],
                    {"clean": folder / "panoptic", "noisy": folder / "panoptic_noisy"},
                    CLASSES / "cityscapes.json", parallel_class="road", road=True)


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
        true_planes.append(planes.true_plane(f"{o['id']} {o['name']}", names[o["category_id"]], o,
                                             "gt", group))
    clean = folder / ("panoptic" if kitti else "panoptic_clean")
    return Sequence(name, folder, [folder / "groundtruth.txt"],
                    {"clean": clean, "noisy": folder / "panoptic_noisy"}, classes, true_planes,
                    road=kitti, known_planes=folder / "objects.json")


SCENES = ["desk", "floor", "posters", "room", "street"]


def find_masks(folder):
    """Every panoptic* folder of a sequence: panoptic is "given", panoptic_NAME is NAME."""
    return {path.name.partition("_")[2] or "given": path
            for path in sorted(folder.glob("panoptic*")) if path.is_dir()}


def preset_sequence(preset, data):
    folder = data / preset.dataset / preset.folder
    return Sequence(preset.name, folder, [folder / "groundtruth.txt"], find_masks(folder),
                    CLASSES / preset.classes, parallel_class="road" if preset.road else None,
                    camera=presets.camera_file(preset, folder), slam=preset.slam, road=preset.road)


def all_names():
    return [*REAL, *SCENES, *presets.ALL]


def find(name, data, scenes):
    """A sequence by name; `scenes` is where rendered ones lie. Its folder may not be there."""
    if name in REAL:
        return REAL[name](data / name) if (data / name).is_dir() else Sequence(
            name, data / name, [], {})
    if name in presets.ALL:
        return preset_sequence(presets.ALL[name], data)
    if name in SCENES:
        folder = scenes / name
        # A folder alone may be one in which the scene is being rendered.
        rendered = (folder / "objects.json").is_file()
        return synthetic_sequence(name, folder) if rendered else Sequence(name, folder, [], {})
    raise KeyError(f"{name}: no such sequence; there are {', '.join(all_names())}")


def real_sequences_parser(description):
    """Of a script that runs the programs on the real sequences."""
    parser = argparse.ArgumentParser(description=description,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of the programs")
    parser.add_argument("--data", type=pathlib.Path, required=True,
                        help="folder of the real sequences")
    parser.add_argument("--sequences", nargs="+", choices=sorted(REAL), default=list(REAL))
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    return parser


def add_arguments(parser, seeds):
    """Options that choose real sequences or synthetic scenes."""
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--data", type=pathlib.Path, help="folder of the real sequences")
    what.add_argument("--synthetic", action="store_true", help="scenes made by s3-synth")
    parser.add_argument("--sequences", nargs="+", choices=sorted(REAL), default=list(REAL))
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    parser.add_argument("--seeds", nargs="+", type=int, default=seeds)


def of_runs(arguments):
    """Each chosen sequence and the folder that run.py wrote of it into `arguments.runs`."""
    if arguments.data:
        for name in arguments.sequences:
            yield real_sequence(name, arguments.data), arguments.runs / name
        return
    for scene in arguments.scenes:
        for seed in arguments.seeds:
            run = arguments.runs / f"{scene}_{seed}"
            yield synthetic_sequence(f"{scene} {seed}", run / "scene"), run
