"""Runs that are killed at many instants: is a decision lost, and does the run end the same when started again?

Run on demand: ``python tests/bench/bench_kill.py [--instants 200] [--seconds 900] [--jobs 1] [--keep FOLDER]``. The
demo's robots drive their routes again and again for that long (of data time); two undisturbed runs, which have to be
the same, tell what the others have to end with. With ``--keep`` the outcomes are written down as they come, and the
same command goes on where it was ended. Of the instants

* one half lies **inside a write** between the first event and the last one: the process itself counts what it does to
  the files of its folder, puts the first half of the bytes of the chosen write there, and kills itself (SIGKILL),
* three tenths at any time between the two, by a SIGKILL from outside,
* a tenth in any step (write, sync, rename, removal) before the first event, a tenth in any step after the last one.

A decision is reported when a sink of the caller hears of it. It is lost when no recording in the folder tells of it
with everything the undisturbed run says of it. The run that is started again must end with the same files, byte for
byte; the table ``timings`` is left out, and the wall clock stands still, because these alone tell of time.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "toys"))

from tearing import WRITE, counted

import mapgraft
import mapgraft.job
from mapgraft.contracts import Observation
from mapgraft.events import Event, Snapshot
from mapgraft.outputs.lock import LOCK
from mapgraft.outputs.read_back import read_events
from mapgraft.outputs.run_folder import ROUTINE
from mapgraft.outputs.staging import SUFFIX
from mapgraft_recordings.generate import DEMO
from mapgraft_recordings.mission import build_mission, load_mission_plan
from mapgraft_recordings.simulator import load_plan, ros_messages, simulate
from mapgraft_recordings.writing import write_mcap

PATIENCE_S = 3600.0  # for one run


# the process that is killed


class StandingClock(datetime):
    """The run's provenance tells when it was started."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> StandingClock:
        return cls(2026, 1, 1, tzinfo=UTC)


class Reporter:
    """Tells every event to a file as soon as it is heard of: number, kind, step at which the writer is, time."""

    def __init__(self, path: Path, steps: Any) -> None:
        self._file, self._steps = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), steps

    def observed(self, observation: Observation) -> None:
        pass

    def mapped(self, snapshot: Snapshot) -> None:
        pass

    def happened(self, event: Event) -> None:
        os.write(self._file, f"{event.seq} {event.kind} {len(self._steps.kinds)} {time.monotonic()}\n".encode())


def child(recordings: Path, out: Path, fatal: int | None) -> None:
    vars(mapgraft.job)["datetime"] = StandingClock
    files = sorted(recordings.glob("*.mcap"))
    with counted(out, fatal) as steps:
        mapgraft.run(files, DEMO / "config.yaml", out, sinks=[Reporter(told_of(out), steps)])
    out.with_name(out.name + ".steps").write_text(json.dumps(steps.kinds))


# the one that looks on


class Told(NamedTuple):
    """What was reported of an event; ``step`` is the one that came next, ``at_s`` on the clock of the process."""

    seq: int
    kind: str
    step: int
    at_s: float


@dataclasses.dataclass(frozen=True, slots=True)
class Instant:
    """Where a run ends: in a step of its own, or so many seconds after it has reported so many events."""

    name: str
    step: int | None = None
    events: int = 0
    after_s: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    instant: Instant
    killed: bool
    between: bool  # after its first event and before its last one
    lost: int
    same: bool
    again_s: float

    @classmethod
    def of(cls, line: str) -> Outcome:
        told = json.loads(line)
        return cls(**(told | {"instant": Instant(**told["instant"])}))


@dataclasses.dataclass(slots=True)
class Bench:
    recordings: Path
    folder: Path
    reference: Path
    events: list[Event] = dataclasses.field(default_factory=list)
    files: dict[str, bytes] = dataclasses.field(default_factory=dict)

    def try_at(self, number: int, instant: Instant) -> Outcome:
        out = self.folder / f"{number:03d}"
        shutil.rmtree(out, ignore_errors=True)  # of an instant that was begun before, as was what it told
        told_of(out).unlink(missing_ok=True)
        process = begin(self.recordings, out, instant.step)
        if instant.step is None:
            wait_for(told_of(out), instant.events, process)
            time.sleep(instant.after_s)
            process.send_signal(signal.SIGKILL)
        killed = process.wait(PATIENCE_S) == -signal.SIGKILL
        reported = read_told(out)
        told_by = readable(out)
        lost = sum(self.is_lost(told.seq, told_by) for told in reported if told.kind not in ROUTINE)
        began_s = time.perf_counter()
        done = begin(self.recordings, out, None).wait(PATIENCE_S) == 0
        again_s = time.perf_counter() - began_s
        same = done and contents(out) == self.files and not list(out.rglob(f"*{SUFFIX}"))
        between = 0 < len(reported) < len(self.events)
        if same:
            shutil.rmtree(out)
        return Outcome(instant, killed, between, lost, same, again_s)

    def is_lost(self, seq: int, recordings: list[list[Event]]) -> bool:
        """Whether no recording tells of an event as the undisturbed run does."""
        return not any(len(told) > seq and repr(told[seq]) == repr(self.events[seq]) for told in recordings)


def readable(out: Path) -> list[list[Event]]:
    return [read_events(path) for path in sorted(out.glob("*.merge.mcap*")) if path.stat().st_size]


def begin(recordings: Path, out: Path, fatal: int | None) -> subprocess.Popen[bytes]:
    step = [] if fatal is None else [str(fatal)]
    return subprocess.Popen([sys.executable, __file__, "--child", str(recordings), str(out), *step])


def wait_for(told: Path, events: int, process: subprocess.Popen[bytes]) -> None:
    while process.poll() is None and (not told.exists() or told.read_bytes().count(b"\n") < events):
        time.sleep(0.02)


def told_of(out: Path) -> Path:
    return out.with_name(out.name + ".told")


def read_told(out: Path) -> list[Told]:
    """Every event that was reported."""
    if not told_of(out).exists():
        return []
    rows = [line.split() for line in told_of(out).read_text().splitlines()]
    return [Told(int(seq), kind, int(step), float(at_s)) for seq, kind, step, at_s in rows]


def contents(out: Path) -> dict[str, bytes]:
    return {
        name: path.read_bytes()
        for path in out.rglob("*")
        if path.is_file() and not (name := path.relative_to(out).as_posix()).startswith("timings/") and name != LOCK
    }


def record(folder: Path, seconds: float) -> None:
    """The demo's robots, driving their routes again and again."""
    mission = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), 0)
    folder.mkdir()
    for robot in mission.robots:
        endless = dataclasses.replace(robot, loop=True)
        write_mcap(
            folder / f"{robot.name}.mcap", ros_messages([endless], simulate(mission.world, [endless], 0, seconds))
        )


def choose(count: int, kinds: list[str], told: list[Told], seed: int) -> list[Instant]:
    """The instants, by chance; writes and times lie between the first and the last event."""
    chance, first, last = random.Random(seed), told[0], told[-1]
    writes = [step for step in range(first.step, last.step) if kinds[step] == WRITE]
    instants = [Instant("inside a write", step=chance.choice(writes)) for _ in range(count // 2)]
    for _ in range(count * 3 // 10):
        at_s = chance.uniform(first.at_s, last.at_s)
        before = [one.at_s for one in told if one.at_s <= at_s]
        instants.append(Instant("between the events", events=len(before), after_s=at_s - before[-1]))
    outside = {"before the first event": range(first.step), "after the last event": range(last.step, len(kinds))}
    while len(instants) < count:
        name = sorted(outside)[len(instants) % 2]
        instants.append(Instant(name, step=chance.choice(outside[name])))
    return instants


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instants", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=900.0, help="data time of the recording")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="keep everything there, and go on with what is there")
    parser.add_argument("--child", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(Path(given.child[0]), Path(given.child[1]), int(given.child[2]) if given.child[2:] else None)
        return
    folder = given.keep or Path(tempfile.mkdtemp(prefix="killed-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        look_on(folder, given)
    finally:
        if given.keep is None:
            shutil.rmtree(folder)


def look_on(folder: Path, given: argparse.Namespace) -> None:
    recordings, reference, written = folder / "recordings", folder / "undisturbed", folder / "outcomes.jsonl"
    if not (folder / "run_s").exists():
        record(recordings, given.seconds)
        assert begin(recordings, folder / "first", None).wait(PATIENCE_S) == 0  # compiles the kernels where needed
        began_s = time.perf_counter()
        assert begin(recordings, reference, None).wait(PATIENCE_S) == 0
        (folder / "run_s").write_text(str(time.perf_counter() - began_s))
    run_s, told = float((folder / "run_s").read_text()), read_told(reference)
    kinds = json.loads((folder / "undisturbed.steps").read_text())
    (events,) = readable(reference)
    print(f"undisturbed: {run_s:.0f} s, {len(events)} events, {len(kinds)} steps, {kinds.count(WRITE)} of them writes")
    bench = Bench(recordings, folder, reference, events, contents(reference))
    assert contents(folder / "first") == bench.files
    instants = choose(given.instants, kinds, told, given.seed)
    outcomes = [Outcome.of(line) for line in written.read_text().splitlines()] if written.exists() else []
    left = range(len(outcomes), len(instants))
    with ThreadPoolExecutor(given.jobs) as pool, written.open("a") as file:
        for outcome in pool.map(bench.try_at, left, instants[left.start :]):
            outcomes.append(outcome)
            print(json.dumps(dataclasses.asdict(outcome)), file=file, flush=True)
            if outcome.lost or not outcome.same or not outcome.killed:
                print(f"  {len(outcomes) - 1}: {outcome}")
    tell(outcomes, run_s)


def tell(outcomes: list[Outcome], run_s: float) -> None:
    for name in dict.fromkeys(outcome.instant.name for outcome in outcomes):
        print(f"{name}: {summed([outcome for outcome in outcomes if outcome.instant.name == name])}")
    again_s = sum(outcome.again_s for outcome in outcomes) / len(outcomes)
    print(f"all: {summed(outcomes)}")
    print(f"started again it took {again_s:.0f} s on average, undisturbed {run_s:.0f} s")
    if not all(outcome.killed and outcome.same and not outcome.lost for outcome in outcomes):
        sys.exit(1)


def summed(outcomes: list[Outcome]) -> str:
    counts = {
        "killed": sum(outcome.killed for outcome in outcomes),
        "between first and last event": sum(outcome.between for outcome in outcomes),
        "decisions lost": sum(outcome.lost for outcome in outcomes),
        "same in the end": sum(outcome.same for outcome in outcomes),
    }
    return ", ".join([str(len(outcomes)), *(f"{name} {count}" for name, count in counts.items())])


if __name__ == "__main__":
    main()
