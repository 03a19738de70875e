"""The pairs of an evaluation as examples: the same table that a run writes, with the truth about every pair."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from mapgraft.config import Config
from mapgraft.contracts import Transform
from mapgraft.errors import OutputError, UsageError
from mapgraft.evaluation.bench import Bench, Judged
from mapgraft.evaluation.building import DONOR, RECEIVER, Pair
from mapgraft.evaluation.courses import Course
from mapgraft.evaluation.document import parameters_of
from mapgraft.evaluation.drawing import Window
from mapgraft.evaluation.growth import Growth
from mapgraft.examples.collecting import Collector, Origin
from mapgraft.examples.pairs import contents_of, pair_sha256, source_of
from mapgraft.examples.rows import NAME, examples_table
from mapgraft.examples.truths import GIVEN, RECORDED, Known
from mapgraft.examples.truths_csv import examples_truth, lines_about, robots_truth
from mapgraft.outputs.lock import DATASET, locked
from mapgraft.outputs.parquet_log import PartWriter, other_parts
from mapgraft.outputs.provenance import RunProvenance, run_id_of
from mapgraft.outputs.staging import Staging, writing
from mapgraft.outputs.tables import Row
from mapgraft.procedures import Workshop
from mapgraft.recording.naming import stem


@dataclass(slots=True)
class Exemplifier:
    """Makes the example of one pair and procedure: who looks on while the pair is put through it."""

    rows: list[Row]
    collector: Collector

    @classmethod
    def of(cls, pair: Pair, config: Config, workshop: Workshop) -> Exemplifier:
        sides = {RECEIVER: pair.plan.receiver.course, DONOR: pair.plan.donor.course}
        recordings = {name: recording_of(course) for name, course in sides.items()}
        environments = {name: environment_of(course, config) for name, course in sides.items()}
        by = RECORDED if pair.given is None else GIVEN
        T = None if pair.truth is None else pair.truth.T_receiver_donor
        rows: list[Row] = []
        origin = Origin("", "", "", (), recordings, environments)  # what all pairs have in common comes later
        truths = {(RECEIVER, DONOR): Known(T, by, truth=pair.truth)}
        return cls(rows, Collector(origin, workshop, rows.append, truths))

    def row(self, pair: Pair, procedure: str, growth: Growth) -> Row:
        """The example, when all is over."""
        self.collector.finish()
        row = self.rows[0]
        merged = row["verdict"] == "provisional"
        return {
            **row,
            "example_id": f"{pair.plan.number}.{procedure}",
            "merge_id": None,
            "seq": None,
            "new_wall_m": growth.walls_m if merged else None,
        }


def recording_of(course: Course) -> str:
    """The stem of a course's recording."""
    return stem(Path(course.files[0])) if course.files else course.robot


def environment_of(course: Course, config: Config) -> str:
    """The building in which a course was recorded: as it is called, else the stem of the first recording there."""
    first = stem(Path(course.site[0])) if course.site else course.robot
    named = config.examples.environments
    return named.get(recording_of(course)) or named.get(first, first)


def joined_by(path: Path, courses: Sequence[Course]) -> dict[tuple[str, str], Transform]:
    """Where persons hold the map frames of two robots of these courses to lie, by (receiver, donor).

    Raises UsageError when the file cannot be read, contradicts itself, or scales what was measured in metres.
    """
    told = robots_truth(path, {course.robot: recording_of(course) for course in courses})
    joints = {}
    for pair, known in told.items():
        if known.scale != 1.0 and known.T_receiver_donor is not None:
            raise UsageError(f"{path}: {pair[1]} is scaled by {known.scale:g} in {pair[0]}, but scans are in metres")
        if known.T_receiver_donor is not None:
            joints[pair] = known.T_receiver_donor
    return joints


def told_of(path: Path, run_id: str, pairs: int) -> dict[int, Transform]:
    """Where persons hold the donors' maps of single pairs of an evaluation to lie, by the pair's number; raises as
    ``joined_by``."""
    out: dict[int, Transform] = {}
    for example_id, known in examples_truth(path, run_id).items():
        number = example_id.partition(".")[0]
        if not number.isdecimal() or int(number) >= pairs or known.T_receiver_donor is None:
            raise UsageError(f"{path}: this evaluation ({run_id}) has no example {example_id!r}")
        out[int(number)] = known.T_receiver_donor
    return out


def unused_of(path: Path, run_id: str, courses: Sequence[Course]) -> list[str]:
    """A sentence on how many lines of a file of labels are about this evaluation, where not all are."""
    used, there = lines_about(path, {course.robot: recording_of(course) for course in courses}, run_id)
    if used == there:
        return []
    return [f"{used} of {there} lines of {path} are about these recordings or this evaluation; the others are left out"]


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """An evaluation with its id, which is that of a run but for the first letter: equal for equal contents, settings
    and procedures. ``pairs`` has the digest of each pair's two windows, by its number."""

    run_id: str
    provenance: RunProvenance
    essence: str
    tables: tuple[str, ...]
    pairs: tuple[str, ...]

    @classmethod
    def of(cls, files: Sequence[Path], bench: Bench, joints: Mapping[tuple[str, str], Transform]) -> Identified:
        """``joints`` are what persons have said of the recordings: other pairs may be drawn by that."""
        from mapgraft.job import essence_of, provenance_of

        tables = tuple(contender.table.source for contender in bench.contenders)
        provenance = provenance_of(files, bench.config, bench.plugins, bench.contenders[0].table)
        essence = essence_of(files, bench.config, provenance.inputs)
        content = {
            "config": essence,
            "settings": {**parameters_of(bench), "rules": None},  # its text is among the tables
            "tables": tables,
            "joints": [[*pair, *T.matrix.ravel().tolist()] for pair, T in sorted(joints.items())],
        }
        text = json.dumps(content, sort_keys=True)
        run_id = "e" + run_id_of(dataclasses.replace(provenance, config_text=text))[1:]
        contents = contents_of(files, bench.config, provenance.inputs)
        pairs = tuple(
            pair_sha256(*(_source_of(window, contents) for window in (plan.receiver, plan.donor)))
            for plan in bench.plans
        )
        return cls(run_id, provenance, essence, tables, pairs)

    @contextmanager
    def writing(self, out: Path) -> Iterator[Callable[[Judged], Judged]]:
        """Gives what takes the examples from each pair; they are in the folder when this is left without an error, all
        of them or none.

        Raises OutputError when the folder cannot be written.
        """
        if (out / DATASET).is_file():
            raise OutputError(f"{out} holds a dataset, which 'mapgraft dataset' writes: choose another folder")
        with locked(out), writing(out):
            staging = Staging(out)
            part = PartWriter(staging, NAME, self.run_id)
            try:
                yield _Taker(self, part)
                part.close()
            except BaseException:
                part.abandon()
                staging.remove()
                self._remove_empty(out)
                raise
            staging.publish(gone=other_parts(out, NAME, self.run_id, staging.names))

    def _remove_empty(self, out: Path) -> None:
        """Take away the folders that were made for examples which are not to come."""
        with suppress(OSError):  # somebody else's are in there
            (out / NAME / f"run_id={self.run_id}").rmdir()
            (out / NAME).rmdir()


@dataclass(slots=True, eq=False)
class _Taker:
    """Writes the examples of each pair, and leaves them out of what is kept."""

    identified: Identified
    part: PartWriter
    written: int = 0

    def __call__(self, judged: Judged) -> Judged:
        told, rows = self.identified, []
        common = {
            "software": told.provenance.version,
            "config_sha256": _sha256(told.essence),
            "recording_sha256": [file.sha256 for file in told.provenance.inputs],
            "pair_sha256": told.pairs[judged.number],
        }
        for row, table in zip(judged.examples, told.tables, strict=True):
            rows.append({**row, **common, "table_sha256": _sha256(table), "position": self.written})
            self.written += 1
        self.part.append(examples_table(rows))
        return dataclasses.replace(judged, examples=())


def _source_of(window: Window, contents: Mapping[Path, str]) -> str:
    first, last = window.observations[0], window.observations[-1]
    return source_of(contents, window.course.files, window.course.robot, first.recorded_ns, last.recorded_ns)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
