"""A corpus of simulated missions on one and on two local workers: throughput, and what it costs to find it all there.

    python tests/bench/bench_corpus.py --missions 64 --rounds 8 --folder /tmp/missions

The missions are made once and kept in the folder. Both crews are there all the time and take turns, a part of the
missions each time, so that what else goes on on the machine meets both. Their start is measured apart. Each process
has a session of its own: Linux shares processors out by sessions first, and where others compute, too, two processes of
one session get no more than one.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from concurrent.futures import Executor, wait
from contextlib import suppress
from pathlib import Path

from mapgraft.corpus import Job, run_corpus
from mapgraft.corpus.crew import Crew
from mapgraft.corpus.document import read_plan
from mapgraft.recording.writing import convert
from mapgraft_recordings.buildings.building import building
from mapgraft_recordings.buildings.carmen import write_carmen
from mapgraft_recordings.buildings.driving import record


def make(folder: Path, missions: int, scans: int) -> list[Job]:
    """Two drives through one building each, in one MCAP file."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(missions):
        path = folder / f"mission_{seed:03d}_{scans}.mcap"
        if path.exists():
            continue
        house = building(seed)
        with tempfile.TemporaryDirectory() as logs:
            drives = [Path(logs) / f"{name}.log.gz" for name in "ab"]
            for drive, log in enumerate(drives):
                write_carmen(log, record(house, drive, scans), drive)
            convert(drives, path)
    config = folder / "config.yaml"
    config.write_text("map: {type: occupancy_grid, resolution_m: 0.1}\nexchange: {use: every, seconds: 60}\n")
    jobs = read_plan(str(folder), [str(config)])
    return [job for job in jobs if job.files[0].endswith(f"_{scans}.mcap")][:missions]


def spent_s() -> dict[int, float]:
    """Processor time of each living process that this one has started."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rsplit(")", 1)[1].split()
            if int(fields[1]) == os.getpid():
                found[int(path.parent.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return found


def timed(jobs: list[Job], place: Path, executor: Executor) -> tuple[float, float]:
    """Wall clock and processor time (s) of some jobs."""
    began_s, before = time.monotonic(), spent_s()
    report = run_corpus(jobs, str(place), executor)
    if len(report.done) != len(jobs):
        raise SystemExit(f"only {len(report.done)} done: {[failed.outcome.reason for failed in report.failed]}")
    after = spent_s()
    return time.monotonic() - began_s, sum(after.values()) - sum(before.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=64)
    parser.add_argument("--scans", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "mapgraft-missions")
    given = parser.parse_args()
    jobs = make(given.folder, given.missions, given.scans)
    size = sum(Path(job.files[0]).stat().st_size for job in jobs)
    print(
        f"{len(jobs)} missions of 2 robots, {2 * given.scans} scans, {size / 1e6:.1f} MB; {os.cpu_count()} processors"
    )
    place = Path(tempfile.mkdtemp(prefix="bench-corpus-"))
    wall_s, spent = {1: 0.0, 2: 0.0}, {1: 0.0, 2: 0.0}
    with Crew(1) as one, Crew(2) as two:
        crews = {1: one, 2: two}
        for crew in crews.values():
            wait([crew.submit(os.setsid) for _ in range(50)])  # whoever has one refuses another
        for workers, crew in crews.items():  # imports, and kernels from their cache
            began = timed(jobs[:workers], place / f"start{workers}", crew)
            print(f"start of {workers}, with a mission each: {began[1]:.1f} s of processor time")
        for number in range(given.rounds):
            part = jobs[number :: given.rounds]
            for workers in (1, 2) if number % 2 else (2, 1):
                wall, processor = timed(part, place / str(workers), crews[workers])
                wall_s[workers] += wall
                spent[workers] += processor
            print(
                f"round {number + 1}: load {os.getloadavg()[0]:.1f}, so far × {wall_s[1] / wall_s[2]:.2f}", flush=True
            )
        began_s, before_s = time.monotonic(), time.process_time()
        run_corpus(jobs, str(place / "1"), one)
        found_s, busy_s = time.monotonic() - began_s, time.process_time() - before_s
    print(f"found all there in {found_s:.1f} s, {busy_s:.1f} s of processor time")
    print("workers  wall s  missions/min  processor s/mission")
    for workers in (1, 2):
        minutes, each_s = wall_s[workers] / 60, spent[workers] / len(jobs)
        print(f"{workers:7}  {wall_s[workers]:6.1f}  {len(jobs) / minutes:12.1f}  {each_s:19.2f}")
    print(f"throughput of two × {wall_s[1] / wall_s[2]:.2f}; by processor time × {2 * spent[1] / spent[2]:.2f}")
    shutil.rmtree(place)


if __name__ == "__main__":
    main()
