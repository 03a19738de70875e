"""Four robots that hear the same beacons on lines of their own, and what they say of each other in claims."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim, Source
from mapgraft.robot import Robot

WORLD = {"alpha": (0, 2, 5), "bravo": (0, 2, 5, 20, 27, 38, 54), "charlie": (20, 27, 38, 54), "delta": (38, 54, 70)}
SHIFT = {"alpha": 0, "bravo": 100, "charlie": -20, "delta": 7}  # of a robot's own line against the world
A, B, C, D = (Source(name, 1) for name in WORLD)


def heard_by(robot: str) -> tuple[int, ...]:
    return tuple(at + SHIFT[robot] for at in WORLD[robot])


def begun(*names: str) -> list[tuple]:
    return [(0, name, *heard_by(name)) for name in names]


def claim(receiver: Source, donor: Source, off_m: float = 0.0, **more) -> Claim:
    T = Transform.planar(SHIFT[receiver.name] - SHIFT[donor.name] + off_m, 0.0, 0.0)
    fields = {"epoch": 1, "state": "confirmed", "revision": 0, "support": 5.0} | more
    return Claim(receiver, donor, T_receiver_donor=T, **fields)


def hold(robots: Mapping[str, Robot], receiver: str, *donors: str) -> None:
    for donor in donors:
        robots[receiver].graph.layers.add(robots[donor].layer())


def alone(robot: str) -> Counter[int]:
    """What a robot has heard, on alpha's line."""
    return Counter(WORLD[robot])


def fused(robot: Robot) -> Counter[int]:
    return Counter(dict(robot.reversal.fused().counts))


def merged(robots: Mapping[str, Robot], receiver: str, donor: str) -> None:
    offer = robots[donor].offer()
    assert robots[receiver].wants(offer, len(offer), 1)
    robots[receiver].consider(offer, robots[donor].layer(), 1)
    assert donor in robots[receiver].merges
