#!/usr/bin/env python3
"""The real sequences as worse cameras would have taken them: what s3-slam makes of them.

Makes copies of each sequence with its images changed - strongly compressed, blurred, noisy, dark,
small, of a narrow field of view, with a large textured object passing by - and prints, per sequence, a
Markdown table of the frames localised, the trajectory error (RMSE after Sim(3) alignment), the share of
frames in doubt, and the same without mapping again from another start (remapping.max_attempts=0).
Needs numpy and Pillow.

  variants.py --bin ../../build/bin --data DIR [--sequences kitti07] [--variants compressed narrow]
"""

import io
import multiprocessing
import pathlib
import sys
import tempfile

import numpy
from PIL import Image, ImageFilter

import sequences
import stages
import tables

NO_REMAPPING = ["remapping.max_attempts=0"]
IMAGE_SUFFIXES = {".jpg", ".png"}


def pixels(change):
    """A change of gray or colour values, index -> values, as a change of an image."""
    def apply(image, index):
        values = change(numpy.asarray(image, dtype=numpy.float32), index)
        return Image.fromarray(values.clip(0, 255).astype(numpy.uint8))
    return apply


def compressed(image, _):
    data = io.BytesIO()
    image.save(data, "JPEG", quality=15)
    return Image.open(data)


def noisy(values, index):
    return values + numpy.random.default_rng(index).normal(0.0, 8.0, values.shape)


def dark(values, index):
    return values * 0.25 * (1.0 + 0.5 * numpy.sin(index / 15.0))


def narrow(image, _):
    width, height = image.size
    left, top = width // 4, height // 4
    return image.crop((left, top, left + width // 2, top + height // 2))


def occluded(image, index):
    """A mirrored part of the image itself, two fifths wide and half as high, crosses it."""
    width, height = image.size
    wide, high = width * 2 // 5, height // 2
    patch = image.crop((width // 4, height // 4, width // 4 + wide, height // 4 + high))
    left = index * 7 % (width + 2 * wide) - wide
    result = image.copy()
    result.paste(patch.transpose(Image.Transpose.FLIP_LEFT_RIGHT), (left, height * 3 // 10))
    return result


def scaled(factor):
    def apply(image, _):
        size = (image.width // factor, image.height // factor)
        whole = (0, 0, size[0] * factor, size[1] * factor)  # Else the pixels would not be square.
        return image.crop(whole).resize(size, Image.Resampling.BOX)
    return apply


# What happens to an image, how much smaller it gets, and which part of its size is cut off left and
# above.
VARIANTS = {
    "as given": (None, 1, 0),
    "compressed": (compressed, 1, 0),
    "blurred": (lambda image, _: image.filter(ImageFilter.GaussianBlur(2.0)), 1, 0),
    "noisy": (pixels(noisy), 1, 0),
    "dark": (pixels(dark), 1, 0),
    "half": (scaled(2), 2, 0),
    "third": (scaled(3), 3, 0),
    "narrow": (narrow, 1, 4),
    "occluded": (occluded, 1, 0),
}


def camera_of(name, variant, size, new_size):
    """The camera of the changed images; only pinhole models, whose first numbers are in pixels."""
    camera = sequences.preset_camera(name)
    _, smaller, cut = VARIANTS[variant]
    focals = sequences.num_focals(camera)
    parameters = camera["params"]
    for axis in (0, 1):
        if cut:
            parameters[focals + axis] -= size[axis] // cut
    for i in range(focals + 2):
        parameters[i] /= smaller
    return dict(camera, width=new_size[0], height=new_size[1])


def change_image(task):
    source, target, index, variant = task
    with Image.open(source) as image:
        changed = VARIANTS[variant][0](image, index)
        changed.save(target, **({"quality": 97} if target.suffix == ".jpg" else {"compress_level": 1}))
        return image.size, changed.size


def image_folder(name):
    return {"redkitchen": "rgb", "kitti07": "image_0", "mh05": "mav0/cam0/data"}[name]


def make_variant(name, variant, original, folder, pool):
    """The sequence with its images changed; returns its camera."""
    images = original / image_folder(name)
    (folder / image_folder(name)).mkdir(parents=True)
    for path in original.rglob("*"):
        inside = path.relative_to(original)
        parts_of_images = images.is_relative_to(path) or path.is_relative_to(images)
        if path.is_dir() or parts_of_images or path.suffix.lower() in IMAGE_SUFFIXES:
            continue
        (folder / inside).parent.mkdir(parents=True, exist_ok=True)
        (folder / inside).symlink_to(path.resolve())
    sources = sorted(p for p in images.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
    tasks = [(s, folder / image_folder(name) / s.name, i, variant) for i, s in enumerate(sources)]
    size, new_size = pool.map(change_image, tasks, chunksize=8)[0]
    return camera_of(name, variant, size, new_size)


def run_slam(programs, folder, camera, reference, output, settings):
    report, _ = programs.run("s3-slam", "--sequence", folder, "--output", output, "--overwrite",
                             *camera, *stages.set_options(settings))
    error = programs.trajectory_error(output / "frames.txt", reference)
    return {"frames": f"{report['frames_localized']}/{report['frames']}",
            "ate": error["ate"]["translation"]["rmse"], **report["mapped_again"]}


def measure(programs, name, variant, arguments, work, pool):
    """One line of the table."""
    sequence = sequences.real_sequence(name, arguments.data)
    folder, camera = sequence.folder, []
    if variant != "as given":
        folder = work / "sequence"
        camera_file = work / "camera.json"
        stages.write_json(camera_file, make_variant(name, variant, sequence.folder, folder, pool))
        camera = ["--camera", camera_file]
    found = run_slam(programs, folder, camera, sequence.references[0], work / "slam", [])
    without = found
    if found["attempts"] > 0:
        without = run_slam(programs, folder, camera, sequence.references[0], work / "slam",
                           NO_REMAPPING)
    return [variant, found["frames"], tables.metres(found["ate"]), f"{100 * found['doubt']:.0f} %",
            found["attempts"], without["frames"], tables.metres(without["ate"]),
            f"{100 * found['doubt_before']:.0f} %"]


def main():
    parser = sequences.real_sequences_parser(__doc__)
    parser.add_argument("--variants", nargs="+", choices=list(VARIANTS), default=list(VARIANTS))
    arguments = parser.parse_args()
    programs = stages.Programs(arguments.bin, arguments.threads, seed=0)
    header = ["images", "frames", "ATE", "in doubt", "mapped again", "frames, mapped once",
              "ATE, mapped once", "in doubt, mapped once"]
    try:
        with multiprocessing.Pool(arguments.threads) as pool:
            for name in arguments.sequences:
                rows = []
                for variant in arguments.variants:
                    stages.say(f"{name}, {variant} ...")
                    with tempfile.TemporaryDirectory() as work:
                        rows.append(measure(programs, name, variant, arguments,
                                            pathlib.Path(work), pool))
                print(f"\n{name}:\n\n{tables.markdown(header, rows)}", flush=True)
    except (stages.StageFailed, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
