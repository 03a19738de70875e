"""Chains of merges: where a map lies in another one through others, and which of several ways there to trust most."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from mapgraft.contracts import Covariance, Transform
from mapgraft.graph.claims import Claim, Source

PER_NAT: Final = 1000  # costs of chains are whole thousandths of nats, so that equal ones are equal everywhere
Vector = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """Where the source's map frame lies in the target's: ``p_target = T_target_source (scale · p_source)``.

    ``covariance`` is in the target's frame, to first order, rotations as small turns about its axes; None where nobody
    knows.
    """

    T_target_source: Transform
    scale: float = 1.0
    covariance: Covariance | None = None

    @classmethod
    def identity(cls) -> Self:
        """A frame in itself, which everybody is sure of."""
        return cls(Transform.identity(), 1.0, np.zeros((6, 6)))

    def inverse(self) -> Similarity:
        """The same seen the other way round."""
        inverse = self.T_target_source.inverse()
        matrix = inverse.matrix.copy()
        matrix[:3, 3] /= self.scale
        T, scale = Transform(matrix), 1.0 / self.scale
        if self.covariance is None:
            return Similarity(T, scale, None)
        R = inverse.matrix[:3, :3]
        J = np.zeros((6, 6))
        J[:3, :3] = -R / self.scale
        J[:3, 3:] = -R @ cross(self.T_target_source.matrix[:3, 3]) / self.scale
        J[3:, 3:] = -R
        return Similarity(T, scale, J @ self.covariance @ J.T)

    def then(self, other: Similarity) -> Similarity:
        """From the source on to another one's: ``other`` says where that lies in the source's frame."""
        matrix = self.T_target_source.matrix @ other.T_target_source.matrix
        shift = self.scale * other.T_target_source.matrix[None, :3, 3]
        matrix[:3, 3] = self.T_target_source.apply(shift)[0]
        return Similarity(Transform(matrix), self.scale * other.scale, self._compounded(other))

    def _compounded(self, other: Similarity) -> Covariance | None:
        if self.covariance is None or other.covariance is None:
            return None
        R = self.T_target_source.matrix[:3, :3]
        outer, inner = np.eye(6), np.zeros((6, 6))
        outer[:3, 3:] = -cross(self.scale * R @ other.T_target_source.matrix[:3, 3])
        inner[:3, :3] = self.scale * R
        inner[3:, 3:] = R
        out: Covariance = outer @ self.covariance @ outer.T + inner @ other.covariance @ inner.T
        return out


def cross(v: Vector) -> Covariance:
    """The (3, 3) matrix that multiplies a vector from the left as its cross product does."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@dataclass(frozen=True, slots=True)
class Chain:
    """A way from the target's map to the source's through claims, told from the target on.

    ``cost`` is -log of the probability that all of them are right, in thousandths of nats.
    """

    target: Source
    source: Source
    claims: tuple[Claim, ...]
    cost: int

    @property
    def sources(self) -> tuple[Source, ...]:
        """All that it passes, from the target to the source."""
        passed = [self.target]
        for claim in self.claims:
            passed.append(claim.donor if claim.receiver == passed[-1] else claim.receiver)
        return tuple(passed)

    @property
    def similarity(self) -> Similarity:
        """Where the source's frame lies in the target's."""
        out = Similarity.identity()
        for here, claim in zip(self.sources, self.claims, strict=False):
            out = out.then(seen_from(here, claim))
        return out

    @property
    def support(self) -> float:
        """The log-odds (nats) that all claims are right."""
        log_right = -sum(surprise(claim.support) for claim in self.claims)
        return log_right - math.log(-math.expm1(log_right)) if log_right < 0.0 else math.inf

    @property
    def state(self) -> str:
        """``confirmed`` where all claims are."""
        return "confirmed" if all(claim.state == "confirmed" for claim in self.claims) else "provisional"

    @property
    def weakest(self) -> Claim:
        """The claim that is least supported; among equals the one that is told last."""
        return min(reversed(self.claims), key=lambda claim: claim.support)


def seen_from(here: Source, claim: Claim) -> Similarity:
    """Where the map at the other end of a claim lies in the frame of the one at this end."""
    forward = Similarity(claim.T_receiver_donor, claim.scale, claim.covariance)
    return forward if claim.receiver == here else forward.inverse()


def surprise(support: float) -> float:
    """-log of the probability that log-odds (nats) tell, ≥ 0."""
    return math.log1p(math.exp(-support)) if support > 0.0 else -support + math.log1p(math.exp(support))


def best_chains(target: Source, claims: Iterable[Claim]) -> dict[Source, Chain]:
    """Every source that can be reached from ``target`` → the chain that is most probably right, in either direction.

    Claims that are reverted lead nowhere. Among equally probable chains the one of fewest claims wins, then the one
    whose sources come first by name, then the one in which the nearer robot received; so nothing depends on the order
    in which claims were heard. The target itself is not in the result.
    """
    links = _links(claims)
    found: dict[Source, Chain] = {}
    waiting: list[tuple[int, int, tuple[Source, ...], tuple[Claim, ...]]] = [(0, 0, (target,), ())]
    while waiting:
        cost, edges, passed, told = heapq.heappop(waiting)
        here = passed[-1]
        if here in found:
            continue
        found[here] = Chain(target, here, told, cost)
        for there, claim in links.get(here, {}).items():
            if there not in found:
                entry = (cost + _cost(claim), edges + 1, (*passed, there), (*told, claim))
                heapq.heappush(waiting, entry)
    del found[target]
    return found


def _cost(claim: Claim) -> int:
    return round(PER_NAT * surprise(claim.support))


def _links(claims: Iterable[Claim]) -> Mapping[Source, Mapping[Source, Claim]]:
    """Source → the sources next to it, each with the one claim about the two that is best from this side."""
    out: dict[Source, dict[Source, Claim]] = {}
    for claim in claims:
        if not claim.is_active:
            continue
        for here, there in (claim.edge, claim.edge[::-1]):
            known = out.setdefault(here, {}).get(there)
            if known is None or _rank(here, claim) < _rank(here, known):
                out[here][there] = claim
    return out


def _rank(here: Source, claim: Claim) -> tuple[int, bool]:
    return _cost(claim), claim.receiver != here
