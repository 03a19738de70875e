"""YAML and TOML from anybody: bounded before anything is built of it, so that no text can take the machine with it.

The bounds are fixed, because they hold before a configuration is read. What people write stays a hundred times below.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Final

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentEndEvent,
    NodeEvent,
    ScalarEvent,
)

from mapgraft.errors import MapgraftError

MOST_BYTES: Final = 1 << 20
MOST_DEPTH: Final = 50
MOST_NODES: Final = 100_000  # with every alias counted as what it stands for
_FAULTS = (YAMLError, tomllib.TOMLDecodeError, ValueError, TypeError, LookupError, RecursionError, OverflowError)


def read_text(path: Path, what: str, error: type[MapgraftError]) -> str:
    """The text of a file that ``what`` names in sentences; raises ``error`` when it cannot be read or is too long."""
    try:
        if not path.is_file():
            raise error(f"{what} is not a file" if path.exists() else f"there is no file {path}: check the path")
        with path.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise error(f"{what} has more than {MOST_BYTES:,} bytes: nobody writes that by hand, so it is not read")
        return data.decode("utf-8")
    except (OSError, ValueError) as fault:
        raise error(f"{what} cannot be read: {getattr(fault, 'strerror', None) or fault}") from None


def parse_yaml(text: str, what: str, error: type[MapgraftError]) -> object:
    """What a YAML 1.2 text holds; raises ``error`` with one sentence when it is no YAML or beyond the bounds."""
    try:
        _check(text, what, error)
        reader = YAML(typ="safe", pure=True)
        reader.composer.warn_double_anchors = False  # YAML allows it: the last one counts
        found: object = reader.load(text)
    except _FAULTS as fault:
        raise error(f"{what} is not valid YAML{_place(fault)}") from None
    return found


def parse_toml(text: str, what: str, error: type[MapgraftError]) -> dict[str, object]:
    """What a TOML text holds; raises ``error`` with one sentence when it is no TOML or nests too deep."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise error(f"{what} nests too deep: {MOST_DEPTH} levels are plenty") from None
    except _FAULTS as fault:
        raise error(f"{what} is not valid TOML: {fault}") from None


def _check(text: str, what: str, error: type[MapgraftError]) -> None:
    """Walk the text's events, which needs little memory however they nest or refer to each other."""
    if len(text) > MOST_BYTES:
        raise error(f"{what} has more than {MOST_BYTES:,} characters: nobody writes that by hand, so it is not read")
    sizes: dict[str, int] = {}  # anchor → how many nodes it stands for
    open_: list[tuple[str | None, int]] = []  # anchors of the collections around here, and the count at their beginning
    nodes = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        if isinstance(event, AliasEvent):
            if event.anchor not in sizes:
                raise error(f"{what} has an alias *{event.anchor} to what is not there, or to itself")
            nodes += sizes[event.anchor]
        elif isinstance(event, NodeEvent):
            nodes += 1
        if isinstance(event, ScalarEvent):
            event.value.encode("utf-8")  # half a surrogate pair can be written, but nowhere be stored
            if event.anchor:
                sizes[event.anchor] = 1
        elif isinstance(event, CollectionStartEvent):
            open_.append((event.anchor, nodes))
        elif isinstance(event, CollectionEndEvent):
            anchor, before = open_.pop()
            if anchor:
                sizes[anchor] = nodes - before + 1
        elif isinstance(event, DocumentEndEvent):
            sizes.clear()
        if len(open_) > MOST_DEPTH:
            raise error(f"{what} nests deeper than {MOST_DEPTH} levels: write it flatter")
        if nodes > MOST_NODES:
            raise error(f"{what} stands for more than {MOST_NODES:,} values, aliases counted in full: write less")


def _place(fault: Exception) -> str:
    """Where and what the fault is, in one line: `` at line 3, column 4: …``."""
    mark = getattr(fault, "problem_mark", None)
    at = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    return f"{at}: {getattr(fault, 'problem', None) or ' '.join(str(fault).split()) or type(fault).__name__}"
