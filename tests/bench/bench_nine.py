"""Nine robots on the Intel log, every third merge forced wrong: what contradictions between merges find out.

    python tests/bench/bench_nine.py [--every 3] [--robots 9] [--keep 1.0] [--ring] [--likely] [--blind] [--along]

The log is cut into nine robots with maps and frames of their own. When all have mapped, they meet once: every third
pair that would be merged is put somewhere else, 3 to 9 m off. No robot maps on, and no merge knows its probability, so
nothing but the contradictions between merges can start a search for the wrong ones. What stands then is held against
the log's poses, the wrong merges that are left are taken out by hand, and every map is compared, byte for byte, with
that of a second meeting at which the same pairs were not merged at all.

A merge in a loop that does not close is measured at both places by the metrics that the acceptor would have asked had
it not lied, and a place at random looks wrong to these. Harder are ``--likely``, with which the lies are the best other
places that the matcher finds, and ``--blind``, with which nothing is measured, so that loops alone must tell; both
together are the hardest. With ``--keep`` only a share of the pairs merges, so that merges lie in fewer loops; with
``--ring`` only neighbours do, which makes pairs and one loop of all. With ``--along`` the robots map all at once and
meet every minute, so that new cells speak, too, and lies are told again and again.

It ends with 0 where every wrong merge that lies in a loop is reverted (in dispute is not enough), no right one is, none
that is wrong is confirmed, and the maps are equal.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import sys
import time
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "toys"))
import saboteur

import mapgraft
from mapgraft.assembly import Assembly, assemble
from mapgraft.config import parse_config
from mapgraft.contracts import Meeting, Transform
from mapgraft.decision import build_table
from mapgraft.events import Event
from mapgraft.graph.loops import find_loops
from mapgraft.outputs.null_sink import NullSink
from mapgraft.plugins import Origin, load_plugin, load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft.robot import Robot
from mapgraft.standing import Grounds

LOG = Path(__file__).parents[3] / "shared/data/carmen/intel-corrected.log.gz"
START_S, END_S = 0.0, 2700.0
METRICS = ["posterior", "paths"]
RIGHT_M, RIGHT_RAD = 0.5, math.radians(5.0)


@dataclass(frozen=True)
class Met:
    """All robots after their meeting, where their frames truly lie, and what it took."""

    assembly: Assembly
    truth: Mapping[str, Transform]
    stamp_ns: int
    elapsed_s: float

    @property
    def robots(self) -> Mapping[str, Robot]:
        return self.assembly.robots

    def is_right(self, receiver: str, donor: str, T: Transform) -> bool:
        shift_m, turn_rad = (self.truth[receiver].inverse() @ self.truth[donor]).difference(T)
        return shift_m <= RIGHT_M and turn_rad <= RIGHT_RAD


@dataclass(frozen=True)
class How:
    """What the meeting is like."""

    robots: int
    every: int
    keep: float
    ring: bool = False
    likely: bool = False
    blind: bool = False


def config_of(how: How, refuse: bool) -> dict[str, Any]:
    """Windows of equal length, and one rule whose acceptor lies."""
    count, names = how.robots, [f"r{n + 1}" for n in range(how.robots)]
    apart = [pair for pair in combinations(names, 2) if how.ring and not _are_neighbours(*pair, names)]
    cuts = np.linspace(START_S, END_S, count + 1).tolist()
    robots = {
        f"r{n + 1}": {
            "source": "intel-corrected",
            "window": {"start_s": cuts[n], "end_s": cuts[n + 1] if n + 1 < count else None},
            "map": {"resolution_m": 0.1},
        }
        for n in range(count)
    }
    rule = {
        "name": "sabotaged grids",
        "when": {"own.type": "occupancy_grid", "other.type": "occupancy_grid"},
        "match": {"use": "planting", "likely": how.likely},
        "accept": {"use": "sabotage", "every": how.every, "keep": how.keep, "refuse": refuse, "metrics": METRICS},
        "fuse": {"use": "log_odds", "quality": "windowed"},
        "verify": {"use": "sequential", "metrics": ["news"], "every": 10, "prior_max": 0, "revert_below": 0},
        "candidates": 3,
        "priority": 100,
    }
    return {"robots": robots, "rules": [rule], "exchange": {"use": "at", "seconds": [1e6]}, "forbid": apart,
            "consistency": {"trials": not how.blind}}  # fmt: skip


def _are_neighbours(one: str, other: str, names: Sequence[str]) -> bool:
    return abs(names.index(one) - names.index(other)) in (1, len(names) - 1)


def meet(how: How, refuse: bool) -> Met:
    """Map everybody's part of the log, and hold one meeting."""
    plugins = load_plugins()
    load_plugin(plugins, saboteur, Origin("saboteur", "saboteur", "1.0"))
    config = parse_config(config_of(how, refuse))
    with open_mission([LOG], config, plugins=plugins) as mission:
        assembly = assemble(mission, config, plugins, build_table(plugins, config.rules), NullSink())
        stamp_ns = 0
        for observation in mission.observations():
            assembly.robots[observation.robot].observe(observation)
            stamp_ns = max(stamp_ns, observation.stamp_ns)
        truth = dict(mission.T_world_map)
    for robot in assembly.robots.values():
        robot.graph.through = "provisional"
    start = time.process_time()
    assembly.exchange.hold(Meeting(stamp_ns))
    return Met(assembly, truth, stamp_ns, time.process_time() - start)


def along(how: How) -> bool:
    """Lies while everybody maps; True when none is left that was found out by nobody and yet confirmed."""
    plugins = load_plugins()
    load_plugin(plugins, saboteur, Origin("saboteur", "saboteur", "1.0"))
    config = parse_config(config_of(how, refuse=False) | {"exchange": {"use": "every", "seconds": 60}})
    with open_mission([LOG], config, plugins=plugins) as mission:
        truth = dict(mission.T_world_map)
    events = mapgraft.run([LOG], config, plugins=plugins).events

    def is_right(event: Event) -> bool:
        assert event.T_receiver_donor is not None
        apart = (truth[event.receiver].inverse() @ truth[event.donor]).difference(event.T_receiver_donor)
        return apart[0] <= RIGHT_M and apart[1] <= RIGHT_RAD

    merged = {e.merge_id: is_right(e) for e in events if e.kind == "merged"}
    gone = {e.merge_id: e.by for e in events if e.kind == "reverted"}
    last = {e.merge_id: e for e in events if e.merge_id in merged}
    wrong = [merge_id for merge_id, right in merged.items() if not right]
    left = [last[merge_id] for merge_id in wrong if merge_id not in gone]
    print(f"merges made                          {len(merged)}, of which wrong {len(wrong)}")
    for by in sorted(set(gone.values())):
        told = [merge_id for merge_id, one in gone.items() if one == by]
        right = sum(merged[merge_id] for merge_id in told)
        print(f"  reverted by {by:22} {len(told) - right} wrong ones, {right} right ones")
    for event in left:
        print(f"  left: {event.merge_id} {event.state}, at a wrong place")
    there = {e.merge_id: e for e in events if ".via." in e.merge_id}
    standing = [e for e in there.values() if e.state == "attached"]
    astray = sum(not is_right(event) for event in standing)
    print(f"layers attached at the end           {len(standing)}, at a wrong place {astray}")
    return not any(event.state == "confirmed" for event in left)


def lies_in_a_loop(met: Met) -> set[str]:
    """The ids of all merges that were made and lie in a loop with others."""
    made = {claim.merge_id: claim for robot in met.robots.values() for claim in robot.claims}
    active = [replace(claim, state="provisional") for claim in made.values()]
    return {claim.merge_id for loop in find_loops(active) for claim in loop.claims}


def fused_bytes(robot: Robot) -> str:
    """A digest of the fused map as it is viewed."""
    dense = robot.reversal.fused().dense()
    whole = hashlib.sha256(dense.log_odds.tobytes())
    whole.update(repr((dense.origin_m, dense.log_odds.shape)).encode())
    return whole.hexdigest()


def take_out_by_hand(met: Met) -> int:
    """Revert what stands and is wrong, and let all meet again; no map has changed, so nobody tries to merge again."""
    taken = 0
    for name, robot in met.robots.items():
        for merge in list(robot.merges.values()):
            if not met.is_right(name, merge.donor, merge.comparison.T_receiver_donor):
                robot.standing.revert(merge, met.stamp_ns, Grounds("by hand", "person"))
                taken += 1
    met.assembly.exchange.hold(Meeting(met.stamp_ns + 1))
    return taken


def report(met: Met, clean: Met) -> bool:
    """Print what came of it; True when the bars are met."""
    events = list(met.assembly.history.events)
    merged = {e.merge_id: e for e in events if e.kind == "merged"}
    wrong = {n for n, e in merged.items() if not met.is_right(e.receiver, e.donor, e.T_receiver_donor)}
    gone = {e.merge_id: e for e in events if e.kind == "reverted"}
    disputed = {e.merge_id for e in events if e.kind == "disputed"}
    looped = lies_in_a_loop(met)
    print(f"robots                               {len(met.robots)}")
    print(f"merges made                          {len(merged)}, of which wrong {len(wrong)}")
    print(f"wrong ones that lie in a loop        {len(wrong & looped)}")
    for by in sorted({e.by for e in gone.values()}):
        mine = [merge_id for merge_id in gone.keys() & wrong if gone[merge_id].by == by]
        tried = sum("trial_log_odds" in gone[merge_id].evidence for merge_id in mine)
        print(f"  reverted by {by:23}{len(mine)}, of which {tried} after they were measured on both maps")
    print(f"  in dispute, and not reverted       {len(wrong & looped & disputed - gone.keys())}")
    print(f"wrong ones in no loop                {len(wrong - looped)}")
    sure = tell_left(events, wrong - gone.keys())
    print(f"right ones reverted                  {len(gone.keys() - wrong)}")
    print(f"  in dispute                         {len(disputed - wrong - gone.keys())}")
    tell_attached(met)
    taken = take_out_by_hand(met)
    clean.assembly.exchange.hold(Meeting(met.stamp_ns + 1))
    same = [fused_bytes(met.robots[name]) == fused_bytes(clean.robots[name]) for name in sorted(met.robots)]
    print(f"taken out by hand                    {taken}")
    print(f"maps then equal, bit for bit         {sum(same)} of {len(same)}")
    print(f"the meeting took                     {met.elapsed_s:.0f} s of CPU time")
    return wrong & looped <= gone.keys() and gone.keys() <= wrong and not sure and all(same)


def tell_left(events: Sequence[Event], left: Set[str]) -> list[str]:
    """List the wrong merges that nobody has found, by name with their states; returns those that are confirmed."""
    last = {e.merge_id: e.state for e in events if e.merge_id in left}
    for merge_id, state in sorted(last.items()):
        print(f"  left: {merge_id}, {state}")
    return [merge_id for merge_id, state in last.items() if state == "confirmed"]


def tell_attached(met: Met) -> None:
    """How many layers are in maps through others, and which of them at a wrong place."""
    attached = [(name, merge) for name, robot in met.robots.items() for merge in robot.standing.attached.values()]
    wrongly = [
        f"{name} ← {merge.donor}"
        for name, merge in attached
        if not met.is_right(name, merge.donor, merge.comparison.T_receiver_donor)
    ]
    print(f"layers attached                      {len(attached)}")
    print(f"  at a wrong place                   {len(wrongly)} {', '.join(wrongly)}")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--every", type=int, default=3)
    parser.add_argument("--robots", type=int, default=9)
    parser.add_argument("--keep", type=float, default=1.0)
    for name in ("ring", "likely", "blind", "along"):
        parser.add_argument(f"--{name}", action="store_true")
    told = parser.parse_args(arguments)
    if not LOG.is_file():
        print(f"needs {LOG}")
        return 1
    how = How(told.robots, told.every, told.keep, told.ring, told.likely, told.blind)
    if told.along:
        return 0 if along(how) else 1
    sabotaged, clean = (meet(how, refuse) for refuse in (False, True))
    return 0 if report(sabotaged, clean) else 1


if __name__ == "__main__":
    sys.exit(main())
