"""The output folder of one run: everything the replay tells goes into files that survive a killed run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pyarrow as pa

from mapgraft.contracts import Observation
from mapgraft.errors import OutputError
from mapgraft.events import Event, Snapshot
from mapgraft.guard import Guard
from mapgraft.network.radio import Traffic
from mapgraft.outputs.asking import Asking
from mapgraft.outputs.fence import lies_in
from mapgraft.outputs.files import Tally, Trajectories, connected, json_bytes, map_files, transforms_csv
from mapgraft.outputs.findings import FINDINGS, LatestFindings
from mapgraft.outputs.lock import RUN, FolderLock, require_kind
from mapgraft.outputs.mcap_log import McapLog
from mapgraft.outputs.names import file_names
from mapgraft.outputs.parquet_log import WRITTEN, ParquetLog, PartWriter, other_parts
from mapgraft.outputs.poses import Pose, paths_of
from mapgraft.outputs.provenance import RunProvenance, is_run_id
from mapgraft.outputs.scene import Scene
from mapgraft.outputs.staging import Staging, close_quietly, sync_folder, writing
from mapgraft.outputs.standing import StandingMerges
from mapgraft.outputs.unfinished import end_at, make_room, set_aside
from mapgraft.stopwatch import Stopwatch
from mapgraft_schemas import VERSION

MERGE_RECORDING = ".merge.mcap"  # after the stem
ROUTINE = ("offered", "verified")  # events that wait for the next decision to be brought to disk
SUMMARY = RUN
REPORT = "report.html"
WRITING = "writing"  # the stage of a run that is spent here
_BATCH = 512  # poses and events that wait to be written together
_OURS = ("maps/", "trajectories/", FINDINGS)  # files of an earlier run that are taken away when this one has none


class RunFolder:
    """A sink that writes ``<stem>.merge.mcap``, Parquet tables, maps, trajectories, transforms and a summary.

    Everything is written under ``.partial`` names, from ``open`` on. A decision is on disk when ``happened`` returns.
    ``finish`` renames everything at once; ``abort`` leaves the partial files behind, from which ``read_events`` reads
    every decision. As a context manager it opens, and finishes, or aborts when an error came through; who must not
    lose a recording to Ctrl-C between the two sees to it that ``__exit__`` is called before calling ``open``.
    Tables of other runs in the folder stay.
    What an unfinished run had decided stays readable until the same run is finished here.
    With ``report`` the page of the run is made when all else is published, from what is in the folder then.
    ``guard`` watches map types while they are asked for messages and files. With ``examples`` there is a table of
    these, for ``exemplified``.

    Raises OutputError when the folder cannot be written, or when another run is writing it.
    """

    def __init__(
        self,
        out: Path,
        stem: str,
        run_id: str,
        provenance: RunProvenance,
        scans: bool = False,
        report: bool = False,
        guard: Guard | None = None,
        examples: bool = False,
    ) -> None:
        if not is_run_id(run_id):
            raise OutputError(f"a run id is a letter and then letters, digits, '_' and '-', found {run_id!r}")
        self._out, self._run_id, self._provenance = out, run_id, provenance
        self._scans, self._report, self._examples = scans, report, examples
        self._asking = Asking(guard or Guard())
        self._stem, self._mcap_name = stem, f"{stem}{MERGE_RECORDING}"
        self._queue: list[Pose | tuple[int, Event]] = []
        self._snapshots: dict[str, Snapshot] = {}
        self._standing, self._scene, self._tally = StandingMerges(), Scene(), Tally()
        self._found = LatestFindings()
        self._names = file_names()
        self._traffic = Traffic()
        self._lost: list[Mapping[str, str | int]] = []
        self._unshown: dict[str, str] = {}
        self._ledgers: list[dict[str, Any]] = []
        self._remarks: tuple[str, ...] = ()
        self._aside: Mapping[str, str] = {}
        self._watch = Stopwatch()
        self._intact, self._open, self._published, self._maps_written = True, False, False, False
        self._lock, self._staging = FolderLock(out), Staging(out)
        self._trajectories = Trajectories(self._staging, self._names)
        self._held: list[Callable[[], None]] = []  # gives back what is open; the last one first

    def open(self) -> Self:
        """Begin to write. Whatever comes through on the way, even Ctrl-C, leaves nothing of what was begun.

        Raises OutputError when the folder cannot be written, or when another run is writing it.
        """
        with writing(self._out):
            try:
                self._begin()
                self._open = True  # from here on abort leaves a recording that is whole
            except BaseException:
                self._open = False
                self._let_go()
                self._staging.remove()
                raise
        return self

    def _begin(self) -> None:
        out = self._out
        require_kind(out, RUN)
        out.mkdir(parents=True, exist_ok=True)
        self._held.append(self._lock.give_back)
        self._lock.take()
        make_room(out, self._stem, MERGE_RECORDING)
        self._aside = set_aside(out, MERGE_RECORDING)
        self._stream = self._staging.create(self._mcap_name)
        self._held.append(lambda: close_quietly(self._stream))
        self._mcap = McapLog(self._stream, self._run_id, self._provenance, self._asking)
        self._parquet = ParquetLog(self._staging, self._run_id, self._examples)
        self._held.append(self._parquet.abandon)
        sync_folder(out)  # the recording has a name after a power cut, too

    def observed(self, observation: Observation) -> None:
        queue = self._queue
        queue.append((len(queue), observation.robot, observation.stamp_ns, observation.T_map_base.matrix))
        if self._scans or len(queue) >= _BATCH:
            with self._writing():
                self._drain()
                if self._scans:
                    self._mcap.scanned(observation)

    def happened(self, event: Event) -> None:
        self._queue.append((len(self._queue), event))
        decided = event.kind not in ROUTINE
        if decided or len(self._queue) >= _BATCH:
            with self._writing():
                self._drain()
                if decided:
                    self._mcap.flush()

    def mapped(self, snapshot: Snapshot) -> None:
        with self._writing():
            self._drain()
            self._snapshots[snapshot.robot] = snapshot
            self._scene.grow(snapshot.robot, snapshot.metadata.bounds_m)
            self._place(snapshot.stamp_ns)
            self._mcap.mapped(snapshot)
            self._parquet.mapped(snapshot)

    def exemplified(self, rows: pa.Table) -> None:
        """Rows of the table of examples, in its schema."""
        with self._writing():
            self._parquet.exemplified(rows)

    def keep(self, name: str, data: bytes) -> None:
        """Put one more file beside the others when the run is finished."""
        with self._writing():
            self._staging.write(name, data)

    def timed(self, stage: str, elapsed_s: float, count: int = 0) -> None:
        """Wall clock that a stage of the run took; goes into the table ``timings`` and nowhere else."""
        self._parquet.timed(stage, elapsed_s, count)

    @property
    def unshown(self) -> list[str]:
        """Which maps could not be written because their type failed, in sentences; complete after ``finish``."""
        return [*self._mcap.unshown.values(), *self._unshown.values()]

    @property
    def unfinished(self) -> list[str]:
        """What other runs that did not come to their end have left in the folder, in sentences."""
        return [
            f"{self._out / name} tells what another run had decided before it was ended: remove it when nobody needs it"
            for name, run_id in self._aside.items()
            if run_id != self._run_id
        ]

    def audited(self, findings: list[dict[str, Any]]) -> None:
        """What was found out about the ledgers, for the summary."""
        self._ledgers = findings

    def carried(self, traffic: Traffic) -> None:
        """How many bytes went from each robot to each other, and what came for nothing, for the summary; the bytes also
        for the table ``traffic``."""
        self._traffic = traffic
        self._parquet.carried(traffic.bytes)

    def lost(self, losses: Sequence[Mapping[str, str | int]]) -> None:
        """What of the recordings could not be used: goes into the summary and into the merge recording's metadata.

        Each says ``where`` (file or robot), ``topic``, ``cause``, ``count``, and in a ``sentence`` what the first was.
        """
        self._lost = list(losses)

    def noticed(self, remarks: Sequence[str]) -> None:
        """What there is to say about the recordings and what of them was left out, in sentences, for the summary."""
        self._remarks = tuple(remarks)

    def write_maps(self) -> None:
        """Write the last map of every robot and component as its type's files; ``finish`` does where nobody has.

        Whoever calls it before can still tell of what fails.
        """
        if self._maps_written:
            return
        with self._writing():
            self._drain()
            together = connected(self._scene.robots, self._standing.merges)
            for name, content in map_files(self._snapshots, together, self._names, self._unshown, self._asking).items():
                self._staging.write(name, content)
        self._maps_written = True

    def finish(self) -> None:
        """Make everything whole, then give every file its final name; nothing of it is half-written at any time."""
        self.write_maps()
        with self._writing():
            with self._watch.stage(WRITING):
                self._drain()
                self._mcap.lost(self._lost)
                layout = self._mcap.close(self._scene.span_m())
                self._stream.close()
                self._trajectories.close()
                if not list(self._out.glob(f"labels/run_id={self._run_id}/*.parquet")):
                    PartWriter(self._staging, "labels", self._run_id).close()
                self._write_files(layout)
            for stage in self._watch.stages:
                self._parquet.timed(stage.name, stage.elapsed_s, stage.count)
            self._parquet.close(self._provenance.inputs)
            self._staging.publish(gone=self._leftovers())
            self._published = True
        try:
            if self._report:
                self._tell()
        finally:
            self._close()

    def abort(self) -> None:
        """Stop here: leave partial files that hold everything reported so far. Never raises for a folder that fails."""
        if not self._open:
            return
        try:
            if self._intact and not self._published:
                with suppress(OutputError), self._writing():
                    self._drain()
                    self._mcap.close(self._scene.span_m())
                    self._trajectories.close()
                    self._parquet.close(self._provenance.inputs)
        finally:
            close_quietly(self._stream)
            if not self._intact:  # what was being written when it failed goes; all that was on disk before stays
                with suppress(OSError):
                    end_at(self._staging.partial(self._mcap_name), self._mcap.durable, ended=self._mcap.ended)
            self._close()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._open:
                self.finish()
        finally:
            self.abort()  # does nothing after a finish that went well

    def _drain(self) -> None:
        """Write what waits, in order."""
        if not self._queue:
            return
        queue, self._queue = self._queue, []
        events = [(item[0], item[1]) for item in queue if len(item) == 2]
        paths = paths_of([item for item in queue if len(item) == 4])
        first, last = queue[0], queue[-1]
        for path in paths:
            self._scene.moved(path)
        self._place(first[1].stamp_ns if len(first) == 2 else first[2])
        self._mcap.went_on(paths, events)
        self._trajectories.moved(paths)
        changed = False
        for _, event in events:
            self._parquet.happened(event)
            self._tally.happened(event)
            changed |= self._standing.happened(event)
            if self._found.happened(event):
                self._mcap.found(event.stamp_ns, event.receiver, self._found.of_receiver(event.receiver))
        if changed:
            self._place(last[1].stamp_ns if len(last) == 2 else last[2], redraw=True)

    def _tell(self) -> None:
        """Write the page of the run; raises OutputError when that goes wrong, which takes nothing from the run."""
        from mapgraft.outputs.report import page_of, publish

        try:
            publish(self._out, page_of(self._out))
        except Exception as error:
            raise OutputError(
                f"the run is whole in {self._out}, but its {REPORT} could not be made: {error}; "
                "'mapgraft report' makes it without running again"
            ) from error

    def _place(self, stamp_ns: int, redraw: bool = False) -> None:
        """Say where the map frames lie when that has changed, and draw the merges."""
        merges = self._standing.merges
        placed = self._mcap.placed(stamp_ns, self._scene.place(merges))
        if (placed and merges) or redraw:
            self._mcap.linked(stamp_ns, merges, self._scene.bodies_m)

    def _write_files(self, layout: bytes) -> None:
        merges = self._standing.merges
        together = connected(self._scene.robots, merges)
        files = {"transforms.csv": transforms_csv(merges), "layout.json": layout}
        if (found := self._found.csv()) is not None:
            files[FINDINGS] = found
        for name, content in files.items():
            self._staging.write(name, content)
        robots = {robot: self._summary_of(robot) for robot in sorted(self._scene.robots)}
        unread = self._traffic.unread
        summary: dict[str, Any] = {
            "run_id": self._run_id,
            "version": self._provenance.version,
            "schema_version": VERSION,
            "robots": robots,
            "components": [{"name": c.name, "robots": list(c.robots), "map_of": c.map_of} for c in together],
            **self._tally.summary(),
            "bytes": [
                {"donor": donor, "receiver": receiver, "bytes": size}
                for (donor, receiver), size in self._traffic.sent.items()
            ],
            "bytes_by_kind": [
                {"receiver": receiver, "kind": kind, "bytes": size}
                for (receiver, kind), size in self._traffic.received.items()
            ],
            **({"unread": {name: one._asdict() for name, one in sorted(unread.items())}} if unread else {}),
            **({"ledgers": self._ledgers} if self._ledgers else {}),
            **({"unshown": self.unshown} if self.unshown else {}),
            "lost": self._lost,
            "remarks": list(self._remarks),
            "files": [name for name in self._staging.names if "/run_id=" not in name],
        }
        self._staging.write(SUMMARY, json_bytes(summary))  # the last one renamed: who finds it finds all others

    def _summary_of(self, robot: str) -> dict[str, Any]:
        out = {"files_as": self._names[robot], **self._trajectories.summary(robot)}
        snapshot = self._snapshots.get(robot)
        if snapshot is not None:
            out |= {
                "map_type": snapshot.map_type.name,
                "resolution_m": snapshot.metadata.resolution_m,
                "known_own": snapshot.own.known(),
                "known_fused": snapshot.fused.known(),
            }
        return out

    def _leftovers(self) -> list[str]:
        """What an earlier writing of this folder had and this one has not, so that nobody takes it for today's."""
        new = self._staging.names
        earlier = [name for name in _files_of(self._out) if _is_of_one_run(name)]
        gone = [REPORT, *(name for name in earlier if name not in new)]  # the page tells of what is replaced now
        for table in WRITTEN:
            gone += other_parts(self._out, table, self._run_id, new)
        return gone + [name for name, run_id in self._aside.items() if run_id == self._run_id]

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Marks the folder as broken when anything comes through: then nothing more is written to it."""
        if not (self._open and self._intact):
            raise OutputError(f"{self._out} is closed or has failed before: start a new run to write to it")
        self._intact = False
        with self._watch.stage(WRITING), writing(self._out):
            yield
        self._intact = True

    def _close(self) -> None:
        self._let_go()
        self._open = False

    def _let_go(self) -> None:
        while self._held:
            self._held[-1]()  # which does no harm twice
            self._held.pop()


def _is_of_one_run(name: str) -> bool:
    """Whether a file of an earlier run tells of that run alone, and goes where this one has none of that name."""
    is_recording = name.endswith(MERGE_RECORDING) and "/" not in name
    return is_recording or (name.startswith(_OURS) and "/run_id=" not in name)


def _files_of(out: Path) -> list[str]:
    """The files that the summary of an earlier run lists; none when there is no summary that can be read."""
    try:
        listed = json.loads((out / SUMMARY).read_text(encoding="utf-8"))["files"]
        return [name for name in listed if lies_in(out, name)]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
