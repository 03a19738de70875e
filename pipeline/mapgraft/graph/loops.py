"""Loops of merges: walking around one must lead back to where it began, within what the merges are sure of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.graph.chains import Similarity, seen_from
from mapgraft.graph.claims import Claim, Edge, Source

LONGEST: Final = 9  # claims in one loop
PER_LINK: Final = 6  # loops in which one pair of sources is looked at, the shortest ones
_STEPS: Final = 2000  # of the search for loops through one pair
REMEMBERED_GRAPHS: Final = 16
REMEMBERED_LOOPS: Final = 100_000
_PLANAR: Final = [0, 1, 5]  # of x, y, z and the rotation vector: what a loop in the plane can be off by
_SPATIAL: Final = [0, 1, 2, 3, 4, 5]
_FULL_EXPANSION: Final = 3  # sources: in longer loops claims about the same pair take turns, one pair at a time

Links = Mapping[Source, Mapping[Source, Sequence[Claim]]]
Neighbours = Mapping[Source, Mapping[Source, None]]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a loop may fail to close.

    Residuals are held against the composed covariance of the claims: stated standard deviations times ``sigmas`` (they
    are too sure by about as much), plus ``floor_m`` and ``floor_rad`` per claim for what cells and bent maps hide;
    ``unknown_m`` and ``unknown_rad`` where a claim has none. ``chi2`` are the quantiles of the squared Mahalanobis
    distance that are allowed, by degrees of freedom (.999). Whatever the covariance, no residual may be more than
    ``cap_m`` or ``cap_rad``, nor scales differ by more than ``cap_scale``.
    """

    sigmas: float = 3.0
    floor_m: float = 0.1
    floor_rad: float = 0.01
    unknown_m: float = 0.3
    unknown_rad: float = 0.05
    chi2: tuple[tuple[int, float], ...] = ((3, 16.266), (6, 22.458))
    cap_m: float = 2.0
    cap_rad: float = 0.26
    cap_scale: float = 0.05


@dataclass(frozen=True, slots=True)
class Loop:
    """Claims that lead around, from ``sources[0]`` through all others and back to it.

    ``shift_m`` and ``turn_rad`` are by how much it fails to close, ``mahalanobis2`` the same against what it may, with
    ``limit``.
    """

    sources: tuple[Source, ...]
    claims: tuple[Claim, ...]
    shift_m: float
    turn_rad: float
    mahalanobis2: float
    limit: float
    consistent: bool
    edges: tuple[Edge, ...]

    def without(self, claim: Claim) -> Similarity:
        """Where the donor of one of its claims lies in the receiver's map by all the other ones."""
        at = self.claims.index(claim)
        around = [(at + k) % len(self.claims) for k in range(1, len(self.claims))]
        out = Similarity.identity()  # from the far end of the claim on, along the loop, back to its near end
        for k in around:
            out = out.then(seen_from(self.sources[k], self.claims[k]))
        return out.inverse() if self.sources[at] == claim.receiver else out


Cycle = tuple[Source, ...]
Walk = tuple[Cycle, tuple[Claim, ...]]


def find_loops(claims: Iterable[Claim], tolerance: Tolerance | None = None) -> tuple[Loop, ...]:
    """The short loops of claims that stand, each with its residual, in an order of names.

    Two claims about the same two sources, from either side, are a loop of two. Of longer ones those without a chord are
    taken, for each pair of sources the shortest few, so that every claim that lies in a loop of at most ``LONGEST`` is
    in one of these. Where two claims that meet were found on different states of the map between them, one before it
    was corrected and one after, that they do not close says nothing: such loops are left out. What was measured lately
    is remembered: one claim that changes costs the loops through it.
    """
    links = links_of(claims)
    neighbours = tuple((here, tuple(others)) for here, others in links.items())
    walks = [walk for cycle in cycles_of(neighbours) for walk in walks_of(cycle, links)]
    return measured(walks, tolerance or Tolerance())


def links_of(claims: Iterable[Claim]) -> Links:
    """Source → the sources next to it, each with the claims about the two that stand, in the order of names."""
    out: dict[Source, dict[Source, list[Claim]]] = {}
    for claim in sorted((one for one in claims if one.is_active), key=lambda one: one.edge):
        for here, there in (claim.edge, claim.edge[::-1]):
            out.setdefault(here, {}).setdefault(there, []).append(claim)
    return {here: dict(sorted(out[here].items())) for here in sorted(out)}


@lru_cache(maxsize=REMEMBERED_GRAPHS)
def cycles_of(neighbours: tuple[tuple[Source, tuple[Source, ...]], ...]) -> list[Cycle]:
    """Cycles of sources, pairs among them, each once, beginning with its first by name."""
    links: Neighbours = {here: dict.fromkeys(others) for here, others in neighbours}
    found: set[tuple[Source, ...]] = set()
    for here, others in links.items():
        for there in others:
            if here < there:
                found.add((here, there))
                found.update(_canonical(path) for path in _around(here, there, links))
    return sorted(found, key=lambda cycle: (len(cycle), cycle))


def _around(start: Source, end: Source, links: Neighbours) -> list[tuple[Source, ...]]:
    """The shortest ways from one source to its neighbour that avoid their own link and have no chord."""
    found: list[tuple[Source, ...]] = []
    left = [_STEPS]
    for length in range(2, LONGEST):
        found += _paths((start,), end, length, links, left)
        if len(found) >= PER_LINK or left[0] <= 0:
            break
    return found[:PER_LINK]


def _paths(
    path: tuple[Source, ...], end: Source, length: int, links: Neighbours, left: list[int]
) -> Iterator[tuple[Source, ...]]:
    """Ways of exactly ``length`` links whose sources are neighbours only where they follow each other."""
    here = path[-1]
    if length == 1:
        if end in links[here]:
            yield (*path, end)
        return
    for there in links[here]:
        left[0] -= 1
        if left[0] <= 0:
            return
        if there == end or there in path or any(there in links[before] for before in path[:-1]):
            continue
        if length > 2 and there in links[end]:  # a chord to the end
            continue
        yield from _paths((*path, there), end, length - 1, links, left)


def _canonical(cycle: tuple[Source, ...]) -> tuple[Source, ...]:
    """Beginning with the first by name, then towards the smaller of its two neighbours."""
    at = cycle.index(min(cycle))
    turned = cycle[at:] + cycle[:at]
    return turned if turned[1] < turned[-1] else (turned[0], *turned[:0:-1])


def walks_of(cycle: Cycle, links: Links) -> Iterator[Walk]:
    """A cycle by the claims that know the same corrections of every map; all combinations where it is short, else one
    pair's other claim at a time."""
    return (walk for walk in _walks(cycle, links) if _is_of_one_state(*walk))


def _walks(cycle: Cycle, links: Links) -> Iterator[Walk]:
    """The cycle by every claim: all combinations where it is short, else one pair's other claim at a time."""
    if len(cycle) == 2:
        if len(told := links[cycle[0]][cycle[1]]) > 1:
            yield cycle, (told[0], told[1])
        return
    choices = [links[here][there] for here, there in zip(cycle, (*cycle[1:], cycle[0]), strict=True)]
    if len(cycle) <= _FULL_EXPANSION:
        for chosen in product(*choices):
            yield cycle, chosen
        return
    best = tuple(max(told, key=lambda claim: claim.support) for told in choices)
    yield cycle, best
    for at, told in enumerate(choices):
        for other in told:
            if other is not best[at]:
                yield cycle, (*best[:at], other, *best[at + 1 :])


def _is_of_one_state(cycle: tuple[Source, ...], claims: tuple[Claim, ...]) -> bool:
    """Whether of every map that the loop passes both claims about it know the same corrections."""
    if not any(any(claim.corrections) for claim in claims):
        return True
    pairs = zip(cycle, claims, (claims[-1], *claims[:-1]), strict=True)
    return all(after.corrections_of(here) == before.corrections_of(here) for here, after, before in pairs)


def measured(walks: Sequence[Walk], tolerance: Tolerance) -> tuple[Loop, ...]:
    """The loops of some walks, each of which depends on its own claims alone.

    What is not remembered is composed, all loops of one length at once: one by one would cost a hundred times.
    """
    known = _remembered(tolerance)
    loops = [known.get(claims) for _, claims in walks]
    fresh = [walk for walk, loop in zip(walks, loops, strict=True) if loop is None]
    made: dict[tuple[Claim, ...], Loop] = {}
    sides: dict[tuple[Source, bytes], Similarity] = {}
    for length in sorted({len(claims) for _, claims in fresh}):
        chosen = [walk for walk in fresh if len(walk[1]) == length]
        steps = [[_side(here, claim, sides, tolerance) for here, claim in zip(*walk, strict=True)] for walk in chosen]
        made.update((loop.claims, loop) for loop in _closed(chosen, steps, tolerance))
    known.update(made)
    if len(known) > REMEMBERED_LOOPS:
        known.clear()
    return tuple(made[claims] if loop is None else loop for (_, claims), loop in zip(walks, loops, strict=True))


@lru_cache(maxsize=4)
def _remembered(tolerance: Tolerance) -> dict[tuple[Claim, ...], Loop]:
    """The loops that were measured with a tolerance, by their claims.

    Missions in other threads look and write here, too: what was there a moment ago need not be there any more.
    """
    return {}


def _side(
    here: Source, claim: Claim, known: dict[tuple[Source, bytes], Similarity], tolerance: Tolerance
) -> Similarity:
    """A claim seen from one end, with the covariance that it is held against."""
    key = (here, claim.data)
    if key not in known:
        floor = np.diag([tolerance.floor_m**2] * 3 + [tolerance.floor_rad**2] * 3)
        unknown = np.diag([tolerance.unknown_m**2] * 3 + [tolerance.unknown_rad**2] * 3)
        stated = unknown if claim.covariance is None else tolerance.sigmas**2 * claim.covariance
        whole = Similarity(claim.T_receiver_donor, claim.scale, stated + floor)
        known[key] = whole if claim.receiver == here else whole.inverse()
    return known[key]


def _closed(
    walks: Sequence[Walk],
    steps: Sequence[Sequence[Similarity]],
    tolerance: Tolerance,
) -> Iterator[Loop]:
    """Compose loops of one length, (n, 4, 4) and (n, 6, 6) at a time, and hold them against the identity."""
    T = np.array([[step.T_target_source.matrix for step in walk] for walk in steps])
    scale = np.array([[step.scale for step in walk] for walk in steps])
    sigma = np.array([[step.covariance for step in walk] for walk in steps])
    whole, size, covariance = _composed(T, scale, sigma)
    residual = np.concatenate((whole[:, :3, 3], _turns(whole[:, :3, :3])), axis=1)
    planar = (T[:, :, 2, :2] == 0.0).all(axis=(1, 2)) & (T[:, :, 2, 3] == 0.0).all(axis=1)
    limits, distance2, limit = dict(tolerance.chi2), np.empty(len(walks)), np.empty(len(walks))
    for used, chosen in ((_PLANAR, planar), (_SPATIAL, ~planar)):  # each by its own claims, whatever comes with it
        if not chosen.any():
            continue
        distance2[chosen] = _distances2(residual[chosen][:, used], covariance[chosen][:, used][:, :, used])
        limit[chosen] = limits[len(used)]
    for n, (sources, claims) in enumerate(walks):
        shift_m, turn_rad = float(np.linalg.norm(residual[n, :3])), float(np.linalg.norm(residual[n, 3:]))
        within = shift_m <= tolerance.cap_m and turn_rad <= tolerance.cap_rad
        within = within and abs(math.log(float(size[n]))) <= tolerance.cap_scale
        d2, most = float(distance2[n]), float(limit[n])
        closes, edges = within and d2 <= most, tuple(claim.edge for claim in claims)
        yield Loop(sources, claims, shift_m, turn_rad, d2, most, closes, edges)


def _composed(T: Floats, scale: Floats, sigma: Floats) -> tuple[Floats, Floats, Floats]:
    """Steps (n, length, …) one after the other: transforms (n, 4, 4), scales (n,) and covariances (n, 6, 6)."""
    whole, size, covariance = T[:, 0], scale[:, 0], sigma[:, 0]
    for at in range(1, T.shape[1]):
        covariance = _compounded(whole, size, covariance, T[:, at], sigma[:, at])
        shift = whole[:, :3, :3] @ (size[:, None] * T[:, at, :3, 3])[..., None]
        turned = whole[:, :3, :3] @ T[:, at, :3, :3]
        whole = whole.copy()
        whole[:, :3, 3] += shift[..., 0]
        whole[:, :3, :3] = turned
        size = size * scale[:, at]
    return whole, size, covariance


def _distances2(residual: Floats, covariance: Floats) -> Floats:
    """Squared Mahalanobis distances (n,) of residuals (n, k), added up in one order however many there are."""
    weighed = residual * np.linalg.solve(covariance, residual[..., None])[..., 0]
    out: Floats = np.zeros(len(residual))
    for column in weighed.T:
        out = out + column
    return out


def _compounded(whole: Floats, size: Floats, covariance: Floats, T: Floats, sigma: Floats) -> Floats:
    """As Similarity.then does it, for many at once."""
    count = len(whole)
    R = whole[:, :3, :3]
    lever = (R @ (size[:, None] * T[:, :3, 3])[..., None])[..., 0]
    outer, inner = np.tile(np.eye(6), (count, 1, 1)), np.zeros((count, 6, 6))
    outer[:, 0, 4], outer[:, 0, 5] = lever[:, 2], -lever[:, 1]
    outer[:, 1, 3], outer[:, 1, 5] = -lever[:, 2], lever[:, 0]
    outer[:, 2, 3], outer[:, 2, 4] = lever[:, 1], -lever[:, 0]
    inner[:, :3, :3] = size[:, None, None] * R
    inner[:, 3:, 3:] = R
    out: Floats = outer @ covariance @ outer.transpose(0, 2, 1) + inner @ sigma @ inner.transpose(0, 2, 1)
    return out


def _turns(R: Floats) -> Floats:
    """Rotation vectors (n, 3) of rotations (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    out: Floats = Rotation.from_matrix(R).as_rotvec()
    return out
