"""What a job needs of files elsewhere: MCAP by ranges, everything else fetched into a folder that ends with the job."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mapgraft.corpus.places import is_url, stand_in
from mapgraft.corpus.plan import Job
from mapgraft.corpus.recordings import FarRecording, Looks, far_recording, looks_of, near_file
from mapgraft.errors import RecordingError
from mapgraft.job import input_file
from mapgraft.outputs.provenance import InputFile
from mapgraft.recording.containers.mcap_records import MAGIC
from mapgraft.recording.containers.octets import RangedOctets
from mapgraft.stand_ins import StandIns

_PREFIX, _LOCK = "mapgraft-corpus-", ".lock"
_A_MINUTE_S = 60.0  # nobody takes so long between making a folder and locking it
Digests = Mapping[tuple[str, int, int], str]
"""SHA-256 of files by path, size and time of last writing: those need not be read whole again."""


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder of this machine (``TMPDIR``) that is gone when this is left.

    Those of processes that were killed are taken away by the next one: they hold a lock as long as they live.
    """
    for left in sorted(Path(tempfile.gettempdir()).glob(f"{_PREFIX}*")):
        _sweep(left)
    folder, lock = _locked()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _locked() -> tuple[Path, int]:
    """A new folder with its lock; another one, where somebody swept it away before it was locked."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
        with suppress(FileNotFoundError):
            lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(lock, fcntl.LOCK_EX)
            if (folder / _LOCK).exists():
                return folder, lock
            os.close(lock)


def _sweep(folder: Path) -> None:
    with suppress(OSError):  # it is another user's, or gone meanwhile
        try:
            lock = os.open(folder / _LOCK, os.O_RDWR)
        except FileNotFoundError:  # just being made, or half taken away
            if time.time() - folder.stat().st_mtime > _A_MINUTE_S:
                shutil.rmtree(folder, ignore_errors=True)
            return
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)


@dataclass(frozen=True, slots=True)
class Inputs:
    """A job's files as paths of this machine, its configuration with these paths, and what is known of both.

    ``near`` tells how those of a disk looked before anything of them was read.
    """

    paths: tuple[Path, ...]
    content: Mapping[str, Any]
    known: Mapping[Path, InputFile]
    octets: Mapping[Path, RangedOctets] = field(default_factory=dict)
    far: tuple[FarRecording, ...] = ()
    near: Mapping[Path, Looks] = field(default_factory=dict)

    @property
    def stand_ins(self) -> StandIns:
        return StandIns(self.octets, self.known)

    @property
    def fetched_bytes(self) -> int:
        """What came by ranges, and what was fetched whole."""
        whole = {path: file.size_bytes for path, file in self.known.items() if file.etag and path not in self.octets}
        return sum(octets.fetched_bytes for octets in self.octets.values()) + sum(whole.values())

    def require_read(self) -> None:
        """Raises RecordingError when what was read is of no use.

        That is when a file was replaced or written to meanwhile, or could once not be read, even where the rest made a
        mission.
        """
        for path, looks in self.near.items():
            if looks_of(path) != looks:
                raise RecordingError(f"{path} was changed while it was read") from OSError("it has changed")
        for octets in self.octets.values():
            if octets.broken:
                raise RecordingError(octets.broken) from OSError("it may be readable the next time")
        for recording in self.far:
            if far_recording(recording.url).input_file != recording.input_file:
                raise RecordingError(f"{recording.url} was replaced while it was read") from OSError("it has changed")


def named_inputs(job: Job, root: Path, far: Mapping[str, FarRecording], digests: Digests) -> Inputs | None:
    """A job's inputs by what is known of them without reading anything; None where something is not known.

    ``far`` are those elsewhere by URL; the paths below ``root`` that stand for them are names only.
    """
    known = dict[Path, InputFile]()
    for place in places_of(job):
        if is_url(place):
            if place not in far:
                return None
            known[stand_in(root, place)] = far[place].input_file
        elif (told := near_file(Path(place))) is None or (digest := _digest_of(told, digests)) is None:
            return None
        else:
            known[Path(place)] = replace(told, sha256=digest)
    return Inputs(_paths(job, root), _content(job, root), known, far=tuple(far.values()))


def fetched_inputs(job: Job, root: Path, digests: Digests) -> Inputs:
    """Make everything that a job reads readable here: in ``root``, or by ranges.

    Raises RecordingError for what cannot be had.
    """
    far = {place: far_recording(place) for place in _read_by(job) if is_url(place)}
    near = {Path(place): looks_of(Path(place)) for place in places_of(job) if not is_url(place)}
    octets, known = dict[Path, RangedOctets](), dict[Path, InputFile]()
    for url, recording in far.items():
        path = stand_in(root, url)
        known[path] = recording.input_file
        if (ranged := _fetched(recording, path)) is not None:
            octets[path] = ranged
    for path in near:
        if (told := near_file(path)) is not None:
            known[path] = replace(told, sha256=_digest_of(told, digests) or input_file(path).sha256)
        elif path.is_dir():
            known[path] = input_file(path)
    return Inputs(_paths(job, root), _content(job, root), known, octets, tuple(far.values()), near)


def _paths(job: Job, root: Path) -> tuple[Path, ...]:
    return tuple(stand_in(root, file) if is_url(file) else Path(file) for file in job.files)


def _content(job: Job, root: Path) -> dict[str, Any]:
    """The configuration with paths instead of URLs; the decision table that it named lies in ``root``."""
    content = pointed(job.content, {url: str(stand_in(root, url)) for url in _read_by(job) if is_url(url)})
    if job.rules_text:
        rules = root / f"{hashlib.sha256(job.rules_text.encode()).hexdigest()}.yaml"
        rules.write_text(job.rules_text, encoding="utf-8")
        content["rules"] = str(rules)
    return content


def _digest_of(told: InputFile, digests: Digests) -> str | None:
    return digests.get((told.path, told.size_bytes, told.modified_ns or 0))


def places_of(job: Job) -> list[str]:
    """Everything that makes a job's run what it is, each once: recordings, and what its configuration adds."""
    places = list(job.files)
    for robot in (job.content.get("robots") or {}).values():
        places += [file for file in robot.get("files") or () if is_url(file) or Path(file).is_absolute()]
        if (file := (robot.get("poses") or {}).get("file")) is not None:
            places.append(file)
    return list(dict.fromkeys(places))


def _read_by(job: Job) -> list[str]:
    """Everything that a job reads by name: also the file of what persons say, which makes no other run."""
    truth = (job.content.get("examples") or {}).get("truth")
    return [*places_of(job), *([truth] if isinstance(truth, str) else [])]


def pointed(content: Mapping[str, Any], paths: Mapping[str, str]) -> dict[str, Any]:
    """A configuration in which URLs of files have given way to paths."""
    out = dict(content)
    if robots := content.get("robots"):
        out["robots"] = {name: _pointed_robot(robot, paths) for name, robot in robots.items()}
    if (examples := content.get("examples")) and isinstance(truth := examples.get("truth"), str):
        out["examples"] = {**examples, "truth": paths.get(truth, truth)}
    return out


def _pointed_robot(robot: Mapping[str, Any], paths: Mapping[str, str]) -> dict[str, Any]:
    out = dict(robot)
    if files := robot.get("files"):
        out["files"] = [paths.get(file, file) for file in files]
    if (poses := robot.get("poses")) and (file := poses.get("file")) is not None:
        out["poses"] = {**poses, "file": paths.get(file, file)}
    return out


def _fetched(recording: FarRecording, path: Path) -> RangedOctets | None:
    """Make a recording readable at a path: by ranges where it is an MCAP file, else by fetching all of it.

    The path of one that is read by ranges is an empty file: a name that others may look for.
    """
    first = recording.files[0]
    if recording.is_folder:
        for file in recording.files:
            file.copy_to(path / file.url.removeprefix(recording.url).lstrip("/"))
        return None
    try:
        head = first.read(0, len(MAGIC)) if first.size_bytes > len(MAGIC) else b""
    except OSError as error:
        raise RecordingError(f"{first.url} cannot be read: {error}") from error
    if head != MAGIC:
        first.copy_to(path)
        return None
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return RangedOctets(first.url, first.size_bytes, first.read)
