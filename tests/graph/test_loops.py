"""What a loop says depends on its own claims alone, whatever is measured with it, was before, or is elsewhere."""

from __future__ import annotations

import math
import random
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim, Source
from mapgraft.graph.consistency import Settings, explain
from mapgraft.graph.loops import Loop, Tolerance, cycles_of, find_loops, links_of, measured, walks_of

SOURCES = [Source(name, 1) for name in "abcdef"]


def forgetful(number: int) -> Tolerance:
    """One that nobody has asked with: what was measured with another is not looked at."""
    return Tolerance(cap_scale=0.05 + 1e-9 * (1 + number))


def drawn(seed: int, tilted: float, wrong: float = 0.3) -> list[Claim]:
    """Claims among six sources, by any covariance; a share of them leaves the plane, a share is wrong."""
    rng = np.random.default_rng(seed)
    places = {one: Transform.planar(*rng.uniform(-5, 5, 2), rng.uniform(-3, 3)) for one in SOURCES}
    claims = []
    for receiver in SOURCES:
        for donor in SOURCES:
            if receiver == donor or rng.random() < 0.5:
                continue
            T = places[receiver].inverse() @ places[donor]
            if rng.random() < tilted:
                angle = 0.02 * rng.random()
                T = T @ Transform.from_quaternion((0.0, 0.0, 0.05), (math.sin(angle), 0.0, 0.0, math.cos(angle)))
            if rng.random() < wrong:
                T = T @ Transform.planar(*rng.uniform(-2, 2, 2), rng.uniform(-1, 1))
            root = 0.05 * rng.normal(size=(6, 6))
            claims.append(Claim(receiver, donor, 1, "provisional", 0, T, covariance=root @ root.T, support=3.0))
    return claims


def told(loop: Loop) -> tuple[object, ...]:
    return loop.edges, loop.shift_m, loop.turn_rad, loop.mahalanobis2, loop.limit, loop.consistent


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.2, 1.0]))
@settings(max_examples=25, deadline=None)
def test_a_loop_says_the_same_to_the_last_bit_alone_and_among_others(seed, tilted) -> None:
    links = links_of(drawn(seed, tilted))
    cycles = cycles_of(tuple((here, tuple(others)) for here, others in links.items()))
    walks = [walk for cycle in cycles for walk in walks_of(cycle, links)]
    together = measured(walks, forgetful(0))
    random.Random(seed).shuffle(walks)
    found = {}
    for walk in walks[:20]:
        (alone,) = measured([walk], forgetful(1 + len(found)))
        found[alone.edges] = told(alone)
    assert found == {loop.edges: told(loop) for loop in together if loop.edges in found}


def triangle(names: str, off_m: float = 0.0, z_m: float = 0.0) -> list[Claim]:
    """Three claims around; the last one is off by so much, or lifts its donor out of the plane."""
    a, b, c = (Source(name, 1) for name in names)
    sure = np.diag([0.02**2] * 3 + [0.002**2] * 3)
    step, back = Transform.planar(1.0, 0.0, 0.0), Transform.planar(2.0 + off_m, 0.0, 0.0).matrix.copy()
    back[2, 3] = z_m
    ends = ((a, b, step), (b, c, step), (a, c, Transform.from_matrix(back)))
    return [Claim(*ends, 1, "provisional", 0, T, covariance=sure, support=3.0) for *ends, T in ends]


def test_robots_that_leave_the_plane_change_nothing_for_those_that_do_not() -> None:
    """By the three residuals that a loop in the plane has it does not close; by six it would."""
    flat, lifted = triangle("abc", off_m=0.82), triangle("def", z_m=0.05)
    (alone,) = find_loops(flat, forgetful(0))
    among = find_loops(flat + lifted, forgetful(1))
    again = find_loops(flat + lifted, forgetful(0))  # where one of the two is remembered
    assert 16.266 < alone.mahalanobis2 < 22.458 and not alone.consistent
    assert list(map(told, among)) == list(map(told, again))
    assert told(among[0]) == told(alone)
    assert [loop.limit for loop in among] == [16.266, 22.458]


def blamed(of: Settings, seed: int) -> list[str]:
    """Which claims are wrong, where all have merged all and one has a lie."""
    rng = random.Random(seed)
    places = [Transform.planar(rng.uniform(-5, 5), rng.uniform(-5, 5), rng.uniform(-3, 3)) for _ in SOURCES]
    claims = []
    for n, receiver in enumerate(SOURCES):
        for m, donor in list(enumerate(SOURCES))[n + 1 :]:
            T = places[n].inverse() @ places[m]
            T = T @ Transform.planar(4.0, 3.0, 1.0) if len(claims) == seed % 15 else T
            claims.append(Claim(receiver, donor, 1, "provisional", 0, T, support=3.0, stamp_ns=seed))
    return [edge.receiver.name + edge.donor.name for edge in explain(claims, of).wrong]


def test_missions_in_threads_of_one_process_do_not_blame_each_others_merges() -> None:
    """The threads take turns as often as they can, and ask about other missions each time."""
    pairs = [f"{a.name}{b.name}" for n, a in enumerate(SOURCES) for b in SOURCES[n + 1 :]]
    patience_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as threads:
            found = list(threads.map(lambda seed: blamed(Settings(), 1000 + seed), range(60)))
    finally:
        sys.setswitchinterval(patience_s)
    assert found == [[pairs[(1000 + seed) % 15]] for seed in range(60)]
