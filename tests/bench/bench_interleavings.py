"""Ten thousand random lives of 2 to 6 robots on a bad network, each of which must end as computed anew.

    python tests/bench/bench_interleavings.py --count 10000 --workers 2

Every life comes from its number alone: a failing one is lived again with ``--first N --count 1``. About a third of a
second each.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "toys"))

from interleavings import live

TOLD = 250  # lives between two lines


def lived(seed: int) -> tuple[int, list[str], dict[str, int]]:
    """One life: its number, what came out wrong, and what there was in it."""
    try:
        swarm = live(seed)
    except Exception as error:  # whatever it is, it is told with its number
        return seed, [f"{type(error).__name__}: {error}"], {}
    fates = swarm.lived
    seen = {
        "robots": len(swarm.robots),
        "claims": len(next(iter(swarm.robots.values())).claims),
        "attached": sum(len(robot.reversal.contributions) for robot in swarm.robots.values()),
        "messages": fates.sent,
        "lost": fates.lost + fates.out_of_contact,
        "came twice": fates.duplicated,
    }
    return seed, swarm.disagreements(), seen


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=1)
    told = parser.parse_args()
    began_s, total, wrong = time.perf_counter(), Counter[str](), 0
    with ProcessPoolExecutor(told.workers) as pool:
        seeds = range(told.first, told.first + told.count)
        for number, (seed, faults, seen) in enumerate(pool.map(lived, seeds, chunksize=10), start=1):
            total.update(seen)
            wrong += bool(faults)
            for fault in faults:
                print(f"life {seed}: {fault}", flush=True)
            if number % TOLD == 0 or number == told.count:
                held = ", ".join(f"{count} {what}" for what, count in total.items())
                print(f"{number} lives, {wrong} wrong, {time.perf_counter() - began_s:.0f} s: {held}", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
