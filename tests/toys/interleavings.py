"""Random lives of 2 to 6 robots on a bad network, each from one seed."""

from __future__ import annotations

from random import Random

from swarm import Robot, Swarm

from mapgraft.network.radio import NS_PER_S, Conditions, Partition

STEPS = 24
_WEIGHTS = {
    "observe": 6,
    "meet": 10,
    "wait": 8,
    "claim": 4,
    "confirm": 3,
    "revoke": 4,
    "revoke as donor": 2,
    "merge again": 2,
    "correct": 2,
    "begin again": 1,
}


def conditions_of(random: Random, addresses: list[str]) -> Conditions:
    """A network on which a fifth of the messages may be lost, come twice, or late, and which may be cut for a while."""

    def chance(most: float) -> float:
        return random.choice((0.0, most * random.random()))

    partitions = []
    for _ in range(random.randrange(3)):
        start_ns = random.randrange(30) * NS_PER_S
        cut = random.randrange(1, len(addresses))
        mixed = random.sample(addresses, len(addresses))
        groups = frozenset(mixed[:cut]), frozenset(mixed[cut:])
        partitions.append(Partition(start_ns, start_ns + random.randrange(1, 20) * NS_PER_S, groups))
    return Conditions(
        latency_ns=random.choice((0, NS_PER_S // 10)),
        jitter_ns=random.choice((0, NS_PER_S // 5)),
        bandwidth_bytes_s=random.choice((None, 2000.0, 20_000.0)),
        loss=chance(0.4),
        duplication=chance(0.4),
        reordering=chance(0.4),
        partitions=tuple(partitions),
        seed=random.randrange(1 << 30),
    )


def live(seed: int, steps: int = STEPS) -> Swarm:
    """One random life, healed in the end."""
    random = Random(seed)
    addresses = list("abcdef"[: random.randint(2, 6)])
    swarm = Swarm(conditions_of(random, addresses), window_ns=random.randint(1, 6) * NS_PER_S)
    for address in addresses:
        twin = address == "b" and random.random() < 0.15  # two robots of one name
        robot = swarm.add(address, "a" if twin else "", previews=random.random() < 0.5)
        for _ in range(random.randrange(3)):
            robot.observe()
    kinds, weights = list(_WEIGHTS), list(_WEIGHTS.values())
    for (kind,) in (random.choices(kinds, weights) for _ in range(steps)):
        _step(swarm, kind, random)
    swarm.heal()
    return swarm


def _step(swarm: Swarm, kind: str, random: Random) -> None:
    addresses = sorted(swarm.robots)
    address, other = random.sample(addresses, 2)
    robot = swarm.robots[address]
    match kind:
        case "observe":
            for _ in range(random.randint(1, 3)):
                robot.observe()
        case "meet":
            swarm.meet(address, other)
        case "wait":
            swarm.advance(random.randrange(3 * NS_PER_S))
        case "correct":
            robot.correct(random.randrange(1, 9) / 8.0)
        case "begin again":
            swarm.add(address, robot.source.name, robot.source.epoch + 1, previews=robot.previews)
        case "claim":
            if robot.claims.of(robot.source, source := swarm.robots[other].source) is None and robot.source != source:
                robot.claim(source, "provisional")
        case _:
            _judge(robot, kind, random)
    if random.random() < 0.3:
        swarm.advance(random.randrange(NS_PER_S))


def _judge(robot: Robot, kind: str, random: Random) -> None:
    """A robot changes its mind about one of its merges, or about one that another robot made with it."""
    mine = [claim for claim in robot.claims if claim.receiver == robot.source]
    meant = {
        "confirm": [claim.donor for claim in mine if claim.state == "provisional"],
        "revoke": [claim.donor for claim in mine if claim.is_active],
        "revoke as donor": [claim.receiver for claim in robot.claims if claim.donor == robot.source],
        "merge again": [claim.donor for claim in mine if not claim.is_active],
    }[kind]
    if not meant:
        return
    one = random.choice(meant)
    match kind:
        case "confirm":
            robot.claim(one, "confirmed")
        case "revoke":
            robot.claim(one, "reverted")
        case "revoke as donor":
            robot.revoke_as_donor(one)
        case "merge again":
            robot.claim(one, "provisional", anew=True)
