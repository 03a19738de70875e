"""Publishing examples as a dataset: one folder that other tools read, split by building, with a card that tells of it.

What was published stays, and other runs come in beside it; a run that comes again takes its own place.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Final

import pyarrow as pa

from mapgraft.errors import OutputError, UsageError
from mapgraft.examples.card import CARD, Tally, card
from mapgraft.examples.judged import KNOWN_OF, judged
from mapgraft.examples.reading import EXAMPLES, ExampleFolder, ExampleKey, Word, last_words_on, plain
from mapgraft.examples.splits import SPLITS, split_by_name, split_of
from mapgraft.outputs.files import json_bytes
from mapgraft.outputs.lock import DATASET, locked, require_kind
from mapgraft.outputs.parquet_log import PartWriter
from mapgraft.outputs.provenance import is_run_id
from mapgraft.outputs.staging import Staging, writing
from mapgraft.outputs.tables import array_of
from mapgraft_schemas import arrow_schema, table

FORMAT: Final = "mapgraft dataset 1"
_NAME: Final = "dataset"
_DIGITS: Final = 32  # of a part's name: many runs have parts side by side
_PART: Final = re.compile(rf"{EXAMPLES}/split=(\w+)/part-[\w-]+\.parquet", re.ASCII)


@dataclass(frozen=True, slots=True)
class Part:
    """One file of a dataset: of which run and split it is, and how many examples it holds."""

    name: str
    run_id: str
    split: str
    rows: int


@dataclass(frozen=True, slots=True)
class Published:
    """What is in a dataset: its files, the split of every environment, and how many examples of each run were left out.

    What is left out is of two buildings of which one is for training and the other for testing.
    """

    parts: Sequence[Part] = ()
    environments: Mapping[str, str] = field(default_factory=dict)
    left_out: Mapping[str, int] = field(default_factory=dict)
    licence: str | None = None

    @property
    def rows(self) -> dict[str, int]:
        """Examples per split."""
        return {split: sum(part.rows for part in self.parts if part.split == split) for split in SPLITS}


def publish(
    outs: Sequence[Path], dataset: Path, splits: Mapping[str, str] | None = None, licence: str | None = None
) -> Published:
    """Write the examples of folders of runs and evaluations, with what persons say of them, to a dataset.

    ``splits`` puts environments elsewhere than their names would, from now on; ``licence`` goes into the card. The same
    examples and labels give the same bytes. Raises UsageError where a folder has no examples, or some of a run with a
    name that no run has, OutputError when the dataset cannot be written; then it is as it was.
    """
    for environment, split in (splits or {}).items():
        if split not in SPLITS or not environment or "+" in environment:
            raise UsageError(f"--split wants one ENVIRONMENT={'|'.join(SPLITS)}, found {environment}={split}")
    sources = [ExampleFolder(out) for out in outs]
    _require_run_ids(sources)
    with locked(dataset), writing(dataset):
        before = published_before(dataset)
        publication = _Publication(dataset, sources, before, {**before.environments, **(splits or {})})
        try:
            return publication.publish(licence or before.licence)
        except BaseException:
            publication.staging.remove()
            raise


def published_before(dataset: Path) -> Published:
    """What a dataset holds by now; nothing where there is none. Raises OutputError for a folder of another kind."""
    require_kind(dataset, DATASET)
    path = dataset / DATASET
    if not path.is_file():
        if any((dataset / EXAMPLES).glob("*")):
            raise OutputError(f"{dataset} holds examples of a run or an evaluation: choose another folder")
        return Published()
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        parts = tuple(_part(Part(**part)) for part in told["parts"])
        environments = dict(told["environments"])
        if not {*environments.values()} <= {*SPLITS}:
            raise ValueError("an environment is in a split that there is not")
        return Published(parts, environments, dict(told["left_out"]), told["licence"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise OutputError(f"{path} is not what a dataset has there: choose another folder") from error


def _part(told: Part) -> Part:
    """A part as a dataset tells of it; raises ValueError or TypeError where none is published under that name.

    What is told of is read, and goes when its run comes again: whoever made the dataset must not name other files.
    """
    found = _PART.fullmatch(told.name)
    if found is None or found[1] != told.split or told.split not in SPLITS or not is_run_id(told.run_id):
        raise ValueError(f"{told.name!r} is no part of a dataset")
    return replace(told, rows=int(told.rows))


def _require_run_ids(sources: Iterable[ExampleFolder]) -> None:
    """A dataset may tell runs in a column, and a run's id goes into names of files."""
    for source in sources:
        for run_id in {key.run_id for key in source.keys}:
            if not is_run_id(run_id or ""):
                raise UsageError(
                    f"{source.path} has examples of a run that is called {run_id!r}, but a run's id is a letter and "
                    "then letters, digits, '_' and '-': make the examples again"
                )


@dataclass(slots=True)
class _Publication:
    """One publication under way: what comes from the ``sources``, and what was there before."""

    dataset: Path
    sources: Sequence[ExampleFolder]
    before: Published
    decided: Mapping[str, str]
    staging: Staging = field(init=False)
    environments: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.staging = Staging(self.dataset)

    def publish(self, licence: str | None) -> Published:
        """Write the parts of all runs that have come, or whose environments go to another split, and the card."""
        holders = [*self.sources, *([ExampleFolder(self.dataset)] if self.before.parts else [])]
        runs = {key.run_id for source in self.sources for key in source.keys} | self._moved(holders)
        words = _words(holders)
        parts = [part for part in self.before.parts if part.run_id not in runs]
        left_out = {run_id: count for run_id, count in self.before.left_out.items() if run_id not in runs}
        tally = Tally()
        for part in parts:
            tally.add(part.split, _tallied(self.dataset / part.name))
        for run_id in sorted(runs):
            holder = next(one for one in holders if any(key.run_id == run_id for key in one.keys))
            made, between = self._write(run_id, holder, words, tally)
            parts += made
            missing = between + self._left_out_of(holder).get(run_id, 0)
            left_out |= {run_id: missing} if missing else {}
        parts.sort(key=lambda part: part.name)
        self.environments |= {name: self.decided.get(name) or split_by_name(name) for name in tally.environments}
        known = dict(sorted({**self.decided, **self.environments}.items()))
        out = Published(tuple(parts), known, left_out, licence)
        self._tell(out, tally)
        new = {part.name for part in parts}
        self.staging.publish(gone=[part.name for part in self.before.parts if part.name not in new])
        return out

    def _left_out_of(self, holder: ExampleFolder) -> Mapping[str, int]:
        """What is not in a dataset that examples come from, because it was left out when they were published there."""
        if holder.path.resolve() == self.dataset.resolve():
            return self.before.left_out
        return published_before(holder.path).left_out if (holder.path / DATASET).is_file() else {}

    def _moved(self, holders: Sequence[ExampleFolder]) -> set[str]:
        """Runs that are there already, of which an environment is to be in another split than before."""
        elsewhere = {
            name for name, split in self.decided.items() if self.before.environments.get(name) not in (None, split)
        }
        if not elsewhere or not self.before.parts:
            return set()
        rows = holders[-1].rows(["run_id", "environment"])
        pairs = zip(rows["run_id"].to_pylist(), rows["environment"].to_pylist(), strict=True)
        return {run_id for run_id, environment in pairs if elsewhere & {*environment.split("+")}}

    def _write(
        self, run_id: str, holder: ExampleFolder, words: Mapping[ExampleKey, Sequence[Word]], tally: Tally
    ) -> tuple[list[Part], int]:
        """The parts of one run, one per split, and how many of its examples lie between two splits."""
        writers: dict[str, PartWriter] = {}
        counts: dict[str, int] = {}
        left_out = 0
        try:
            for batch in holder.batches(run_id):
                environments = batch["environment"].to_pylist()
                splits = [split_of(environment, self.decided) for environment in environments]
                left_out += splits.count(None)
                joined = _joined(batch, run_id, words)
                for split in sorted({split for split in splits if split is not None}):
                    rows = _encoded_anew(joined.filter(pa.array([one == split for one in splits])))
                    if split not in writers:
                        writers[split] = self._writer(run_id, split)
                    writers[split].append(rows)
                    tally.add(split, rows)
                    counts[split] = counts.get(split, 0) + len(rows)
            return [Part(w.close(), run_id, split, counts[split]) for split, w in writers.items()], left_out
        except BaseException:
            for writer in writers.values():
                writer.abandon()
            raise

    def _writer(self, run_id: str, split: str) -> PartWriter:
        folder = f"{EXAMPLES}/split={split}"
        return PartWriter(self.staging, _NAME, run_id, writer=f"-{run_id}", digits=_DIGITS, folder=folder)

    def _tell(self, published: Published, tally: Tally) -> None:
        """The card, and what the next publication has to know."""
        try:
            earlier = (self.dataset / CARD).read_text(encoding="utf-8")
        except OSError:
            earlier = ""
        text = card(tally, published.left_out, published.licence, earlier)
        self.staging.write(CARD, text.encode())
        content = {"format": FORMAT, **asdict(published)}
        self.staging.write(DATASET, json_bytes(content))


def _words(holders: Sequence[ExampleFolder]) -> dict[ExampleKey, list[Word]]:
    """The last word of every person on every example, wherever it was said."""
    out: dict[ExampleKey, list[Word]] = {}
    for (key, _), word in last_words_on(holders).items():
        out.setdefault(key, []).append(word)
    return out


def _joined(batch: pa.Table, run_id: str, words: Mapping[ExampleKey, Sequence[Word]]) -> pa.Table:
    """Examples as a dataset holds them, with what is known of them in the end."""
    rows = [
        judged(row, words.get(ExampleKey(run_id, row["example_id"]), ()))
        for row in plain(batch.select(KNOWN_OF)).to_pylist()
    ]
    columns = []
    for column in table(_NAME).columns:
        if column.name == "run_id":
            columns.append(pa.array([run_id] * len(rows), pa.string()))
        elif rows and column.name in rows[0]:
            columns.append(array_of([row[column.name] for row in rows], column.type))
        elif column.name in batch.column_names:
            columns.append(batch[column.name].cast(arrow_schema(_NAME).field(column.name).type))
        else:  # written by a version that did not have it yet
            columns.append(array_of([None] * len(batch), column.type))
    return pa.table(columns, schema=arrow_schema(_NAME))


def _encoded_anew(rows: pa.Table) -> pa.Table:
    """With dictionaries of what is in these rows, in its order: so the same rows are the same bytes, wherever from."""
    columns = [
        rows[field.name].cast(field.type.value_type).dictionary_encode().cast(field.type)
        if pa.types.is_dictionary(field.type)
        else rows[field.name]
        for field in rows.schema
    ]
    return pa.table(columns, schema=rows.schema)


def _tallied(path: Path) -> pa.Table:
    """The columns of a part of which a card counts."""
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as part:
        return part.read(list(Tally.COLUMNS))
