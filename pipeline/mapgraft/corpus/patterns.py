"""Names of a document that may mean many places: patterns, and folders of recordings."""

from __future__ import annotations

from collections.abc import Sequence
from glob import glob
from pathlib import Path

from mapgraft.corpus.places import LOCAL, is_url, local, whole
from mapgraft.corpus.recordings import recordings_in
from mapgraft.corpus.stores import asking, filesystem_of
from mapgraft.errors import RecordingError

_SIGNS = "*?["


def matching(given: str, folder: str = "") -> list[str]:
    """The places that a name means, sorted: those that a pattern matches, or the one that it names.

    A file or folder of that very name goes before what it would mean as a pattern. ``folder`` is what the name may be
    relative to. Raises RecordingError when nothing matches.
    """
    return list(_matching(given, folder))


def recordings_of(given: str, folder: str = "", suffixes: Sequence[str] = ()) -> list[str]:
    """The recordings that a name means; a folder, also one that a pattern matches, means all that it holds.

    ``suffixes`` are those of plugins' readers. Raises RecordingError when there is none.
    """
    found = list[str]()
    for place, is_folder in _matching(given, folder).items():
        found += recordings_in(place, suffixes) if is_folder else [place]
    if not found:
        said = "MCAP, ROS 1 bags, ROS 2 bags and CARMEN logs are looked for"
        raise RecordingError(f"{whole(given, folder)} holds no recording: {said}")
    return found


def _matching(given: str, folder: str) -> dict[str, bool]:
    """Places, sorted, and whether each is a folder; a URL that is no pattern may be either."""
    place = whole(given, folder)
    if not any(sign in given for sign in _SIGNS):
        return {place: is_url(place) or Path(place).is_dir()}
    if is_url(place):
        found = _far(place)
    else:
        found = {place: Path(place).is_dir()} if Path(place).exists() else _near(given, folder)
    if not found:
        raise RecordingError(f"{place} matches nothing")
    return found


def _near(given: str, folder: str) -> dict[str, bool]:
    """Signs in the name of the folder are none of the pattern's."""
    pattern = str(local(given)) if given.startswith(LOCAL) else given
    names = glob(pattern, root_dir=folder or None, recursive=True)  # noqa: PTH207 (absolute patterns)
    return {place: Path(place).is_dir() for place in sorted(whole(name, folder) for name in names)}


def _far(pattern: str) -> dict[str, bool]:
    filesystem, path = filesystem_of(pattern)
    scheme = pattern.partition("://")[0]
    with asking(f"{pattern} cannot be listed", RecordingError):
        filesystem.invalidate_cache()
        told = filesystem.glob(path, detail=True)
    found = {f"{scheme}://{str(name).lstrip('/')}": about["type"] == "directory" for name, about in told.items()}
    return dict(sorted(found.items()))
