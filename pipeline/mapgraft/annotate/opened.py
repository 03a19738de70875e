"""The examples of all folders that were opened, by number; nobody outside says paths or names."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from mapgraft.annotate.shown import Outcome, Place, Shown, Which
from mapgraft.annotate.telling import OUTCOME, SHOWN, outcome_of, shown_of
from mapgraft.annotate.uncertainty import COLUMNS, uncertainty
from mapgraft.contracts import Transform
from mapgraft.errors import MapError, MapgraftError, OutputError, TransformError, UsageError
from mapgraft.examples import ExampleFolder, ExampleKey, Word, published_words, put_at, transform_of
from mapgraft.examples.reading import EXAMPLES
from mapgraft.outputs.label_parts import gather
from mapgraft.outputs.labels import Verdict, label
from mapgraft.outputs.provenance import is_run_id

LISTED: Final = ("run_id", "environment", "truth", "T_receiver_donor", "own_px_m", "donor_px_m")
TRUTHS: Final = ("right", "wrong")
RUN_CHARACTERS: Final = 128  # of an id that is to be in the name of a folder
MOST_EXAMPLES: Final = 1_000_000  # of one folder
PICTURE_BYTES: Final = 4 * 2**20
PICTURE_PX: Final = 4_096  # of a side
REMEMBERED: Final = 256  # examples, and half as many pictures
UNREADABLE: Final = (MapgraftError, OSError, ValueError, TypeError, LookupError, MemoryError, pa.ArrowException)
_PNG: Final = struct.Struct(">8s4x4sII")


class Opened:
    """What was opened. An example has a number ``n``, which it keeps as long as the server runs.

    ``keys``, ``environments``, ``truth`` and ``uncertainty`` have one entry per example. Examples without pictures of
    both maps are not among them, nor those of an earlier folder, nor those whose run has a name that no run has:
    ``left_out`` says how many, and why.
    """

    def __init__(self, folders: Sequence[ExampleFolder]) -> None:
        self.paths = [folder.path for folder in folders]
        self.left_out: dict[str, int] = {}
        self._folders = folders
        self._numbers: dict[ExampleKey, int] = {}
        self._in: list[int] = []
        self.environments: list[str] = []
        self.truth: list[str | None] = []
        listed = [self._list(number) for number in range(len(folders))]
        self.uncertainty = np.concatenate([uncertain for uncertain, _ in listed])
        self._T = np.concatenate([T for _, T in listed])
        self.keys: Sequence[ExampleKey] = tuple(self._numbers)
        self._row = lru_cache(REMEMBERED)(self._read)
        self.picture = lru_cache(REMEMBERED // 2)(self._picture)
        if not self.keys:
            said = "; ".join(f"{count} {why}" for why, count in self.left_out.items()) or "there is none at all"
            raise UsageError(f"there is no example to judge in {', '.join(map(str, self.paths))}: {said}")

    def __len__(self) -> int:
        return len(self._in)

    def tidy(self) -> None:
        """Put words that lie in many small files together."""
        for path, run_id in sorted({self.place_of(n) for n in range(len(self))}):
            gather(path, run_id)

    def place_of(self, n: int) -> tuple[Path, str]:
        """The folder of an example, and its run."""
        return self.paths[self._in[n]], self.keys[n].run_id

    def number(self, run_id: str, example_id: str) -> int | None:
        """The number of an example; None for one that was not opened."""
        return self._numbers.get(ExampleKey(run_id, example_id))

    def published(self) -> Iterator[Word]:
        """The words that came with a dataset."""
        for folder in self._folders:
            yield from published_words(folder)

    def has_place(self, n: int) -> bool:
        """Whether the robot had found a transform, which is to be judged."""
        return bool(np.isfinite(self._T[n]).all())

    def judged(self, n: int) -> Transform | None:
        """The transform that is to be judged; None where the robot found none."""
        try:
            return transform_of(self._T[n])
        except TransformError:  # a stranger's numbers
            return None

    def other_transform(self, n: int, flat: NDArray[np.float64]) -> Transform | None:
        """A transform that somebody wrote down, (16,) row-major; None where it is the one to be judged, or none."""
        if np.isnan(flat[0]) or np.array_equal(flat, self._T[n]):
            return None
        try:
            return transform_of(flat.tolist())
        except TransformError:
            return None

    def moved(self, n: int, T_held: Transform | None) -> Place | None:
        """Where somebody put the donor's map, None where they left it."""
        T = self.judged(n)
        if T_held is None or (T is not None and np.array_equal(T.matrix, T_held.matrix)):
            return None
        return Place(T_held.x_m, T_held.y_m, T_held.yaw_rad)

    def shown(self, n: int) -> Shown:
        """An example without anything that tells what the robot made of it."""
        return shown_of(n, self._row(n))

    def outcome(self, n: int) -> Outcome:
        """What the robot made of an example."""
        return outcome_of(self._folder(n).row(self.keys[n], OUTCOME))

    def write(
        self,
        n: int,
        annotator: str,
        said: Verdict,
        reason: str = "",
        place: Place | None = None,
        elapsed_s: float | None = None,
        clock: datetime | None = None,
    ) -> None:
        """Write a word down, beside the example; it is on disk when this returns. Raises OutputError."""
        key, T = self.keys[n], self.judged(n)
        out, row = self._folder(n).path, self._row(n)
        label(
            out,
            key.run_id,
            merge_id=key.example_id,
            receiver=row["receiver"],
            donor=row["donor"],
            verdict=said,
            by=annotator,
            reason=reason,
            T_receiver_donor=T,
            T_corrected=None if place is None else put_at(T, place.x_m, place.y_m, place.yaw_rad),
            elapsed_s=elapsed_s,
            clock=clock,
        )

    def _folder(self, n: int) -> ExampleFolder:
        return self._folders[self._in[n]]

    def _read(self, n: int) -> Mapping[str, Any]:
        return self._folder(n).row(self.keys[n], SHOWN)

    def _picture(self, n: int, which: Which) -> bytes:
        return checked_picture(self._folder(n).picture(self.keys[n], which))

    def _list(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take the examples of one folder in; how uncertain each is (n,), and T_receiver_donor (n, 16), row-major."""
        folder = self._folders[number]
        rows = folder.rows([*LISTED, *COLUMNS])
        pictured = np.isfinite(_numbers(rows["own_px_m"])) & np.isfinite(_numbers(rows["donor_px_m"]))
        kept = []
        columns = (rows[name].to_pylist() for name in ("environment", "truth"))
        for at, (key, *row) in enumerate(zip(folder.keys, *columns, strict=True)):
            if (why := self._left_out(key, bool(pictured[at]))) is not None:
                self.left_out[why] = self.left_out.get(why, 0) + 1
                continue
            kept.append(at)
            self._take(number, key, *row)
        return uncertainty(rows)[kept], matrices(rows["T_receiver_donor"])[kept]

    def _left_out(self, key: ExampleKey, pictured: bool) -> str | None:
        if not pictured:
            return "without pictures of both maps"
        if not is_run_id(key.run_id) or len(key.run_id) > RUN_CHARACTERS:
            return "of a run whose name is none"
        return "in an earlier folder, too" if key in self._numbers else None

    def _take(self, folder: int, key: ExampleKey, environment: str | None, truth: str | None) -> None:
        self._numbers[key] = len(self._in)
        self._in.append(folder)
        self.environments.append(environment or "")
        self.truth.append(truth if truth in TRUTHS else None)


def open_folders(paths: Sequence[Path]) -> Opened:
    """The examples of these folders.

    Raises UsageError, with the folder's name, for one that has none, and OutputError for one where no answer could be
    written down.
    """
    distinct = dict[Path, Path]()
    for path in paths:
        if not path.is_dir():
            raise UsageError(f"{path} is no folder: name the folder of a run, an evaluation or a dataset")
        distinct.setdefault(path.resolve(), path)
    try:
        for path in distinct.values():
            _require_few(path)
        opened = Opened([ExampleFolder(path) for path in distinct.values()])
        for path in opened.paths:
            _require_writable(path)
        return opened
    except MapgraftError:
        raise
    except UNREADABLE as error:
        raise UsageError(
            f"the examples in {', '.join(map(str, paths))} are none that mapgraft wrote ({error}): make them again"
        ) from error


def _require_few(path: Path) -> None:
    """Raises UsageError where a folder claims more examples than fit into memory, which takes few bytes."""
    rows = sum(pq.read_metadata(part).num_rows for part in sorted((path / EXAMPLES).glob("**/part-*.parquet")))
    if rows > MOST_EXAMPLES:
        raise UsageError(f"{path} has {rows} examples, more than {MOST_EXAMPLES}: open fewer at a time")


def _require_writable(path: Path) -> None:
    """Raises OutputError where this user may not write the labels of a folder: nobody is to judge for nothing."""
    labels = path / "labels"
    if labels.exists() and not labels.is_dir():
        raise OutputError(f"{labels} is no folder, and answers are written to one of that name: move it away")
    for folder in (labels, *labels.glob("run_id=*")) if labels.exists() else (path,):
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(
                f"{folder} is read-only for this user, and answers are written there: change that, or copy {path} to "
                "where you may write"
            )


def checked_picture(data: bytes | None) -> bytes:
    """A picture that a browser may be given; raises MapError for what is no PNG, or a huge one."""
    if data is None or len(data) < _PNG.size:
        raise MapError("the example has no such picture")
    magic, kind, width, height = _PNG.unpack_from(data)
    if magic != b"\x89PNG\r\n\x1a\n" or kind != b"IHDR":
        raise MapError("the example's picture is no PNG")
    if len(data) > PICTURE_BYTES or max(width, height) > PICTURE_PX:
        raise MapError(f"the example's picture is too large: {width} × {height} pixels, {len(data)} bytes")
    return data


def matrices(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """Transforms (n, 16), row-major; NaN where there is none."""
    whole = column.combine_chunks()
    if whole.null_count:
        return np.array([[np.nan] * 16 if given is None else given for given in whole.to_pylist()], np.float64)
    return np.reshape(_numbers(whole.flatten()), (-1, 16))


def _numbers(column: pa.Array | pa.ChunkedArray) -> NDArray[np.float64]:
    return np.asarray(column.to_numpy(), np.float64)
