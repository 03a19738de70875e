"""The main job as one call: files and a configuration in, a result out, everything written on the way."""

from __future__ import annotations

import hashlib
import io
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ruamel.yaml import YAML

from mapgraft import __version__
from mapgraft.assembly import Assembly, assemble
from mapgraft.audit import Finding, audit
from mapgraft.config import Config, load_config, parse_config
from mapgraft.contracts import Observation
from mapgraft.correction import Correction
from mapgraft.decision import DecisionTable, build_table
from mapgraft.errors import PluginError, RecordingError, UsageError
from mapgraft.events import Event, Sink, Snapshot
from mapgraft.failures import failure_sentences
from mapgraft.guard import Guard
from mapgraft.network.radio import Traffic
from mapgraft.outputs.provenance import InputFile, RunProvenance, run_id_of
from mapgraft.outputs.run_output import OpenOutput, RunOutput
from mapgraft.plugins import Plugins, load_plugins
from mapgraft.remember import MISSION_FILE, essence_text, inputs_of, remembered_text
from mapgraft.replay import Entry, begun, replay
from mapgraft.robot import Robot
from mapgraft.stand_ins import NONE, StandIns
from mapgraft.stopwatch import Stopwatch

if TYPE_CHECKING:
    import pyarrow as pa

    from mapgraft.recording.losses import Loss
    from mapgraft.recording.mission import Mission


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a run.

    ``maps`` holds every robot's last snapshot: ``maps["alpha"].fused.dense()`` for a grid. ``traffic`` counts bytes per
    (sender, receiver), ``kinds`` per (receiver, kind of message). ``start_ns`` is the mission's first stamp. ``lost``
    says in sentences what of the files could not be read and which observations could not be used, and why;
    ``remarks`` what was noticed about the robots' sources, such as a map file that is probably not meant as it says;
    ``failed`` which plugins failed. ``ledgers`` holds what ``verify_ledger`` found out, one finding per robot.
    """

    run_id: str
    folder: Path | None
    events: Sequence[Event]
    maps: Mapping[str, Snapshot]
    observations: int
    traffic: Mapping[tuple[str, str], int]
    start_ns: int = 0
    lost: Sequence[str] = ()
    remarks: Sequence[str] = ()
    failed: Sequence[str] = ()
    ledgers: Sequence[Finding] = ()
    kinds: Mapping[tuple[str, str], int] = field(default_factory=dict)

    @property
    def events_table(self) -> pa.Table:
        """One row per event, in the schema of ``events/``."""
        from mapgraft.outputs.tables import events_table

        return events_table(self.events)

    @property
    def metrics_table(self) -> pa.Table:
        """One row per measurement, in the schema of ``metrics/``."""
        from mapgraft.outputs.tables import metrics_table

        return metrics_table(self.events)

    @property
    def transforms_table(self) -> pa.Table:
        """One row per pair of robots that standing merges connect."""
        from mapgraft.outputs.tables import transforms_table

        return transforms_table(self.events)

    @property
    def standing(self) -> Mapping[str, Event]:
        """The last event of every merge that stands at the end, by merge id."""
        last = self._last()
        return {merge_id: event for merge_id, event in last.items() if event.state in ("provisional", "confirmed")}

    @property
    def attached(self) -> Mapping[str, Event]:
        """The last event of every layer that is in a map at the end through merges of others, by its id."""
        return {merge_id: event for merge_id, event in self._last().items() if event.state == "attached"}

    def _last(self) -> dict[str, Event]:
        return {event.merge_id: event for event in self.events if event.merge_id}


@dataclass(slots=True)
class Fan:
    """A sink that hands everything to several, and remembers every robot's last snapshot."""

    sinks: list[Sink]
    last: dict[str, Snapshot] = field(default_factory=dict)

    def observed(self, observation: Observation) -> None:
        for sink in self.sinks:
            sink.observed(observation)

    def happened(self, event: Event) -> None:
        for sink in self.sinks:
            sink.happened(event)

    def mapped(self, snapshot: Snapshot) -> None:
        self.last[snapshot.robot] = snapshot
        for sink in self.sinks:
            sink.mapped(snapshot)


def run(
    files: Sequence[Path | str] | Path | str = (),
    config: Config | Mapping[str, Any] | Path | str | None = None,
    out: Path | str | OpenOutput | None = None,
    *,
    plugins: Plugins | None = None,
    sinks: Sequence[Sink] = (),
    opened: Callable[[int, int], None] | None = None,
    verify_ledger: bool = False,
    stand_ins: StandIns = NONE,
) -> Result:
    """Replay recordings, merge the robots' maps, and write everything to ``out``: a folder, or what opens an output.

    Without files the embedded demo recording is replayed; a single path is a list of one. ``config`` is a Config, a
    mapping, or the path of a YAML or TOML file. ``sinks`` get everything that happens, too;
    ``opened`` is told the first and last stamp (ns) of what will be replayed. With ``verify_ledger`` the recording is
    read once more, and every layer and fused map is compared with one computed anew. ``stand_ins`` tell of files that
    are not on this machine. Raises MapgraftError with one sentence; what was decided before is on disk.
    """
    from mapgraft.examples.of_run import collecting
    from mapgraft.recording.losses import losses
    from mapgraft.recording.mission import open_mission
    from mapgraft.recording.naming import stem

    paths, checked = _asked(files, config)
    plugins, watch = plugins or load_plugins(), Stopwatch()
    with ExitStack() as stack:
        with watch.stage("opening"):
            mission = stack.enter_context(open_mission(paths, checked, plugins=plugins, octets=stand_ins.octets))
            stack.enter_context(mission.guard.armed())
            table = build_table(plugins, checked.rules)
            provenance, run_id = identify(paths, checked, plugins, table, stand_ins.known)
            fan = Fan(list(sinks))
            assembly = assemble(mission, checked, plugins, table, fan)
        timeline = _begun(mission, watch)  # before the folder is touched: all this may refuse
        folder = collector = None
        if out is not None:
            folder = _output(out, checked, assembly.exchange.guard)(stem(paths[0]), run_id, provenance)
            if checked.output.examples:
                essence = essence_of(paths, checked, provenance.inputs)
                made = (paths, mission, assembly, provenance, checked, essence)
                collector = collecting(*made, folder.exemplified)  # which may refuse, too
                fan.sinks.insert(0, collector)
            stack.push(folder)  # before it is opened: Ctrl-C in between would leave a recording without an end
            fan.sinks.insert(0, folder.open())  # what anybody else hears of is on disk
            folder.keep(MISSION_FILE, remembered_text(paths, checked).encode())
        if opened is not None:
            opened(*_span_of(mission, checked))
        count = _replayed(timeline, assembly, fan, watch)
        if collector is not None:
            collector.finish()
        if folder is not None:
            _write_maps(folder, assembly, fan)
        lost, missing = _lost(mission, assembly), losses(mission)  # before the files are read once more
        remarks = (*_remarks(mission, assembly), *(collector.undrawn if collector else ()))
        failed = tuple(failure_sentences(assembly.history.events, assembly.exchange.guard, mission.start_ns))
        ledgers = _audited(mission, assembly, checked, plugins) if verify_ledger else []
        if folder is not None:
            _tell_costs(folder, watch, assembly.exchange.traffic)
            _tell_rest(folder, (*remarks, *failed, *lost), missing, ledgers)
            folder.finish()
        return Result(
            run_id=run_id,
            folder=Path(out) if isinstance(out, Path | str) else None,
            events=assembly.history.events,
            maps=fan.last,
            observations=count,
            traffic=assembly.exchange.traffic.sent,
            kinds=assembly.exchange.traffic.received,
            start_ns=mission.start_ns,
            lost=(*lost, *(folder.unshown if folder else ())),
            remarks=(*remarks, *(folder.unfinished if folder else ())),
            failed=failed,
            ledgers=tuple(ledgers),
        )


def _output(out: Path | str | OpenOutput, config: Config, guard: Guard) -> OpenOutput:
    """What opens a run's output: a folder, where one is named."""
    from mapgraft.outputs.run_folder import RunFolder

    if callable(out):
        return out
    wanted = {name: getattr(config.output, name) for name in ("scans", "report", "examples")}
    return partial(RunFolder, Path(out), guard=guard, **wanted)


def _asked(
    files: Sequence[Path | str] | Path | str, config: Config | Mapping[str, Any] | Path | str | None
) -> tuple[list[Path], Config]:
    """The files to replay, those of the demo where none is named, and a checked configuration."""
    if not files:
        files, demo_config = demo()
        config = demo_config if config is None else config
    listed = [files] if isinstance(files, Path | str) else files
    return [Path(file) for file in listed], as_config(config)


def _lost(mission: Mission, assembly: Assembly) -> list[str]:
    """What could not be used: by the recording's fault, or because a map type refused it."""
    from mapgraft.recording.losses import fault_sentences

    refused = [line for name, robot in assembly.robots.items() for line in robot.left_out.sentences(name)]
    return [*fault_sentences(mission.faults), *mission.tally.sentences(), *refused]


def _write_maps(folder: RunOutput, assembly: Assembly, fan: Fan) -> None:
    """Write the maps' files while events can still tell of a map type that fails at it."""
    folder.write_maps()
    for robot, error in assembly.exchange.guard.take_untold():
        assembly.robots[robot].complain(error, fan.last[robot].stamp_ns)


def _audited(mission: Mission, assembly: Assembly, config: Config, plugins: Plugins) -> list[Finding]:
    kinds = {robot.name: robot.kinds for robot in mission.robots}
    return audit(mission.timeline(), kinds, assembly.robots, config, plugins, mission.guard)


def _remarks(mission: Mission, assembly: Assembly) -> list[str]:
    """What was noticed about the robots' sources and messages, and which verdicts of persons nobody needed."""
    remarks = [f"{robot.name}: {remark}" for robot in mission.robots for remark in robot.remarks]
    return [*remarks, *assembly.exchange.traffic.sentences()] + [
        f"the verdict '{verdict.action}' on {verdict.merge} was not needed: no such merge came up"
        for verdict in assembly.hand.disregarded
    ]


def _span_of(mission: Mission, config: Config) -> tuple[int, int]:
    """The first and last stamp on the mission's timeline that the configuration lets through."""
    start_s, end_s = config.mission.start_s or 0.0, config.mission.end_s
    end_ns = mission.end_ns if end_s is None else min(mission.end_ns, mission.start_ns + round(end_s * 1e9))
    return mission.start_ns + round(start_s * 1e9), end_ns


def _begun(mission: Mission, watch: Stopwatch) -> Iterator[Entry]:
    """The timeline, read as far as its first observation; raises RecordingError when there is none."""
    from mapgraft.recording.mission import nothing_to_map

    with watch.stage("replaying", 0):
        if (timeline := begun(watch.waiting("reading", mission.timeline()))) is not None:
            return timeline
    raise RecordingError(nothing_to_map(mission))


def _replayed(timeline: Iterator[Entry], assembly: Assembly, sink: Sink, watch: Stopwatch) -> int:
    """Replay a mission and time it; raises RecordingError when no observation could be mapped."""
    assembly.exchange.watch = watch
    watch.add("exchanging", 0.0, 0)  # also where nobody meets
    with watch.stage("replaying", 0):
        count = replay(timeline, assembly.robots, assembly.exchange, sink)
    if all(robot.left_out.count and not robot.reversal.version for robot in assembly.robots.values()):
        reasons = "; ".join(line for name, robot in assembly.robots.items() for line in robot.left_out.sentences(name))
        raise RecordingError(f"nothing was mapped: {reasons}")
    within_s = watch.elapsed_s("reading") + watch.elapsed_s("exchanging")
    watch.add("observing", watch.elapsed_s("replaying") - within_s, count)
    watch.add("replaying", 0.0, count)
    return count


def _tell_costs(folder: RunOutput, watch: Stopwatch, traffic: Traffic) -> None:
    """What the run took and what passed between the robots, for its folder."""
    stages = {stage.name: stage for stage in watch.stages}
    for name in ("opening", "replaying", "reading", "observing", "exchanging"):
        folder.timed(name, stages[name].elapsed_s, stages[name].count)
    folder.carried(traffic)


def _tell_rest(folder: RunOutput, remarks: Sequence[str], missing: Sequence[Loss], ledgers: Sequence[Finding]) -> None:
    """What was noticed, what could not be used, and how the ledgers fared, for its folder."""
    folder.noticed(remarks)
    folder.lost([asdict(loss) for loss in missing])
    folder.audited([asdict(finding) for finding in ledgers])


def map_alone(files: Sequence[Path], config: Config, plugins: Plugins, table: DecisionTable) -> Mapping[str, Robot]:
    """The robots of a recording after their last observation, none of whom has met another."""
    from mapgraft.outputs.null_sink import NullSink
    from mapgraft.recording.mission import open_mission

    with open_mission(files, config, plugins=plugins) as mission, mission.guard.armed():
        robots = assemble(mission, config, plugins, table, NullSink()).robots
        for entry in mission.timeline():
            if isinstance(entry, Correction):
                robots[entry.robot].correct(entry)
            elif isinstance(entry, Observation):
                robots[entry.robot].observe(entry)
    if failed := next((robot.failed for robot in robots.values() if robot.failed), None):
        raise PluginError(failed)
    return robots


def as_config(given: Config | Mapping[str, Any] | Path | str | None) -> Config:
    """A checked configuration from whatever form it comes in; raises ConfigError with every fault."""
    if isinstance(given, Config):
        return given
    if isinstance(given, Path | str):
        return load_config(Path(given))
    return parse_config(given or {})


def demo(name: str | None = None) -> tuple[list[Path], Path]:
    """An embedded demo recording and its configuration, the first one where none is named.

    Raises UsageError where the demos are not installed, or there is none of that name.
    """
    try:
        from mapgraft_recordings import DEMOS, demo_files
    except ImportError as error:
        raise UsageError(f"the demo recording is not installed ({error}): name a recording") from None
    if name is not None and name not in DEMOS:
        raise UsageError(f"there is no demo {name!r}: choose one of {', '.join(DEMOS)}")
    files, config, _expected = demo_files(DEMOS[0] if name is None else name)
    return files, config


def identify(
    paths: Sequence[Path],
    config: Config,
    plugins: Plugins,
    table: DecisionTable,
    known: Mapping[Path, InputFile] | None = None,
) -> tuple[RunProvenance, str]:
    """What a run is made of, and its id: the same for the same contents, whatever persons said of the outcome.

    Files that are ``known`` are not read for it.
    """
    provenance = provenance_of(paths, config, plugins, table, known=known)
    return provenance, run_id_of(replace(provenance, config_text=essence_of(paths, config, provenance.inputs)))


def provenance_of(
    paths: Sequence[Path],
    config: Config,
    plugins: Plugins,
    table: DecisionTable,
    clock: datetime | None = None,
    known: Mapping[Path, InputFile] | None = None,
) -> RunProvenance:
    """What a run is made of. ``clock`` is when it was started (default: now)."""
    known = known or {}
    origins = {offered.origin for offered in plugins.offered.values()}
    return RunProvenance(
        version=__version__,
        config_text=config_text(config),
        decision_table_text=table.source,
        inputs=[known.get(path) or input_file(path) for path in inputs_of(paths, config)],
        started_at=clock or datetime.now(UTC),
        host=platform.node(),
        plugins={origin.plugin: f"{origin.distribution} {origin.version}" for origin in origins},
    )


def essence_of(paths: Sequence[Path], config: Config, inputs: Sequence[InputFile]) -> str:
    """The configuration as it goes into the run's id: where files lie, and what persons say, makes no other run."""
    identities = dict(zip(inputs_of(paths, config), (file.identity for file in inputs), strict=True))
    return essence_text(paths, config, identities)


def config_text(config: Config) -> str:
    """The configuration as YAML with every default filled in."""
    buffer = io.StringIO()
    YAML(typ="safe", pure=True).dump(config.model_dump(mode="json"), buffer)
    return buffer.getvalue()


def input_file(path: Path) -> InputFile:
    """What a file is, or everything in a folder in the order of the names; it is read whole."""
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    digest, size = hashlib.sha256(), 0
    for file in files:
        with file.open("rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
        size += file.stat().st_size
    return InputFile(str(path), digest.hexdigest(), size)
