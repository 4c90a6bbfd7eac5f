#!/usr/bin/env python3
"""Brings sequences of a public data set into one folder, ready to be run.

Downloads from the original sites, goes on where an earlier download stopped, and checks sizes and
SHA-256 where public sources state them; where none does, the archive itself is checked, and its size
and SHA-256 are written to downloaded.json for the next time. With --from, nothing is downloaded:
archives and unpacked sequences are looked for in that folder and taken (linked) from there.
What is already in place is kept. Needs Python's standard library only; mind the terms of each data set.
"""

import argparse
import hashlib
import json
import lzma
import pathlib
import shutil
import sys
import tarfile
import urllib.error
import urllib.request
import zipfile
import zlib

import ground_truth
import presets

CHUNK = 1 << 20
ATTEMPTS = 5


class FetchFailed(Exception):
    """One line: the archive and the reason."""


def say(text):
    print(text, file=sys.stderr, flush=True)


def sha256_of(path):
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


# ---- download --------------------------------------------------------------------------------------


def append_from(url, part):
    """Downloads what is missing of `part`; True once nothing is."""
    have = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(url, headers={"Range": f"bytes={have}-"} if have else {})
    try:
        with urllib.request.urlopen(request, timeout=60) as response:
            resumes = response.status == 206
            due = int(response.headers["Content-Length"] or 0)
            with part.open("ab" if resumes else "wb") as stream:
                start = stream.tell()
                shutil.copyfileobj(response, stream, CHUNK)
                return not due or stream.tell() - start == due
    except urllib.error.HTTPError as error:
        if error.code == 416 and have:  # Nothing beyond what we have.
            return True
        raise FetchFailed(f"{url}: {error.code} {error.reason}") from error


def download(url, path):
    part = path.with_name(path.name + ".part")
    for attempt in range(ATTEMPTS):
        try:
            if append_from(url, part):
                part.replace(path)
                return
        except (urllib.error.URLError, ConnectionError, TimeoutError) as error:
            if attempt + 1 == ATTEMPTS:
                raise FetchFailed(f"{url}: {error}") from error
    raise FetchFailed(f"{url}: the connection ended early {ATTEMPTS} times")


# ---- checks and unpacking --------------------------------------------------------------------------


def check(archive, path, record):
    """Against what public sources or our own record state; else the archive itself."""
    known = record.get(archive.name, {})
    size, checksum = archive.size or known.get("size"), archive.sha256 or known.get("sha256")
    if size is not None and path.stat().st_size != size:
        raise FetchFailed(f"{path}: {path.stat().st_size} bytes instead of {size}; "
                          "delete it to download it again")
    actual = sha256_of(path)
    if checksum is not None and actual != checksum:
        raise FetchFailed(f"{path}: SHA-256 is {actual} instead of {checksum}; "
                          "delete it to download it again")
    record[archive.name] = {"size": path.stat().st_size, "sha256": actual, "url": archive.url}


def unpack(path, folder):
    """Throws FetchFailed for a broken archive, and where the disk fails; members outside the folder
    are refused, and so is what could lead there: links."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                archive.extractall(folder)  # Which itself keeps members inside.
        else:
            with tarfile.open(path) as archive:
                for member in archive.getmembers():
                    target = (folder / member.name).resolve()
                    if folder.resolve() not in target.parents and target != folder.resolve():
                        raise FetchFailed(f"{path}: {member.name} lies outside the archive")
                    if not member.isfile() and not member.isdir():
                        raise FetchFailed(f"{path}: {member.name} is neither a file nor a folder")
                archive.extractall(folder)
                while archive.fileobj.read(1 << 20):  # To the checksum, which is at the end.
                    pass
    except (zipfile.BadZipFile, tarfile.TarError, EOFError, lzma.LZMAError, zlib.error,
            OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # Not of what decompresses.
            raise FetchFailed(f"{path}: cannot unpack into {folder}: {error.strerror}") from error
        raise FetchFailed(f"{path}: broken archive: {error}") from error


def unpack_inner(preset, home):
    """7-Scenes: the archive of a scene holds an archive for each sequence."""
    sequence = home / preset.folder
    inner = sequence.with_name(sequence.name + ".zip")
    if inner.exists() and not sequence.is_dir():
        unpack(inner, sequence.parent)


# ---- what is already there -------------------------------------------------------------------------


def find_sequence(preset, source):
    """An unpacked sequence below `source`: its whole path, or at least its last folder."""
    for depth in range(len(pathlib.PurePath(preset.folder).parts)):
        tail = pathlib.PurePath(*pathlib.PurePath(preset.folder).parts[depth:])
        if len(tail.parts) == 1 and len(tail.name) < 6:
            return None  # "07" or "seq-01" may be anything.
        for path in [source / tail, *sorted(source.rglob(str(tail)))]:
            if path.is_dir():
                return path
    return None


def link(source, target):
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.exists():
        target.symlink_to(source.resolve())


def take_sequence(preset, found, home):
    """Links every file and folder of the sequence, so that groundtruth.txt can be put beside them
    and the source stays untouched; and what lies outside its folder."""
    target = home / preset.folder
    for path in sorted(found.iterdir()):
        link(path, target / path.name)
    if preset.dataset == "kitti-raw":
        for path in sorted(found.parent.glob("calib_*.txt")):
            link(path, target.parent / path.name)
    if preset.dataset == "kitti-odometry":
        poses = found.parent.parent / "poses" / f"{found.name}.txt"
        if poses.exists():
            link(poses, target.parent.parent / "poses" / poses.name)


def archive_path(archive, home, source, mirror):
    """Path of the archive: in place, in --from, or downloaded."""
    place = home / "archives" / archive.name
    if place.exists():
        return place
    place.parent.mkdir(parents=True, exist_ok=True)
    if source is not None:
        found = next(iter(sorted(source.rglob(archive.name))), None)
        if found is None:
            raise FetchFailed(f"{archive.name}: neither it nor the unpacked sequence is in {source}")
        return found
    url = f"{mirror.rstrip('/')}/{archive.name}" if mirror else archive.url
    say(f"downloading {url}")
    download(url, place)
    return place


class Record:
    """downloaded.json: sizes and checksums of the archives seen, and which are unpacked."""

    def __init__(self, path):
        self._path = path
        self.archives = json.loads(path.read_text()) if path.exists() else {}

    def save(self):
        beside = self._path.with_name(self._path.name + ".tmp")
        beside.write_text(json.dumps(self.archives, indent=1, sort_keys=True) + "\n")
        beside.replace(self._path)

    def unpacked(self, archive):
        return self.archives.get(archive.name, {}).get("unpacked", False)


def unpack_archives(preset, home, source, mirror, keep, record):
    for archive in preset.archives:
        if record.unpacked(archive):
            continue
        path = archive_path(archive, home, source, mirror)
        check(archive, path, record.archives)
        record.save()  # An unpacking that is interrupted is begun anew.
        unpack(path, home / archive.into)
        record.archives[archive.name]["unpacked"] = True
        record.save()
        if not keep and path.parent == home / "archives":
            path.unlink()


def fetch(preset, home, source, mirror, keep, record):
    sequence = home / preset.folder
    if not sequence.is_dir() and source is not None:
        found = find_sequence(preset, source)
        if found is not None:
            take_sequence(preset, found, home)
    begun = any(archive.name in record.archives for archive in preset.archives)
    if begun or not sequence.is_dir():
        unpack_archives(preset, home, source, mirror, keep, record)
        unpack_inner(preset, home)
    if not sequence.is_dir():
        raise FetchFailed(f"{sequence}: not in the archives")
    ground_truth.prepare(preset.dataset, sequence)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", choices=presets.DATASETS)
    parser.add_argument("sequences", nargs="*", metavar="SEQUENCE", help="default: all")
    parser.add_argument("--to", type=pathlib.Path, required=True, metavar="DIR",
                        help="folder of all data sets; this one gets a folder in it")
    parser.add_argument("--from", type=pathlib.Path, dest="source", metavar="DIR",
                        help="take what is in this folder; download nothing")
    parser.add_argument("--mirror", metavar="URL", help="download <URL>/<archive> instead")
    parser.add_argument("--keep-archives", action="store_true", help="after unpacking")
    parser.add_argument("--list", action="store_true", help="print the archives and exit")
    arguments = parser.parse_intermixed_args()  # Sequences may come last.
    known = {preset.name: preset for preset in presets.DATASETS[arguments.dataset]}
    for name in arguments.sequences:
        if name not in known:
            parser.error(f"{name}: not a sequence; there are {', '.join(known)}")
    chosen = [known[name] for name in arguments.sequences or known]
    if arguments.list:
        for url in dict.fromkeys(a.url for preset in chosen for a in preset.archives):
            print(url)
        return 0
    home = arguments.to / arguments.dataset
    home.mkdir(parents=True, exist_ok=True)
    record = Record(home / "downloaded.json")
    failed = 0
    for preset in chosen:
        try:
            fetch(preset, home, arguments.source, arguments.mirror, arguments.keep_archives, record)
            say(f"{preset.name}: ready in {home / preset.folder}")
        except (FetchFailed, ground_truth.BadData) as error:
            say(f"{preset.name}: {error}")
            failed += 1
    return 3 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
