"""What a result is made by, so that one of other settings or programs is not taken for it.

Data sets are known by their names alone: what changes inside their files goes unnoticed.
"""

import functools
import hashlib
import json


@functools.cache
def _sha256(path, size, changed_ns):  # The latter two: of a program built anew it is another one.
    return hashlib.sha256(path.read_bytes()).hexdigest()


def of(folder, commands, inputs=()):
    """Identity of what `commands`, each the words (program, argument, ...), make with the programs in
    `folder`. `inputs` are the identities of results that they read."""
    commands = [list(map(str, words)) for words in commands]
    programs = {}
    for name, *_ in commands:
        status = (folder / name).stat()
        programs[name] = _sha256(folder / name, status.st_size, status.st_mtime_ns)
    texts = [json.dumps(value, sort_keys=True) for value in inputs]
    return {"commands": commands, "programs": programs,
            "inputs": [hashlib.sha256(text.encode()).hexdigest() for text in texts]}


def is_done(path, made_by):
    """Whether the file that is written beside a result, or with it, is there and says the same."""
    return path.is_file() and json.loads(path.read_text()).get("made_by") == made_by
