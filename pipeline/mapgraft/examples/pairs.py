"""Of which two maps an example is: a digest that stays the same whatever they are held against each other by."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from mapgraft.config import Config
from mapgraft.outputs.provenance import InputFile
from mapgraft.recording.naming import real_path
from mapgraft.remember import inputs_of

_SESSION = "@"  # before what tells robots of one name apart, which depends on the other files


def contents_of(paths: Sequence[Path], config: Config, inputs: Sequence[InputFile]) -> Mapping[Path, str]:
    """What the files of a mission hold, by their real paths; ``inputs`` are those of ``inputs_of``, in order."""
    return {real_path(path): file.identity for path, file in zip(inputs_of(paths, config), inputs, strict=True)}


def source_of(contents: Mapping[Path, str], files: Iterable[str], robot: str, *stretch_ns: int) -> str:
    """What a robot's map is made of: its files, itself, and from when to when where that is only a stretch of them.

    Where the contents of a file are not known all of ``contents`` count as its files.
    """
    known = [contents.get(real_path(Path(file)), "") for file in files]
    if not known or not all(known):
        known = [*contents.values()]
    return json.dumps([sorted(known), robot.partition(_SESSION)[0], *stretch_ns])


def pair_sha256(one: str, other: str) -> str:
    """The digest of two such sources, whichever of the two maps is the receiver's."""
    return hashlib.sha256(json.dumps(sorted((one, other))).encode()).hexdigest()
