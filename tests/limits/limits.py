"""Hands the stages what is too large, too small or more than memory holds, and looks at what they say.

    limits.py BIN_DIR CHAIN_DIR CLASS_TABLE

A stage has to do its work, or to end by itself with exit code 1 or 3 and one line that says what is
wrong; it must not be killed. CHAIN_DIR is what tests/chain/make.sh made. Needs Python's standard library
only.
"""
import json
import os
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

MIB = 1 << 20


def write_png(path, width, height, row):
    """Gray, 8 bits; row(y) is the bytes of a row."""
    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    packer = zlib.compressobj(1)
    data = b"".join(packer.compress(b"\0" + row(y)) for y in range(height)) + packer.flush()
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(
        ">IIBBBBB", width, height, 8, 0, 0, 0, 0)) + chunk(b"IDAT", data) + chunk(b"IEND", b""))


class Limits:
    def __init__(self, bin_dir, chain, classes, root):
        self.bin, self.chain, self.classes, self.root = bin_dir, chain, classes, root
        self.wrong = []

    def run(self, program, arguments, memory=None):
        def limit():
            if memory:
                resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        output, loading = self.root / "out", self.root / "loading"
        shutil.rmtree(output, ignore_errors=True)
        for old in self.root.glob("loading.*"):
            old.unlink()
        result = subprocess.run(
            [f"{self.bin}/{program}", "--quiet", "--threads", "2", *arguments, "--output", output],
            preexec_fn=limit, text=True, capture_output=True, check=False, timeout=500,
            env={**os.environ, "LD_DEBUG": "files", "LD_DEBUG_OUTPUT": str(loading)})
        # Libraries that need more than that to be loaded and set up end the program before it begins.
        result.begun = memory is None or any(
            "transferring control" in path.read_text() for path in self.root.glob("loading.*"))
        return result

    def expect(self, name, result, codes, *parts):
        lines = result.stderr.splitlines()
        errors = [line for line in lines if " warning " not in line]
        said = len(errors) == 1 and all(part in errors[0] for part in parts)
        if not result.begun:
            print(f"{name}: not begun", flush=True)
            return
        fine = result.returncode in codes and (result.returncode == 0 or said)
        print(f"{name}: exit code {result.returncode} {result.stderr.strip()[:160]}", flush=True)
        if not fine:
            self.wrong.append(f"{name}: exit code {result.returncode}, expected one of {codes}, with "
                              f"{parts}: {result.stderr}")

    def sequence(self, name, width, height, count=5):
        folder = self.root / name
        folder.mkdir()
        for i in range(count):
            write_png(folder / f"{i}.png", width, height, lambda y: bytes(width))
        (folder / "camera.json").write_text(json.dumps(
            {"model": "PINHOLE", "width": width, "height": height,
             "params": [width, width, width / 2, height / 2]}))
        return folder

    def images(self):
        tiny = self.sequence("tiny", 1, 1)
        self.expect("images of 1 x 1", self.run("s3-slam", ["--sequence", tiny]), [3], "map")
        large = self.sequence("large", 10000, 10000, 4)
        self.expect("images of 100 megapixels", self.run("s3-slam", ["--sequence", large]), [3], "map")
        for megabytes in (600, 1200):
            self.expect(f"images of 100 megapixels in {megabytes} MiB",
                        self.run("s3-slam", ["--sequence", large], megabytes * MIB), [1], "memory")

    def headers(self):
        model = self.root / "model"
        shutil.copytree(self.chain / "1_slam", model)
        whole = (model / "images.bin").read_bytes()
        (model / "images.bin").write_bytes(struct.pack("<Q", 60000) + whole[8:])
        refine = ["--model", model]
        self.expect("60000 images claimed", self.run("s3-refine", refine), [3], "images.bin")
        (model / "images.bin").write_bytes(struct.pack("<Q", 1 << 60) + whole[8:])
        self.expect("2^60 images claimed", self.run("s3-refine", refine), [3], "images.bin", "claims")
        # That many, really: as the first, each of its own name, without keypoints.
        pose = whole[12:12 + 7 * 8 + 4]
        with (model / "images.bin").open("wb") as file:
            file.write(struct.pack("<Q", 60000))
            for i in range(60000):
                file.write(struct.pack("<I", i + 1) + pose + f"{i}.png\0".encode())
                file.write(struct.pack("<Q", 0))
        (model / "points3D.bin").write_bytes(struct.pack("<Q", 0))
        for path in model.iterdir():
            if path.name not in ("cameras.bin", "images.bin", "points3D.bin"):
                path.unlink()
        self.expect("60000 images without points", self.run("s3-refine", refine), [3], "60000 images")

    def lift(self, masks, classes, memory=None):
        return self.run("s3-lift", ["--model", self.chain / "1_slam", "--masks", masks, "--classes",
                                    classes], memory)

    def semantics(self):
        masks = self.chain / "scene" / "panoptic_clean"
        table = json.loads(Path(self.classes).read_text())
        example = table["classes"][0]
        known = {c["id"] for c in table["classes"]}
        for i in range(100000):
            if 1000 + i not in known:
                table["classes"].append(dict(example, id=1000 + i, name=f"class {i}"))
        many = self.root / "many.json"
        many.write_text(json.dumps(table))
        self.expect("100000 classes", self.lift(masks, many), [0, 1])
        self.expect("100000 classes in 700 MiB", self.lift(masks, many, 700 * MIB), [1], "memory")
        pieces = self.root / "pieces"
        pieces.mkdir()
        things = [c["id"] for c in table["classes"] if c["thing"] and c["id"] < 255][:2]
        rows = [bytes(things) * 2368, bytes(things[::-1]) * 2368]
        for path in masks.glob("*.png"):
            write_png(pieces / path.name, 4736, 3552, lambda y: rows[y % 2])
            break
        self.expect("a mask of 16 million segments", self.lift(pieces, self.classes), [0, 1, 3])

    def memory(self):
        model = self.chain / "1_slam"
        for megabytes in (280, 320, 400, 600):
            limit = megabytes * MIB
            runs = {
                "s3-slam": ["--sequence", self.chain / "scene", "--frames", "0:20"],
                "s3-lift": ["--model", model, "--masks", self.chain / "scene" / "panoptic_clean",
                            "--classes", self.classes],
                "s3-refine": ["--model", model, "--semantics", self.chain / "2_lift_clean"],
            }
            for program, arguments in runs.items():
                self.expect(f"{program} in {megabytes} MiB", self.run(program, arguments, limit),
                            [0, 1], "memory")


def main():
    bin_dir, chain, classes = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
    with tempfile.TemporaryDirectory() as root:
        limits = Limits(bin_dir, chain, classes, Path(root))
        limits.images()
        limits.headers()
        limits.semantics()
        limits.memory()
    for line in limits.wrong:
        print(f"limits.py: {line}", file=sys.stderr)
    sys.exit(1 if limits.wrong else 0)


if __name__ == "__main__":
    main()
