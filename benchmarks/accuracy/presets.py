"""The sequences of the public data sets: where they come from, and with which camera they run."""

import dataclasses
import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[2]


@dataclasses.dataclass(frozen=True)
class Archive:
    """A file of the original site, and what it leaves when unpacked in the data set's folder.

    Sizes and checksums are None where no public source states them; they are recorded, then, when
    the archive is first there (downloaded.json).
    """

    url: str
    into: str = "."          # Where it is unpacked, relative to the data set's folder.
    size: int | None = None  # [bytes]
    sha256: str | None = None

    @property
    def name(self):
        return self.url.rsplit("/", 1)[1]


@dataclasses.dataclass(frozen=True)
class Preset:
    name: str                # As in tables and on the command line.
    dataset: str             # Name of its folder, and of its fetch script.
    folder: str              # Of the sequence, relative to the data set's folder.
    archives: tuple          # All that it needs.
    classes: str             # Class table that masks of it are likely to have.
    camera: str | None = None  # configs/cameras/<camera>.json, where the data bring none.
    slam: tuple = ()         # Settings of s3-slam.
    road: bool = False       # A camera at one height above a road, the planes that are parallel.


def _tum(name, short, size=None, sha256=None, slam=()):
    number = short[2]
    archive = Archive(f"https://cvg.cit.tum.de/rgbd/dataset/freiburg{number}/{name}.tgz", size=size,
                      sha256=sha256)
    return Preset(short, "tum", name, (archive,), "coco.json", camera=f"tum_fr{number}",
                  slam=slam)


# The paper's ten rows. Its fr3_nostructure_texture_near is the one "with loop": one row closes it, two
# do not, of which one takes all books for one plane (a column of its own in our tables).
_WITH_LOOP = "rgbd_dataset_freiburg3_nostructure_texture_near_withloop"
TUM = [
    # Sizes and SHA-256 as several independent users of the data set state them.
    _tum("rgbd_dataset_freiburg1_xyz", "fr1_xyz", 448204271,
         "a0236d97b8c30cd93b653656d2b6c293ff7c982a4130ef2a1a8beecdb124ef98"),
    _tum("rgbd_dataset_freiburg1_floor", "fr1_floor"),
    _tum("rgbd_dataset_freiburg1_desk", "fr1_desk", 344011403,
         "e983d6830916e66dc4a46a71368046b149b283de87769690e7aa4e0b9483530c"),
    _tum("rgbd_dataset_freiburg2_xyz", "fr2_xyz"),
    _tum("rgbd_dataset_freiburg2_desk", "fr2_desk"),
    _tum(_WITH_LOOP, "fr3_nstr_tex_near"),
    _tum(_WITH_LOOP, "fr3_nstr_tex_near_no_loop", slam=("loops.enabled=false",)),
    _tum("rgbd_dataset_freiburg3_structure_texture_near", "fr3_str_tex_near"),
    _tum("rgbd_dataset_freiburg3_structure_texture_far", "fr3_str_tex_far"),
]

_KITTI = "https://s3.eu-central-1.amazonaws.com/avg-kitti"
_DAY = "2011_09_26"
_KITTI_CALIBRATION = Archive(f"{_KITTI}/raw_data/{_DAY}_calib.zip", size=4068)
# More features, as is usual for images this wide.
_WIDE = ("features.num_features=2000",)


def _kitti_raw(number, size):
    drive = f"{_DAY}_drive_{number}"
    archive = Archive(f"{_KITTI}/raw_data/{drive}/{drive}_sync.zip", size=size)
    return Preset(f"kitti_raw_{number}", "kitti-raw", f"{_DAY}/{drive}_sync",
                  (archive, _KITTI_CALIBRATION), "cityscapes.json", slam=_WIDE, road=True)


KITTI_RAW = [_kitti_raw("0011", 939815328), _kitti_raw("0013", 630044598),
             _kitti_raw("0014", 1261710548), _kitti_raw("0056", 1214030003)]

# Archives that hold all sequences, below dataset/.
_ODOMETRY = tuple(Archive(f"{_KITTI}/data_odometry_{part}.zip") for part in
                  ("gray", "calib", "poses"))
KITTI_ODOMETRY = [Preset(f"kitti_{i:02d}", "kitti-odometry", f"dataset/sequences/{i:02d}", _ODOMETRY,
                         "cityscapes.json", slam=_WIDE, road=True) for i in range(11)]


def _euroc(name, place):
    base = "http://robotics.ethz.ch/~asl-datasets/ijrr_euroc_mav_dataset"
    return Preset(name, "euroc", name, (Archive(f"{base}/{place}/{name}/{name}.zip", into=name),),
                  "coco.json")


EUROC = [_euroc(name, "machine_hall") for name in
         ("MH_01_easy", "MH_02_easy", "MH_03_medium", "MH_04_difficult", "MH_05_difficult")]
EUROC += [_euroc(f"V{room}_0{i}_{level}", f"vicon_room{room}") for room in (1, 2)
          for i, level in ((1, "easy"), (2, "medium"), (3, "difficult"))]


def _seven_scenes(scene, size):
    base = "http://download.microsoft.com/download/2/8/5/28564B23-0828-408F-8631-23B1EFF1DAC8"
    # The archive of a scene holds one archive per sequence.
    return Preset(f"7scenes_{scene}", "7-scenes", f"{scene}/seq-01",
                  (Archive(f"{base}/{scene}.zip", size=size),), "coco.json",
                  camera="seven_scenes_colour")


SEVEN_SCENES = [_seven_scenes(scene, size) for scene, size in (
    ("chess", 3079608937), ("fire", 2301204154), ("heads", 956332240), ("office", 4707873861),
    ("pumpkin", 2890874911), ("redkitchen", 6141181406), ("stairs", 1496412431))]

DATASETS = {"tum": TUM, "kitti-raw": KITTI_RAW, "kitti-odometry": KITTI_ODOMETRY, "euroc": EUROC,
            "7-scenes": SEVEN_SCENES}
ALL = {preset.name: preset for presets in DATASETS.values() for preset in presets}


def camera_file(preset, folder):
    """What to give s3-slam as --camera: nothing where the sequence has or is given its own."""
    if preset.camera is None or (folder / "camera.json").exists():
        return None
    return ROOT / "configs" / "cameras" / f"{preset.camera}.json"
