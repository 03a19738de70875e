"""Reading examples and what people say of them: of a run, of an evaluation, or of a published dataset."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft.errors import TransformError, UsageError
from mapgraft.outputs.label_parts import LabelParts
from mapgraft.outputs.staging import SUFFIX
from mapgraft.persons import SAME_PLACE_M, SAME_TURN_RAD

EXAMPLES: Final = "examples"
WITHDRAWN: Final = "withdrawn"
Which = Literal["own", "donor", "overlay"]


class ExampleKey(NamedTuple):
    """Which example: the run or evaluation that made it, and its id there."""

    run_id: str
    example_id: str


@dataclass(frozen=True, slots=True, eq=False)
class Word:
    """What somebody said of an example: right, wrong, unsure or withdrawn.

    ``T_judged`` is the transform that was judged, ``T_receiver_donor`` the one the annotator holds for right; None
    where none was given. ``said_ns`` is the annotator's clock. ``pose`` is x, y and yaw of ``T_receiver_donor`` as they
    were published: from the transform they come out a little rounded.
    """

    key: ExampleKey
    label: str
    annotator: str
    T_judged: Transform | None
    T_receiver_donor: Transform | None
    comment: str
    said_ns: int
    elapsed_s: float | None
    pose: tuple[float, float, float] | None = None

    def is_about(self, T_receiver_donor: Transform | None) -> bool:
        """Whether this transform was judged: ids belong to other attempts when a run is made anew, or merges reverted.

        True where nobody wrote down what was judged; None is an attempt that found no transform.
        """
        if self.T_judged is None:
            return True
        if T_receiver_donor is None:
            return False
        shift_m, turn_rad = T_receiver_donor.difference(self.T_judged)
        return shift_m <= SAME_PLACE_M and turn_rad <= SAME_TURN_RAD


class _Place(NamedTuple):
    """Where a row is: which file, which row group of it, which row of that."""

    file: int
    group: int
    row: int


class ExampleFolder:
    """The examples of one output folder or dataset, read where they are: pictures one row group at a time.

    May be asked from several threads. What is written to ``labels/`` later is seen by ``words``; examples that come
    later are not. Raises UsageError where there are none, or a file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = sorted((path / EXAMPLES).glob("**/part-*.parquet"))
        if not self.files:
            raise UsageError(_without_examples(path))
        self._lock = threading.Lock()
        self._opened: dict[int, pq.ParquetFile] = {}
        self._places: dict[ExampleKey, _Place] = {}
        for number in range(len(self.files)):
            for key, place in self._listed(number):
                if self._places.setdefault(key, place) is not place:
                    raise UsageError(f"{path} has two examples {key.example_id} of the run {key.run_id}")
        self.keys: Sequence[ExampleKey] = tuple(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, key: object) -> bool:
        return key in self._places

    def rows(self, columns: Sequence[str] | None = None) -> pa.Table:
        """These columns of all examples, in the order of ``keys``; ``run_id`` is one, and ``split`` of a dataset.

        Without ``columns`` all but pictures and classes, which ``picture`` and ``row`` give.
        """
        with self._lock:
            return pa.concat_tables(
                [self._whole(number, columns) for number in range(len(self.files))], promote_options="default"
            ).unify_dictionaries()

    def batches(self, run_id: str) -> Iterator[pa.Table]:
        """Everything about the examples of one run as it is in the files, a row group at a time."""
        for number in range(len(self.files)):
            if not any(key.run_id == run_id and place.file == number for key, place in self._places.items()):
                continue
            with self._lock:
                opened = self._file(number)
            for group in range(opened.num_row_groups):
                with self._lock:
                    found = opened.read_row_group(group)
                if "run_id" in found.column_names:
                    found = found.filter(pc.equal(found["run_id"], run_id))
                yield found

    def row(self, key: ExampleKey, columns: Sequence[str] | None = None) -> dict[str, Any]:
        """One example as plain values, all columns but pictures and classes if none are named; stamps in nanoseconds.

        Raises KeyError for an example that is not in the folder.
        """
        place = self._places[key]
        with self._lock:
            opened = self._file(place.file)
            wanted = _light(opened.schema_arrow) if columns is None else [name for name in columns if name != "run_id"]
            found = opened.read_row_group(place.group, columns=wanted, use_threads=False)
        values: dict[str, Any] = plain(found.slice(place.row, 1)).to_pylist()[0]
        return {"run_id": key.run_id, **values}

    def picture(self, key: ExampleKey, which: Which) -> bytes | None:
        """The PNG of the receiver's map, the donor's, or both on each other; None where there is none.

        Raises KeyError for an example that is not in the folder.
        """
        found = self.row(key, [f"{which}_picture"])[f"{which}_picture"]
        return None if found is None else found["bytes"]

    def words(self) -> Sequence[Word]:
        """All that was ever said of these examples, the earliest first; also of what was theirs before."""
        said = list(published_words(self))
        for run_id, rows in LabelParts(self.path).new():
            said += _words_of(run_id, rows)
        return _once(word for word in said if word.key in self._places)

    def labels(self) -> Mapping[tuple[ExampleKey, str], Word]:
        """The last word of each annotator on each example, as ``last_words_on`` tells it."""
        return last_words_on([self])

    def transforms(self, keys: Collection[ExampleKey]) -> dict[ExampleKey, Transform | None]:
        """``T_receiver_donor`` of those of these examples that the folder has; None where there is no transform."""
        at = [number for number, key in enumerate(self.keys) if key in keys]
        found = self.rows(["T_receiver_donor"])["T_receiver_donor"].take(at).to_pylist() if at else []
        return {self.keys[number]: _sound(flat) for number, flat in zip(at, found, strict=True)}

    def _listed(self, number: int) -> Iterator[tuple[ExampleKey, _Place]]:
        opened = self._file(number)
        has_run = "run_id" in opened.schema_arrow.names
        for group in range(opened.num_row_groups):
            found = opened.read_row_group(group, columns=["example_id", *(["run_id"] if has_run else [])])
            ids = found.column("example_id").to_pylist()
            runs = found.column("run_id").to_pylist() if has_run else [_run_of(self.files[number])] * len(ids)
            for row, (run_id, example_id) in enumerate(zip(runs, ids, strict=True)):
                yield ExampleKey(run_id, example_id), _Place(number, group, row)

    def _whole(self, number: int, columns: Sequence[str] | None) -> pa.Table:
        """A file's rows with the columns that its folders tell."""
        opened, path = self._file(number), self.files[number]
        here = set(opened.schema_arrow.names)
        wanted = _light(opened.schema_arrow) if columns is None else [name for name in columns if name in here]
        found = opened.read(columns=wanted).replace_schema_metadata(None)
        for name, value in (("run_id", _run_of(path)), ("split", _folder_of(path, "split"))):
            if name not in here and value and (columns is None or name in columns):
                found = found.append_column(name, pa.array([value] * len(found), pa.string()))
        return found

    def _file(self, number: int) -> pq.ParquetFile:
        if number not in self._opened:
            try:
                self._opened[number] = pq.ParquetFile(self.files[number], memory_map=True)
            except (OSError, pa.ArrowInvalid) as error:
                raise UsageError(f"{self.files[number]} cannot be read ({error}): make it again") from error
        return self._opened[number]


def _without_examples(path: Path) -> str:
    """A sentence on a folder in which there are none."""
    if not path.is_dir():
        return f"there is no folder {path}: name the folder of a run, an evaluation or a dataset"
    if any(path.glob(f"*{SUFFIX}")) or any((path / EXAMPLES).glob(f"**/*{SUFFIX}")):
        return f"{path} has no examples yet, because the run there is not finished: wait for it, or run it again"
    return f"{path} has no examples: run or evaluate with --examples, or name a folder that holds {EXAMPLES}/"


def all_words(folders: Sequence[ExampleFolder]) -> list[Word]:
    """All that was said of the examples of some folders, the earliest first; what several hold, as the first has it."""
    return _once(word for folder in reversed(folders) for word in folder.words())


def _once(words: Iterable[Word]) -> list[Word]:
    """Words in the order in which they were said; of those that are there twice the one that comes later."""
    once = {(word.key, word.annotator, word.said_ns, word.label): word for word in words}
    return sorted(once.values(), key=lambda word: word.said_ns)


def last_words_on(folders: Sequence[ExampleFolder]) -> dict[tuple[ExampleKey, str], Word]:
    """The last word of each annotator on each example of some folders, wherever it was said, if it holds.

    Whoever reads an example reads it from the first folder that has it: a word that judged another transform than that
    one's is not about it (``Word.is_about``), and no word on it.
    """
    said = all_words(folders)
    spoken_of = {word.key for word in said}
    judged: dict[ExampleKey, Transform | None] = {}
    for folder in reversed(folders):
        judged |= folder.transforms(spoken_of)
    return last_words(word for word in said if word.is_about(judged[word.key]))


def last_words(words: Iterable[Word]) -> dict[tuple[ExampleKey, str], Word]:
    """Of words in the order in which they were said, the last one of each annotator on each example, if it holds."""
    last: dict[tuple[ExampleKey, str], Word] = {}
    for word in words:
        last.pop((word.key, word.annotator), None)
        if word.label != WITHDRAWN:
            last[word.key, word.annotator] = word
    return last


def _light(schema: pa.Schema) -> list[str]:
    """All columns but the heavy ones."""
    return [name for name in schema.names if not name.endswith("_picture") and not name.startswith("classes_")]


def _run_of(path: Path) -> str:
    return _folder_of(path, "run_id")


def _folder_of(path: Path, key: str) -> str:
    """What a folder of a hive partition says, empty where there is none."""
    return next((part.removeprefix(f"{key}=") for part in path.parts if part.startswith(f"{key}=")), "")


def _words_of(run_id: str, rows: pa.Table) -> list[Word]:
    """The words of one part of ``labels/``."""
    return [
        Word(
            ExampleKey(run_id, row["merge_id"]),
            row["label"],
            row["annotator"],
            transform_of(row["T_receiver_donor_judged"]),
            transform_of(row["T_receiver_donor"]),
            row["comment"],
            row["labelled_at"],
            row["elapsed_s"],
        )
        for row in plain(rows).to_pylist()
    ]


def published_words(folder: ExampleFolder) -> Iterator[Word]:
    """The words that a published dataset holds in its column ``labels``."""
    table = folder.rows(["run_id", "example_id", "labels", "T_receiver_donor"])
    if "labels" not in table.column_names:
        return
    for row in plain(table).to_pylist():
        judged = transform_of(row["T_receiver_donor"]) if row["labels"] else None
        for said in row["labels"] or ():
            key = ExampleKey(row["run_id"], row["example_id"])
            pose = None if said["x_m"] is None else (said["x_m"], said["y_m"], said["yaw_rad"])
            held = None if pose is None else put_at(judged, *pose)
            what = (said["reason"], said["labelled_at"], said["elapsed_s"], pose)
            yield Word(key, said["label"], said["annotator"], judged, held, *what)


def plain(table: pa.Table) -> pa.Table:
    """The same with stamps as integer nanoseconds, which become Python values without pandas."""
    fields = [pa.field(field.name, _without_stamps(field.type)) for field in table.schema]
    return table.cast(pa.schema(fields))


def _without_stamps(kind: pa.DataType) -> pa.DataType:
    if pa.types.is_timestamp(kind):
        return pa.int64()
    if pa.types.is_list(kind):
        return pa.list_(_without_stamps(kind.value_type))
    if pa.types.is_struct(kind):
        return pa.struct([(kind.field(n).name, _without_stamps(kind.field(n).type)) for n in range(kind.num_fields)])
    return kind


def put_at(T_receiver_donor: Transform | None, x_m: float, y_m: float, yaw_rad: float) -> Transform:
    """The transform with another place in the plane; what it had of height, roll and pitch stays."""
    put = Transform.planar(x_m, y_m, yaw_rad)
    if T_receiver_donor is None:
        return put
    was = Transform.planar(T_receiver_donor.x_m, T_receiver_donor.y_m, T_receiver_donor.yaw_rad)
    return put @ was.inverse() @ T_receiver_donor


def _sound(flat: Sequence[float] | None) -> Transform | None:
    """A transform from 16 numbers; None also where a stranger's numbers make none."""
    try:
        return transform_of(flat)
    except TransformError:
        return None


def transform_of(flat: Sequence[float] | NDArray[np.float64] | None) -> Transform | None:
    """A transform from 16 numbers, row by row; None where there are none, or NaN."""
    if flat is None or not np.isfinite(flat).all():
        return None
    return Transform.from_matrix(np.reshape(np.asarray(flat, np.float64), (4, 4)))
