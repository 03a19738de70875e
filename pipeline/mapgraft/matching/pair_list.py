"""Lists of map pairs with their truth: ``pairs.json``."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError, model_validator

from mapgraft.config import path_of, text_of
from mapgraft.errors import UsageError
from mapgraft.matching.pixels import Similarity
from mapgraft.recording.naming import real_path

Side = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Pixel = tuple[float, float]
_MOST_SKEW = 0.02  # of a similarity's matrix: further from one is no rotation with a scale


class ListedPair(BaseModel):
    """One entry as it is written. Keys that are not known are let be: lists say more than is needed here."""

    model_config = ConfigDict(extra="ignore", frozen=True)
    a: str
    b: str
    id: str = ""
    resolution_a_m: Side | None = Field(None, validation_alias=AliasChoices("resolution_a_m", "res_a"))
    resolution_b_m: Side | None = Field(None, validation_alias=AliasChoices("resolution_b_m", "res_b"))
    origin_a: tuple[float, float, float] | None = None
    origin_b: tuple[float, float, float] | None = None
    format_a: str | None = None
    format_b: str | None = None
    T_px_b2a: tuple[float, float, float, float, float, float] | None = None
    keypoints_a: list[Pixel] | None = None
    keypoints_b: list[Pixel] | None = None
    unrelated: bool = False
    suspect: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        a, b = self.keypoints_a, self.keypoints_b
        if (a is None) != (b is None) or (a is not None and b is not None and (len(a) != len(b) or len(a) < 2)):
            raise ValueError("keypoints_a and keypoints_b must be lists of equal length, at least 2")
        if self.T_px_b2a is not None and not _is_similarity(self.T_px_b2a):
            raise ValueError("T_px_b2a must be a rotation with a scale and a shift, row by row: [a, b, x, -b, a, y]")
        if self.unrelated and (self.T_px_b2a is not None or a is not None):
            raise ValueError("an unrelated pair has no T_px_b2a and no keypoints")
        return self


class _Document(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)
    pairs: list[ListedPair]
    groups: dict[str, list[str]] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class MapFile:
    """A map file and what its list says about how to read it."""

    path: Path
    resolution_m: float | None = None
    origin: tuple[float, float, float] | None = None
    format: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TruePair:
    """Two map files, and what is known of how they lie to each other.

    ``T_px_a_b`` (3, 3) takes b's pixels to a's; ``keypoints`` are (n, 2) pixels of a and of b that are the same place.
    ``kind`` says by what an answer is judged: ``keypoints`` where there are any, else ``transform``; ``unrelated``
    maps must not be merged at all.
    """

    id: str
    a: MapFile
    b: MapFile
    kind: Literal["transform", "keypoints", "unrelated"]
    T_px_a_b: Similarity | None = None
    keypoints: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    suspect: bool = False


@dataclass(slots=True)
class PairList:
    """The pairs of one or several files, and which map files are of one place."""

    pairs: list[TruePair] = field(default_factory=list)
    files: dict[Path, MapFile] = field(default_factory=dict)
    _place: dict[Path, Path] = field(default_factory=dict)  # file → another one of the same place, a forest

    def add(self, path: Path, *, unrelated: bool = False) -> None:
        """Add the entries of a file; with ``unrelated`` they are pairs that must not merge, whatever they say.

        Raises UsageError with every fault.
        """
        document = _read(path)
        for number, entry in enumerate(document.pairs, start=1):
            where = f"{path.name}, entry {number} ({entry.id or f'{entry.a}, {entry.b}'})"
            a = self._file(path.parent / entry.a, entry.resolution_a_m, entry.origin_a, where, entry.format_a)
            b = self._file(path.parent / entry.b, entry.resolution_b_m, entry.origin_b, where, entry.format_b)
            kind = "unrelated" if unrelated else _kind_of(entry, where)
            if kind == "unrelated":
                self.pairs.append(TruePair(_id_of(entry), a, b, "unrelated", suspect=entry.suspect))
                continue
            self._same_place([a.path, b.path])
            self.pairs.append(_true_pair(entry, a, b, kind))
        for members in document.groups.values():
            self._same_place([self._file(path.parent / name, None, None, path.name).path for name in members])

    def across(self) -> list[TruePair]:
        """Every two files that no group and no chain of pairs with truth connects, in the order of the files."""
        listed = {frozenset((pair.a.path, pair.b.path)) for pair in self.pairs}
        return [
            TruePair(f"{a.stem}__{b.stem}", self.files[a], self.files[b], "unrelated")
            for a, b in combinations(self.files, 2)
            if self._root(a) != self._root(b) and frozenset((a, b)) not in listed
        ]

    def known(self, file: MapFile) -> MapFile:
        """All that the lists together say of a file: an entry may leave out what another one tells."""
        return self.files[file.path]

    def _file(
        self,
        path: Path,
        resolution_m: float | None,
        origin: tuple[float, float, float] | None,
        where: str,
        form: str | None = None,
    ) -> MapFile:
        file = MapFile(real_path(path), resolution_m, origin, form)
        before = self.files.get(file.path)
        if before is None:
            self.files[file.path] = file
            return file
        if resolution_m is not None and before.resolution_m not in (None, resolution_m):
            raise UsageError(
                f"{where}: {path.name} has {resolution_m:g} m per pixel here and {before.resolution_m:g} m elsewhere"
            )
        self.files[file.path] = MapFile(
            file.path,
            before.resolution_m or resolution_m,
            before.origin if before.origin is not None else origin,
            before.format or form,
        )
        return file

    def _same_place(self, paths: Sequence[Path]) -> None:
        for path in paths[1:]:
            one, other = self._root(paths[0]), self._root(path)
            if one != other:
                self._place[other] = one

    def _root(self, path: Path) -> Path:
        while path in self._place:
            path = self._place[path]
        return path


def read_lists(related: Iterable[Path], unrelated: Iterable[Path]) -> PairList:
    """The pairs of several files as one list; raises UsageError with the faults of the first that has any."""
    pairs = PairList()
    for path in related:
        pairs.add(path)
    for path in unrelated:
        pairs.add(path, unrelated=True)
    return pairs


def _read(path: Path) -> _Document:
    try:
        found: Any = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"the list {path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise UsageError(f"the list {path} is not JSON: {error}") from None
    content: Mapping[str, Any] = {"pairs": found} if isinstance(found, list) else found
    try:
        return _Document.model_validate(content)
    except ValidationError as error:
        faults = [f"  {_place_of(fault['loc'], content)}: {text_of(fault)}" for fault in error.errors()]
        raise UsageError(f"the list {path} has {len(faults)} fault(s):\n" + "\n".join(faults)) from None


def _place_of(place: tuple[int | str, ...], content: Mapping[str, Any]) -> str:
    """Where a fault is; entries are counted from 1 and told by their id or files."""
    if len(place) < 2 or place[0] != "pairs" or not isinstance(place[1], int):
        return path_of(place)
    entry = content["pairs"][place[1]]
    told = entry if isinstance(entry, Mapping) else {}
    names = told.get("id") or ", ".join(str(told[side]) for side in ("a", "b") if side in told)
    where = f"entry {place[1] + 1}" + (f" ({names})" if names else "")
    return f"{where}, {path_of(place[2:])}" if place[2:] else where


def _kind_of(entry: ListedPair, where: str) -> Literal["transform", "keypoints", "unrelated"]:
    if entry.unrelated:
        return "unrelated"
    if entry.keypoints_a is not None:
        return "keypoints"
    if entry.T_px_b2a is not None:
        return "transform"
    raise UsageError(
        f"{where} tells no truth: give T_px_b2a or keypoints_a and keypoints_b, or unrelated: true; a list of pairs "
        "that must not merge is given with --unrelated"
    )


def _true_pair(entry: ListedPair, a: MapFile, b: MapFile, kind: Literal["transform", "keypoints"]) -> TruePair:
    T = None if entry.T_px_b2a is None else np.array([*entry.T_px_b2a, 0.0, 0.0, 1.0]).reshape(3, 3)
    points = None
    if entry.keypoints_a is not None and entry.keypoints_b is not None:
        points = np.array(entry.keypoints_a, np.float64), np.array(entry.keypoints_b, np.float64)
        T = fitted(*points) if T is None else T
    return TruePair(_id_of(entry), a, b, kind, T, points, entry.suspect)


def _id_of(entry: ListedPair) -> str:
    return entry.id or f"{Path(entry.a).stem}__{Path(entry.b).stem}"


def _is_similarity(numbers: Sequence[float]) -> bool:
    a, b, _, c, d, _ = numbers
    scale = math.sqrt(abs(a * d - b * c))
    off = max(abs(a - d), abs(b + c))
    return all(map(math.isfinite, numbers)) and a * d - b * c > 0 and off <= _MOST_SKEW * scale


def fitted(a: NDArray[np.float64], b: NDArray[np.float64]) -> Similarity:
    """The similarity that brings the points b (n, 2) nearest to the points a in the mean square.

    Source: Umeyama, Least-squares estimation of transformation parameters, IEEE PAMI 13 (1991), in complex numbers.
    """
    za, zb = (points[:, 0] + 1j * points[:, 1] for points in (a, b))
    ca, cb = za.mean(), zb.mean()
    turn = np.vdot(zb - cb, za - ca) / np.vdot(zb - cb, zb - cb)
    shift = ca - turn * cb
    return np.array([[turn.real, -turn.imag, shift.real], [turn.imag, turn.real, shift.imag], [0.0, 0.0, 1.0]])
