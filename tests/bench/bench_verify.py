"""What measuring and judging standing merges costs per scan, against integrating that scan.

    python tests/bench/bench_verify.py [--rounds 5] [--merges 8]

A robot maps the Intel log where it lies beside the checkout, else a made-up building, and takes in the maps of others
early on: of others who have been everywhere, so that every scan lies in all of their maps, or each in a place of its
own. Then it goes on mapping. All times are CPU time of one process, the least of several rounds in which the things
compared take turns, and every row is given as a multiple of integrating alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from bench_grid import INTEL, Run, best_of_parts, intel, rooms

from mapgraft.contracts import (
    Comparison,
    Descriptor,
    Measurement,
    Observation,
    Prior,
    Sample,
    Step,
    Tracker,
    Transform,
    Verdict,
    hookimpl,
)
from mapgraft.decision import DecisionTable, build_table
from mapgraft.history import History, Journal
from mapgraft.outputs.null_sink import NullSink
from mapgraft.persons import Hand, planar_covariance
from mapgraft.plugins import Origin, Plugins, load_plugin, load_plugins
from mapgraft.procedures import Workshop
from mapgraft.reversal import new_reversal
from mapgraft.robot import Robot
from mapgraft_grid.map_type import OccupancyGrid

SCANS, BEFORE, PART = 800, 100, 50
RULES: dict[str, dict[str, Any]] = {
    "nothing, every scan": {"metrics": ["nothing"], "every": 1},
    "nothing, every 10": {"metrics": ["nothing"], "every": 10},
    "nothing near, every 10": {"metrics": ["nothing_near"], "every": 10},
    "sequential, every scan": {"use": "sequential", "prior_max": 0, "metrics": ["news"], "every": 1},
    "sequential, every 5": {"use": "sequential", "prior_max": 0, "metrics": ["news"], "every": 5},
    "sequential, every 10": {"use": "sequential", "prior_max": 0, "metrics": ["news"], "every": 10},
    "similarity, every scan": {"metrics": ["similarity"], "every": 1},
    "similarity, every 10": {"metrics": ["similarity"], "every": 10},
    "distance, every 10": {"metrics": ["distance"], "every": 10},
}


class Nothing:
    """A metric that looks at nothing, and with ``near`` only where the donor has been."""

    def __init__(self, *, near: bool = False) -> None:
        self.near = near

    def track(self, comparison: Comparison) -> Tracker:
        return Near(comparison) if self.near else Blind()


class Blind:
    def update(self, step: Step) -> Measurement:
        return Measurement("nothing", 0.0, "1", 0, "higher")


class Near:
    def __init__(self, comparison: Comparison) -> None:
        self.concerns = comparison.map_type.region(comparison.donor_layer)

    def update(self, step: Step) -> Measurement:
        return Measurement("nothing_near", 0.0, "1", 0, "higher")


def nothing_near() -> Nothing:
    return Nothing(near=True)


class Keep:
    def verify(self, history: Sequence[Sample], reversal: str) -> Verdict:
        return Verdict("keep", "whatever is measured")


@hookimpl
def register_metrics(register: Any) -> None:
    register(Descriptor("nothing", "bench_verify:Nothing", "nothing"))
    register(Descriptor("nothing_near", "bench_verify:nothing_near", "nothing, near the donor"))


@hookimpl
def register_verifiers(register: Any) -> None:
    register(Descriptor("keep", "bench_verify:Keep", "keeps"))


def rule_of(verify: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": "known",
        "match": {"use": "known_pose"},
        "accept": {"use": "thresholds"},
        "fuse": {"use": "log_odds", "quality": "none"},
        "verify": {"use": "keep", **verify},
    }


def robot_of(name: str, plugins: Plugins, table: DecisionTable, hand: Hand) -> Robot:
    kind = OccupancyGrid()
    kept = new_reversal("ledger", kind)
    journal = Journal(History(NullSink()), name, kind, kept, snapshots=False)
    return Robot(name, kind, kept, table, Workshop(plugins), hand, journal)


def others(scans: Sequence[Observation], count: int, everywhere: bool) -> list[Sequence[Observation]]:
    if everywhere:
        return [scans[n::count] for n in range(count)]
    share = len(scans) // count
    return [scans[n * share : (n + 1) * share] for n in range(count)]


def merged(scans: Sequence[Observation], parts: list[Sequence[Observation]], verify: dict[str, Any]) -> Robot:
    """The robot after its first scans, with all others' maps in its own."""
    plugins = load_plugins()
    load_plugin(plugins, sys.modules["bench_verify"], Origin("bench", "bench", "1"))
    table = build_table(plugins, [rule_of(verify)])
    names = [f"other{n}" for n in range(len(parts))]
    prior = Prior(Transform.identity(), planar_covariance(0.1, 0.02), "the log")
    robot = robot_of("robot", plugins, table, Hand(priors={("robot", name): prior for name in names}))
    for observation in scans[:BEFORE]:
        robot.observe(observation)
    for name, part in zip(names, parts, strict=True):
        other = robot_of(name, plugins, table, Hand())
        for observation in part:
            other.observe(replace(observation, robot=name))
        robot.consider(other.offer(), other.layer(), scans[BEFORE].stamp_ns)
    assert len(robot.merges) == len(parts), [event.reason for event in robot.journal.history.events]
    return robot


def observing(robot_for: Any, scans: Sequence[Observation]) -> Run:
    def run() -> Iterator[None]:
        robot = robot_for()
        for first in range(BEFORE, len(scans), PART):
            yield
            for observation in scans[first : first + PART]:
                robot.observe(observation)

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--merges", type=int, default=8)
    asked = parser.parse_args()
    log = intel() if INTEL.exists() else rooms(2 * SCANS)
    scans, theirs = log[0 : 2 * SCANS : 2], log[1 : 2 * SCANS : 2]
    print(f"{'Intel log' if INTEL.exists() else 'made-up rooms'}, {len(scans) - BEFORE} scans")
    for everywhere in (True, False):
        parts = others(theirs, asked.merges, everywhere)
        runs = [observing(partial(merged, scans, [], {"metrics": ["nothing"]}), scans)]
        runs += [observing(partial(merged, scans, parts, verify), scans) for verify in RULES.values()]
        alone, *costs = best_of_parts(asked.rounds, runs)
        count = len(scans) - BEFORE
        print(f"\n{asked.merges} merges {'everywhere' if everywhere else 'each in a place of its own'}")
        print(f"{'integrating alone':28} {alone / count * 1e6:8.1f} µs per scan")
        for name, cost in zip(RULES, costs, strict=True):
            print(f"{name:28} {(cost - alone) / count * 1e6:8.1f} µs per scan  {(cost - alone) / alone:6.2f} ×")


if __name__ == "__main__":
    import bench_verify

    bench_verify.main()
