"""What it takes that robots meet: bytes against sending whole maps, and how that grows with the number of robots.

    python tests/bench/bench_exchange.py bytes [--robots 4] [--seconds 30 …] [--previews without|with|both] [--every 1]
    python tests/bench/bench_exchange.py scale [--most 32] [--merged chain|all]

``bytes`` cuts the Intel log into robots that map at the same time and meet every so many seconds, and compares what
they sent with what it would have been had every robot sent its whole map, as it is encoded, to every other one at each
meeting. Without options robots meet, and look at previews, as they do where nothing is configured. It ends with 0 where
every case that was asked for takes ten times less.

``scale`` lets 2 to 32 robots with tiny grids meet all at once, each merged with the next one (``chain``), or everybody
with everybody (``all``), and tells for each robot what a quiet exchange costs, one after which everybody has a newer
map, and what a merge and a revert add; with the exponents by which that grows with the number of the others, from 2
robots on and from 4 on. It ends with 0 where none is above 1.1; times of a merge and a revert, which are differences of
two times, do not count. What a robot makes of the claims is not in it: see ``bench_graph.py``.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "toys"))
from swarm import Swarm

from mapgraft.assembly import Assembly, assemble
from mapgraft.config import parse_config
from mapgraft.contracts import Meeting
from mapgraft.decision import build_table
from mapgraft.network.radio import NS_PER_S
from mapgraft.outputs.null_sink import NullSink
from mapgraft.plugins import load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft.replay import Exchange, replay

LOG = Path(__file__).parents[3] / "shared/data/carmen/intel-corrected.log.gz"
END_S = 2700.0
LEAST_RATIO = 10.0  # whole maps against what was sent
MOST_EXPONENT = 1.1  # linear, and what fitting it leaves open
BESIDE = "beside that"  # of costs that are differences


def config_of(robots: int, seconds: float, every: int, previews: bool) -> dict[str, Any]:
    cuts = np.linspace(0.0, END_S, robots + 1).tolist()
    return {
        "mission": {"every": every},
        "robots": {
            f"r{n + 1}": {"source": "intel-corrected", "window": {"start_s": cuts[n], "end_s": cuts[n + 1]}}
            for n in range(robots)
        },
        "exchange": {"use": "every", "seconds": seconds},
        "radio": {"previews": previews},
        "output": {"snapshots": False},
    }


def flown(robots: int, seconds: float, every: int, previews: bool) -> tuple[Assembly, int, int]:
    """One mission; with it how many meetings there were, and the bytes of all maps sent at each of them."""
    plugins = load_plugins()
    config = parse_config(config_of(robots, seconds, every, previews))
    whole = meetings = 0
    with open_mission([LOG], config, plugins=plugins) as mission:
        assembly = assemble(mission, config, plugins, build_table(plugins, config.rules), NullSink())

        class Weighed(Exchange):
            """Weighs every map at each meeting."""

            def hold(self, meeting: Meeting) -> None:
                nonlocal whole, meetings
                sizes = [len(robot.own.encoded_layer()) for robot in self.robots.values()]
                whole, meetings = whole + sum(sizes) * (len(sizes) - 1), meetings + 1
                Exchange.hold(self, meeting)

        made = assembly.exchange
        weighed = Weighed(
            made.policy, made.robots, made.T_world_map, made.network, guard=made.guard, history=made.history
        )
        replay(mission.observations(), assembly.robots, weighed, NullSink())
        return Assembly(assembly.robots, weighed, assembly.history, assembly.hand), meetings, whole


def weigh(robots: int, seconds: float, every: int, previews: bool) -> float:
    """Print what one mission sent; returns how many times as much whole maps would be."""
    began_s = time.process_time()
    assembly, meetings, whole = flown(robots, seconds, every, previews)
    traffic = assembly.exchange.traffic
    sent, kinds = sum(traffic.bytes.values()), Counter[str]()
    for (_, _, kind), size in traffic.bytes.items():
        kinds[kind] += size
    events = Counter(event.kind for event in assembly.history.events)
    how = "with" if previews else "without"
    print(f"each {seconds:g} s, {how} previews: {robots} robots, {meetings} meetings")
    print(f"  whole maps each time {whole / 1e6:9.2f} MB")
    print(f"  sent                 {sent / 1e6:9.2f} MB, {whole / sent:.1f} times less")
    for kind, size in kinds.most_common():
        print(f"    {kind:10} {size / 1e3:12.1f} kB")
    print(f"  per robot and meeting {sent / robots / meetings / 1e3:.2f} kB")
    print(f"  {dict(events)}, {time.process_time() - began_s:.0f} s of computing", flush=True)
    return whole / sent


def meeting_of(swarm: Swarm) -> tuple[float, float, float]:
    """Everybody meets everybody: bytes and messages that a robot receives, and seconds of computing, per robot."""
    before, sent = sum(swarm.traffic.bytes.values()), swarm.radio.fates.sent
    began_s = time.process_time()
    names = sorted(swarm.robots)
    for at, one in enumerate(names):
        for other in names[at + 1 :]:
            swarm.meet(one, other)
    swarm.advance(20 * NS_PER_S)
    count = len(names)
    took_s = (time.process_time() - began_s) / count
    return (sum(swarm.traffic.bytes.values()) - before) / count, (swarm.radio.fates.sent - sent) / count, took_s


def grown(count: int, everybody: bool) -> dict[str, tuple[float, float, float]]:
    """What the exchanges of so many robots cost each of them: bytes, messages, seconds."""
    swarm = Swarm()
    names = [f"r{n:02}" for n in range(count)]
    for name in names:
        robot = swarm.add(name, previews=False)
        robot.picky = True
        for _ in range(8):
            robot.observe()
    for one, other in permutations(names, 2) if everybody else pairwise(names):
        swarm.robots[one].claim(swarm.robots[other].source, "confirmed")
    for _ in range(3):
        meeting_of(swarm)
    assert swarm.disagreements() == []
    costs = {"quiet exchange": meeting_of(swarm)}
    for robot in swarm.robots.values():
        robot.observe()
    costs["exchange of newer maps"] = meeting_of(swarm)
    quiet = meeting_of(swarm)
    first, last = swarm.robots[names[0]], swarm.robots[names[-1]]
    first.claim(last.source, "provisional", anew=everybody or count == 2)
    costs[f"a merge, {BESIDE}"] = _more(meeting_of(swarm), quiet)
    first.claim(last.source, "reverted")
    costs[f"a revert, {BESIDE}"] = _more(meeting_of(swarm), quiet)
    assert swarm.disagreements() == []
    return costs


def _more(now: Sequence[float], before: Sequence[float]) -> tuple[float, float, float]:
    added = [max(0.0, a - b) for a, b in zip(now, before, strict=True)]
    return added[0], added[1], added[2]


def scale(most: int, everybody: bool) -> bool:
    counts = [count for count in (2, 4, 8, 16, 32, 64) if count <= most]
    costs = {count: grown(count, everybody) for count in counts}
    fine = True
    print(f"{'per robot':24} {'':10}" + "".join(f"{count:>10}" for count in counts) + "  exponent  from 4 on")
    for what in costs[counts[0]]:
        for at, unit in enumerate(("bytes", "messages", "ms")):
            values = [costs[count][what][at] * (1e3 if unit == "ms" else 1.0) for count in counts]
            exponents = _exponent(counts, values), _exponent(counts[1:], values[1:])
            if unit != "ms" or BESIDE not in what:
                fine = fine and not any(exponent > MOST_EXPONENT for exponent in exponents)
            told = "".join(f"{value:10.1f}" for value in values)
            print(f"{what if at == 0 else '':24} {unit:10}{told}  {exponents[0]:8.2f}  {exponents[1]:9.2f}", flush=True)
    return fine


def _exponent(counts: Sequence[int], values: Sequence[float]) -> float:
    """The slope of the costs over the number of the other robots, both as logarithms; where they cost anything."""
    points = [
        (math.log(count - 1), math.log(value)) for count, value in zip(counts, values, strict=True) if value > 0.0
    ]
    if len(points) < 2:
        return math.nan
    others, costs = zip(*points, strict=True)
    return float(np.polyfit(others, costs, 1)[0])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    modes = parser.add_subparsers(dest="mode", required=True)
    weighing = modes.add_parser("bytes")
    weighing.add_argument("--robots", type=int, default=4)
    weighing.add_argument("--seconds", type=float, nargs="+", default=[30.0])
    weighing.add_argument("--previews", choices=("without", "with", "both"), default="without")
    weighing.add_argument("--every", type=int, default=1)
    scaling = modes.add_parser("scale")
    scaling.add_argument("--most", type=int, default=32)
    scaling.add_argument("--merged", choices=("chain", "all"), default="chain")
    told = parser.parse_args()
    if told.mode == "scale":
        return 0 if scale(told.most, told.merged == "all") else 1
    asked = {"without": (False,), "with": (True,), "both": (False, True)}[told.previews]
    ratios = [weigh(told.robots, seconds, told.every, previews) for seconds in told.seconds for previews in asked]
    return 0 if min(ratios) >= LEAST_RATIO else 1


if __name__ == "__main__":
    raise SystemExit(main())
