"""Which claims can stand together: the wrong ones that best explain all loops, and who cannot be told."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from mapgraft.graph.claims import Claim, Claims, Edge
from mapgraft.graph.hitting import MOST_WORK, Problem, Solution, solve
from mapgraft.graph.loops import Loop, Tolerance, find_loops

LEAST_COST: Final = 0.1  # nats: calling a claim wrong is never free
REMEMBERED: Final = 64  # explanations: robots that heard the same ask the same


@dataclass(frozen=True, slots=True)
class Settings:
    """How claims are judged.

    ``margin`` (nats) is by how much the best explanation must beat the best one that spares a claim before that claim
    is called wrong. ``by_chance`` is -log of the probability that a loop with one wrong claim closes all the same,
    ``by_alias`` with several: where buildings repeat, wrong claims agree.
    """

    margin: float = 3.0
    by_chance: float = 7.0
    by_alias: float = 2.0
    tolerance: Tolerance = field(default_factory=Tolerance)


@dataclass(frozen=True, slots=True)
class Grounds:
    """What loops say of one claim.

    ``mahalanobis2`` is the worst of its inconsistent loops, with ``limit``. ``margin`` (nats) is
    by how much worse all loops are explained when the claim is right; of a claim that is called wrong or in dispute.
    """

    claim: Claim
    inconsistent: int
    consistent: int
    mahalanobis2: float
    limit: float
    margin: float = 0.0
    exact: bool = True

    @property
    def evidence(self) -> dict[str, float]:
        """For events."""
        return {
            "loop_mahalanobis": math.sqrt(self.mahalanobis2),
            "loop_mahalanobis.revert_at": math.sqrt(self.limit),
            "loops_inconsistent": float(self.inconsistent),
            "loops_consistent": float(self.consistent),
            "loops_margin": self.margin if math.isfinite(self.margin) else 1e3,
            "loops_exact": float(self.exact),
        }

    @property
    def sentence(self) -> str:
        """For people."""
        of = self.inconsistent + self.consistent
        return (
            f"{self.inconsistent} of the {of} loops of merges through it do not close "
            f"(Mahalanobis distance {math.sqrt(self.mahalanobis2):.1f}, {math.sqrt(self.limit):.1f} allowed)"
        )


@dataclass(frozen=True, slots=True)
class Explanation:
    """What follows from all loops: claims that are wrong, and claims of which nobody can tell.

    ``told`` has the grounds of every claim that lies in a loop that does not close. ``exact`` is False when the search
    for the best explanation was cut short.
    """

    loops: tuple[Loop, ...] = ()
    told: Mapping[Edge, Grounds] = field(default_factory=dict)
    wrong: Mapping[Edge, Grounds] = field(default_factory=dict)
    disputed: Mapping[Edge, Grounds] = field(default_factory=dict)
    exact: bool = True


def explain(claims: Iterable[Claim], settings: Settings | None = None) -> Explanation:
    """The set of wrong claims that best explains which loops close and which do not.

    Every loop that does not close must have a wrong claim; calling one wrong costs its support, and so does every loop
    that closes although it is in it. Where claims about the same two sources are many this is the largest set of
    pairwise consistent measurements (Mangelson et al. 2018, PCM), weighted; longer loops are its k-ary form (Forsgren
    et al. 2022, group-k). A claim is called wrong only when it cannot be spared: the best explanation in which it is
    right is worse by the margin. Where it can, it and the claims that would be wrong instead are in dispute. A pure
    function of the claims that stand, whatever the order in which they come.
    """
    standing = Claims(claim for claim in claims if claim.is_active)
    return _explained(_Asked(standing.digest(), tuple(standing), settings or Settings()))


@dataclass(frozen=True, slots=True)
class _Asked:
    digest: bytes
    claims: tuple[Claim, ...] = field(compare=False)
    settings: Settings


@lru_cache(maxsize=REMEMBERED)
def _explained(asked: _Asked) -> Explanation:
    loops = find_loops(asked.claims, asked.settings.tolerance)
    told = _told(loops)
    wrong: dict[Edge, Grounds] = {}
    disputed: dict[Edge, Grounds] = {}
    exact = True
    if not told:
        return Explanation(loops)
    for edges, mine in _components(loops):
        problem = _problem(edges, mine, told, asked.settings)
        best = solve(problem)
        exact = exact and best.exact
        for at, spared in _spared(problem, best, asked.settings.margin).items():
            grounds = _with_margin(told[edges[at]], best, spared)
            into = disputed if spared.cost < best.cost + asked.settings.margin else wrong
            into[edges[at]] = grounds
    return Explanation(loops, told, _sorted(wrong), _sorted(disputed), exact)


def _told(loops: Sequence[Loop]) -> dict[Edge, Grounds]:
    claims = {claim.edge: claim for loop in loops if not loop.consistent for claim in loop.claims}
    through: dict[Edge, list[Loop]] = {edge: [] for edge in sorted(claims)}
    if claims:
        for loop in loops:
            for claim in loop.claims:
                if claim.edge in through:
                    through[claim.edge].append(loop)
    return {edge: _grounds(claims[edge], met) for edge, met in through.items()}


def _grounds(claim: Claim, loops: Sequence[Loop]) -> Grounds:
    bad = [loop for loop in loops if not loop.consistent]
    worst = max(bad, key=lambda loop: loop.mahalanobis2 / loop.limit)
    return Grounds(claim, len(bad), len(loops) - len(bad), worst.mahalanobis2, worst.limit)


def _components(loops: Sequence[Loop]) -> list[tuple[list[Edge], list[Loop]]]:
    """The claims that may be wrong, in parts that have no loop in common, each with the loops that matter to it.

    Only claims in loops that do not close may be.
    """
    suspects = {claim.edge for loop in loops if not loop.consistent for claim in loop.claims}
    parent = {edge: edge for edge in suspects}

    def root(edge: Edge) -> Edge:
        while parent[edge] != edge:
            parent[edge] = parent[parent[edge]]
            edge = parent[edge]
        return edge

    mine = [[claim.edge for claim in loop.claims if claim.edge in suspects] for loop in loops]
    for edges in mine:
        for edge in edges[1:]:
            first, second = sorted((root(edges[0]), root(edge)))
            parent[second] = first
    parts: dict[Edge, tuple[list[Edge], list[Loop]]] = {}
    for edge in sorted(suspects):
        parts.setdefault(root(edge), ([], []))[0].append(edge)
    for loop, edges in zip(loops, mine, strict=True):
        if edges:
            parts[root(edges[0])][1].append(loop)
    return list(parts.values())


def _problem(edges: Sequence[Edge], loops: Sequence[Loop], told: Mapping[Edge, Grounds], settings: Settings) -> Problem:
    place = {edge: n for n, edge in enumerate(edges)}
    masks = [sum(1 << place[claim.edge] for claim in loop.claims if claim.edge in place) for loop in loops]
    return Problem(
        costs=tuple(max(LEAST_COST, told[edge].claim.support) for edge in edges),
        broken=tuple(mask for mask, loop in zip(masks, loops, strict=True) if not loop.consistent),
        closed=tuple(mask for mask, loop in zip(masks, loops, strict=True) if loop.consistent),
        by_chance=settings.by_chance,
        by_alias=settings.by_alias,
    )


def _spared(problem: Problem, best: Solution, margin: float) -> dict[int, Solution]:
    """Each claim that is wrong by the best explanation → the best one in which it is right; where that is worse by less
    than the margin, so are those that are then wrong instead, and what would be wrong in their stead."""
    below, share = best.cost + margin, MOST_WORK // max(1, len(best.wrong))
    out = {at: solve(problem, (at,), below, share) for at in best.wrong}
    doubtful = {at for at, other in out.items() if other.cost < below}
    waiting = [out[at] for at in sorted(doubtful)]
    while waiting:
        other = waiting.pop()
        rivals = set(other.wrong) - set(best.wrong) - doubtful
        if rivals:
            out.update(dict.fromkeys(rivals, other))
            doubtful |= rivals
            further = solve(problem, doubtful, below, share)
            if further.cost < below:
                waiting.append(further)
    return out


def _with_margin(grounds: Grounds, best: Solution, other: Solution) -> Grounds:
    told = (grounds.claim, grounds.inconsistent, grounds.consistent, grounds.mahalanobis2, grounds.limit)
    return Grounds(*told, abs(other.cost - best.cost), best.exact and other.exact)


def _sorted(found: Mapping[Edge, Grounds]) -> dict[Edge, Grounds]:
    return {edge: found[edge] for edge in sorted(found)}
