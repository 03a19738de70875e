"""What it costs one robot to hear of merges, as robots go from 2 to 32: loops, consistency and chains.

    python tests/bench/bench_graph.py [--wrong 0.03] [--most 32]

Everybody has merged everybody, both ways, which is the most there can be; a share of the merges is wrong. Times are
CPU time of one process. ``heard`` is when all claims are new, ``one more`` when one claim has changed since, as when a
merge moves; ``chains`` is finding the best way to every other robot.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np

from mapgraft.contracts import Transform
from mapgraft.graph.chains import best_chains
from mapgraft.graph.claims import Claim, Edge, Source
from mapgraft.graph.consistency import explain
from mapgraft.persons import planar_covariance

SIGMA_M, SIGMA_RAD = 0.03, 0.003


def world(count: int, wrong: float, rng: np.random.Generator) -> tuple[list[Claim], set[Edge]]:
    """Claims of everybody about everybody, and which of them are wrong."""
    sources = [Source(f"r{n:02d}", 1) for n in range(count)]
    places = {one: Transform.planar(*rng.uniform(-20, 20, 2), rng.uniform(-3, 3)) for one in sources}
    covariance = planar_covariance(SIGMA_M, SIGMA_RAD)
    claims, off = [], set[Edge]()
    for receiver, donor in permutations(sources, 2):
        T = places[receiver].inverse() @ places[donor]
        T = T @ Transform.planar(*rng.normal(0.0, SIGMA_M, 2), rng.normal(0.0, SIGMA_RAD))
        if rng.random() < wrong:
            T = T @ Transform.planar(*rng.uniform(3, 9, 2), rng.integers(4) * math.pi / 2)
            off.add(Edge(receiver, donor))
        claims.append(Claim(receiver, donor, 1, "confirmed", 0, T, 1.0, covariance, rng.uniform(3.0, 6.0)))
    return claims, off


def timed(what: Callable[[], object]) -> tuple[float, object]:
    start = time.process_time()
    made = what()
    return time.process_time() - start, made


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wrong", type=float, default=0.03)
    parser.add_argument("--most", type=int, default=32)
    told = parser.parse_args(arguments)
    explain([])  # what is loaded once is not counted
    explain(world(3, 0.0, np.random.default_rng(0))[0])
    rows: list[tuple[int, float, float, float]] = []
    print("robots  claims   loops  wrong  found  falsely   heard ms  one more ms  chains ms")
    counts = [2**n for n in range(1, told.most.bit_length()) if 2**n <= told.most]
    for count in counts:
        rng = np.random.default_rng(count)
        claims, off = world(count, told.wrong, rng)
        heard_s, found = timed(lambda claims=claims: explain(claims))
        claims[0] = replace(claims[0], revision=1, support=4.0)
        more_s, _ = timed(lambda claims=claims: explain(claims))
        chains_s, _ = timed(lambda claims=claims: best_chains(Source("r00", 1), claims))
        wrong = set(found.wrong)
        numbers = f"{len(off):6} {len(wrong & off):6} {len(wrong - off):8}"
        print(
            f"{count:6} {len(claims):7} {len(found.loops):7} {numbers} "
            f"{1e3 * heard_s:10.1f} {1e3 * more_s:12.1f} {1e3 * chains_s:10.1f}"
        )
        rows.append((count, heard_s, more_s, chains_s))
    for name, column in (("heard", 1), ("one more", 2), ("chains", 3)):
        steps = [math.log(b[column] / a[column], 2) for a, b in pairwise(rows[1:]) if a[column] > 0 and b[column] > 0]
        if steps:
            print(f"{name}: grows with the {np.mean(steps):.1f}th power of the robots, the claims with the second")
    return 0


if __name__ == "__main__":
    sys.exit(main())
