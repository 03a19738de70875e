"""Which recordings the experiment is made on when none is named."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

DATA: Final = "MAPGRAFT_DATA"  # a folder of recordings that somebody keeps
INTEL: Final = ("intel*.log", "intel*.log.gz", "intel*.clf", "intel*.clf.gz")
DOWNLOAD: Final = "http://www.ipb.uni-bonn.de/datasets/"  # where the paper names it


class Chosen(NamedTuple):
    """Recordings, and a sentence on why these."""

    files: list[Path]
    why: str


def chosen(here: Path | None = None, environment: Mapping[str, str] | None = None) -> Chosen:
    """The Intel log where it is found, the demo recordings otherwise.

    It is looked for in the folder ``here`` (default: the working directory), in its folders ``data`` and
    ``recordings``, and anywhere below the folder that the environment's ``MAPGRAFT_DATA`` names. Of several files the
    one with ``corrected`` in its name goes first: the poses must be trusted.

    Raises UsageError where the demo recordings are not installed.
    """
    from mapgraft.job import demo

    here = Path() if here is None else here
    environment = os.environ if environment is None else environment
    found = sorted(_found(here, environment.get(DATA, "")), key=lambda path: ("corrected" not in path.name, str(path)))
    if found:
        return Chosen([found[0]], f"the Intel log was found: {found[0].name}")
    return Chosen(
        demo()[0],
        f"the Intel log is not here (put it into the folder, or into one that {DATA} names; it comes from {DOWNLOAD}): "
        "the demo recordings are taken instead",
    )


def _found(here: Path, kept: str) -> Iterator[Path]:
    places = [(place, False) for place in (here, here / "data", here / "recordings")]
    places += [(Path(kept), True)] if kept else []
    for place, deep in places:
        for pattern in INTEL:
            yield from (path for path in (place.rglob if deep else place.glob)(pattern) if path.is_file())
