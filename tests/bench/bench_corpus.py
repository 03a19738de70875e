"""A corpus of simulated missions on one and on two local workers: throughput, and what it costs to find it all there.

    python tests/bench/bench_corpus.py --missions 64 --folder /tmp/missions

The missions are made once and kept in the folder. Wall clocks of a machine that others use tell little; processor time
per mission does: two workers are worth ``2 · (one's seconds per mission) / (two's)`` where nobody else computes.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import tempfile
import time
from pathlib import Path

from mapgraft.corpus import Job, executor_of, run_corpus
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


def spent_s() -> float:
    """Processor time of all processes that this one has started and that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=64)
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "mapgraft-missions")
    given = parser.parse_args()
    jobs = make(given.folder, given.missions, given.scans)
    size = sum(Path(job.files[0]).stat().st_size for job in jobs)
    print(
        f"{len(jobs)} missions of 2 robots, {2 * given.scans} scans, {size / 1e6:.1f} MB; {os.cpu_count()} processors"
    )
    print("workers  wall s  missions/min  processor s/mission   load before")
    first: tuple[float, float] | None = None
    for workers in given.workers:
        place = Path(tempfile.mkdtemp(prefix="bench-corpus-"))
        load, began_s, before_s = os.getloadavg()[0], time.monotonic(), spent_s()
        with executor_of("processes", workers) as executor:
            report = run_corpus(jobs, str(place / "set"), executor)
        wall_s, each_s = time.monotonic() - began_s, (spent_s() - before_s) / len(jobs)
        if len(report.done) != len(jobs):
            raise SystemExit(f"only {len(report.done)} done: {[failed.outcome.reason for failed in report.failed]}")
        print(f"{workers:7}  {wall_s:6.1f}  {60 * len(jobs) / wall_s:12.1f}  {each_s:19.2f}   {load:.1f}")
        if first is None:
            first = wall_s, each_s
        else:
            print(
                f"         throughput × {first[0] / wall_s:.2f}; by processor time × {workers * first[1] / each_s:.2f}"
            )
        began_s = time.monotonic()
        with executor_of("threads", 1) as executor:
            run_corpus(jobs, str(place / "set"), executor)
        print(f"         found all there in {time.monotonic() - began_s:.1f} s")
        shutil.rmtree(place)


if __name__ == "__main__":
    main()
