"""Small damages to sound bytes, as files suffer them and as attackers make them."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

Damage = Callable[[bytes], bytes]
"""Changes any bytes, at random."""

Own = Callable[[bytes, random.Random, Damage], bytes]
"""Changes bytes of one kind, at random, by way of a function that changes any."""

EDGES = (
    b"\x00",
    b"\xff",
    b"\x7f",
    b"\x80",
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x80",
    b"\xff" * 7 + b"\x7f",
    b"\n",
    b" ",
)


def mutated(seeds: Sequence[bytes], chance: random.Random, own: Own | None = None) -> bytes:
    """One of the seeds with one to six damages, or damaged by a harness's ``own`` way."""
    sound = chance.choice(seeds)
    if own is None:
        return damaged(sound, seeds, chance)
    return own(sound, chance, lambda part: damaged(part, seeds, chance))


def damaged(sound: bytes, seeds: Sequence[bytes], chance: random.Random) -> bytes:
    """One input with one to six damages, some of them parts of others."""
    data = bytearray(sound)
    for _ in range(chance.randint(1, 6)):
        _damage(data, seeds, chance)
    return bytes(data)


def _damage(data: bytearray, seeds: Sequence[bytes], chance: random.Random) -> None:
    kind, at = chance.randrange(7), chance.randint(0, len(data))
    if kind == 0 and data:
        data[at % len(data)] ^= 1 << chance.randrange(8)
    elif kind == 1 and data:
        data[at % len(data)] = chance.randrange(256)
    elif kind == 2:
        del data[at:]
    elif kind == 3:
        del data[at : at + chance.randint(1, 16)]
    elif kind == 4:
        edge = chance.choice(EDGES)
        data[at : at + len(edge)] = edge
    elif kind == 5:
        data[at:at] = data[at : at + chance.randint(1, 64)]
    else:
        other = chance.choice(seeds)
        first = chance.randint(0, len(other))
        data[at:at] = other[first : first + chance.randint(1, 32)]
