"""Trajectories of other systems on the same images: <system>_<sequence>[_<run>]_frames.txt."""

import re

import sequences


def system_and_sequence(file_name, names):
    """What a file name stands for by names of sequences, or None; names may end in others."""
    for name in sorted(names, key=len, reverse=True):
        match = re.fullmatch(rf"(.+?)_{re.escape(name)}(_\d+)?_frames\.txt", file_name)
        if match:
            return match.group(1), name
    return None


def find(folder, chosen):
    """{(sequence, system): files of its runs}, by chosen sequences in their order. Files of others
    are left out, those of sequences that could be chosen included."""
    found = {name: {} for name in chosen}
    for path in sorted(folder.glob("*_frames.txt")):
        system, name = system_and_sequence(path.name, {*chosen, *sequences.all_names()}) or ("", "")
        if name in found:
            found[name].setdefault(system, []).append(path)
    return {(name, system): paths for name, systems in found.items()
            for system, paths in systems.items()}
