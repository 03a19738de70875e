"""Reading the same files with this checkout and with another one, say of an earlier commit.

Run on demand: ``git worktree add OTHER COMMIT``, then ``python tests/bench/compare_reading.py OTHER [FILE…]
[--rounds 5] [--megabytes 90]``. Without files, MCAP files of all compressions, a ROS 1 bag and a ROS 2 database are
made in the temporary folder and removed. Both ways take turns, each in a process of its own; the least processor time
counts, because other work on the machine comes and goes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench_reading import KINDS, TYPE, write_scans
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from mapgraft.recording.containers.mcap_file import McapSource

HERE = Path(__file__).parents[2]
ROOTS = ("pipeline", "plugins", "schemas", "recordings")
BYTES_OF_A_SCAN = 4440
READ = """
import json, sys, time
from mapgraft.recording.containers.opening import open_source
times, count = [], 0
for _ in range(3):
    began = time.process_time()
    with open_source(sys.argv[2]) as source:
        count = sum(1 for _ in getattr(source, sys.argv[1])())
    times.append(time.process_time() - began)
print(json.dumps([min(times), count]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path)
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--megabytes", type=float, default=90.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for path in asked.files or made(Path(folder), round(asked.megabytes * 1e6 / BYTES_OF_A_SCAN)):
            for what in ("scans", "messages"):
                compare(what, path, asked.other, asked.rounds)


def made(folder: Path, scans: int) -> Iterator[Path]:
    """The same scans in every container."""
    for kind in KINDS:
        write_scans(folder / f"{kind}.mcap", kind, scans)
        yield folder / f"{kind}.mcap"
    types = get_typestore(Stores.ROS2_HUMBLE)
    with (
        McapSource(folder / "none.mcap") as source,
        rosbag1.Writer(folder / "scans.bag") as bag,
        rosbag2.Writer(folder / "scans", version=9) as database,
    ):
        into_bag = bag.add_connection("/scan", TYPE, typestore=get_typestore(Stores.ROS1_NOETIC))
        into_database = database.add_connection("/scan", TYPE, typestore=types)
        for message in source.messages():
            data = bytes(message.data)
            bag.write(into_bag, message.log_ns, bytes(types.cdr_to_ros1(data, TYPE)))
            database.write(into_database, message.log_ns, data)
    yield from (folder / "scans.bag", folder / "scans")


def compare(what: str, path: Path, other: Path, rounds: int) -> None:
    """Print the least processor time of both, and their ratio."""
    best, counts = dict.fromkeys((HERE, other), float("inf")), dict[Path, int]()
    for number in range(rounds):
        for checkout in list(best)[:: 1 if number % 2 else -1]:
            seconds, counts[checkout] = read(checkout, what, path)
            best[checkout] = min(best[checkout], seconds)
    if counts[HERE] != counts[other]:
        print(f"{path.name}: here {counts[HERE]} {what}, there {counts[other]}")
    here_ms, other_ms = 1e3 * best[HERE], 1e3 * best[other]
    print(f"{path.name:34} {what:8} here {here_ms:7.1f} ms, there {other_ms:7.1f} ms, ratio {here_ms / other_ms:.3f}")


def read(checkout: Path, what: str, path: Path) -> tuple[float, int]:
    sources = os.pathsep.join(str(checkout.resolve() / root) for root in ROOTS)
    command = [sys.executable, "-c", READ, what, str(path)]
    told = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": sources}, capture_output=True, text=True, check=True
    )
    seconds, count = json.loads(told.stdout)
    return seconds, count


if __name__ == "__main__":
    main()
