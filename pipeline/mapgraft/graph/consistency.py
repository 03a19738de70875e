"""Which claims can stand together: the wrong ones that best explain all loops, and who cannot be told."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

from mapgraft.graph.book import Book, Grounds, View
from mapgraft.graph.claims import Claim, Claims, Edge
from mapgraft.graph.hitting import MOST_WORK, Problem, Solution, solve
from mapgraft.graph.loops import Loop, Tolerance

LEAST_COST: Final = 0.1  # nats: calling a claim wrong is never free
REMEMBERED: Final = 64  # explanations: robots that heard the same ask the same


@dataclass(frozen=True, slots=True)
class Settings:
    """How claims are judged.

    ``margin`` (nats) is by how much the best explanation must beat the best one that spares a claim before that claim
    is called wrong. ``by_chance`` is -log of the probability that a loop with one wrong claim closes all the same,
    ``by_alias`` with several: where buildings repeat, wrong claims agree. With ``trials`` robots measure their own
    merges that lie in loops that do not close.
    """

    margin: float = 3.0
    by_chance: float = 7.0
    by_alias: float = 2.0
    trials: bool = True
    tolerance: Tolerance = field(default_factory=Tolerance)


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

    Every loop that does not close must have a wrong claim; calling one wrong costs its support, calling one right that
    is improbable costs what speaks against it, and every loop that closes although a wrong one is in it costs, too.
    Where claims about the same two sources are many this is the largest set of pairwise consistent measurements
    (Mangelson et al. 2018, PCM), weighted; longer loops are its k-ary form (Forsgren et al. 2022, group-k). A claim is
    called wrong only when it cannot be spared: the best explanation in which it is right is worse by the margin. Where
    it can, it and the claims that would be wrong instead are in dispute. A pure function of the claims that stand,
    whatever the order in which they come.
    """
    standing = Claims(claim for claim in claims if claim.is_active)
    return _explained(_Asked(standing.digest(), tuple(standing), settings or Settings()))


@dataclass(frozen=True, slots=True)
class _Asked:
    digest: bytes
    claims: tuple[Claim, ...] = field(compare=False)
    settings: Settings


class _Books(threading.local):
    """By tolerance the book of whoever runs in this thread: robots of one mission, which heard nearly the same, share
    what is known of its loops. A book is changed while it is asked, so missions in other threads have their own."""

    def __init__(self) -> None:
        self.book = lru_cache(maxsize=4)(Book)


_mine: Final = _Books()


@lru_cache(maxsize=REMEMBERED)
def _explained(asked: _Asked) -> Explanation:
    book = _mine.book(asked.settings.tolerance)
    book.bring_up_to(asked.claims)
    told = book.told()
    if not told:
        return Explanation(book.loops)
    wrong: dict[Edge, Grounds] = {}
    disputed: dict[Edge, Grounds] = {}
    exact, margin = True, asked.settings.margin
    loops = (one for cycle in book.rounds.values() for one in cycle.merged)
    for part in _components(loops, {book.views[edge] for edge in told}):
        problem = _problem(part, told, asked.settings)
        best, spared = _solved(problem, margin)
        exact = exact and best.exact
        for at, other in spared.items():
            into = disputed if other.cost < best.cost + margin else wrong
            into.update({edge: _with_margin(told[edge], best, other) for edge in part.views[at] if edge in told})
    return Explanation(book.loops, told, _sorted(wrong), _sorted(disputed), exact)


@dataclass(frozen=True, slots=True)
class _Part:
    """Views that may be wrong, and the loops of views that matter to them: bit masks of the views."""

    views: tuple[View, ...]
    broken: tuple[int, ...]
    closed: tuple[int, ...]


def _components(loops: Iterable[tuple[frozenset[View], bool]], suspects: set[View]) -> list[_Part]:
    """The views that may be wrong, in parts that have no loop in common, each with the loops that matter to it.

    Only those in loops that do not close may be.
    """
    parent = {view: view for view in suspects}

    def root(view: View) -> View:
        while parent[view] != view:
            parent[view] = parent[parent[view]]
            view = parent[view]
        return view

    mine = [(sorted(passed & suspects), closes) for passed, closes in loops]
    for met, _ in mine:
        for view in met[1:]:
            first, second = sorted((root(met[0]), root(view)))
            parent[second] = first
    place: dict[View, int] = {}
    members: dict[View, list[View]] = {}
    for view in sorted(suspects):
        into = members.setdefault(root(view), [])
        place[view] = len(into)
        into.append(view)
    masks: dict[tuple[View, bool], list[int]] = {}
    for met, closes in mine:
        if met:
            masks.setdefault((root(met[0]), closes), []).append(sum(1 << place[view] for view in met))

    def told(first: View, closes: bool) -> tuple[int, ...]:
        return tuple(sorted(masks.get((first, closes), ())))

    return [_Part(tuple(views), told(first, False), told(first, True)) for first, views in members.items()]


def _problem(part: _Part, told: Mapping[Edge, Grounds], settings: Settings) -> Problem:
    supports = [_support([told[edge].claim.support for edge in view if edge in told]) for view in part.views]
    return Problem(
        costs=tuple(max(LEAST_COST, support) for support in supports),
        broken=part.broken,
        closed=part.closed,
        by_chance=settings.by_chance,
        by_alias=settings.by_alias,
        penalties=tuple(max(0.0, -support) for support in supports),
    )


def _support(supports: Sequence[float]) -> float:
    """Of claims that say the same: what speaks for them is one and the same, what speaks against them adds up."""
    return max(0.0, *supports) + math.fsum(min(0.0, one) for one in supports)


@lru_cache(maxsize=REMEMBERED)
def _solved(problem: Problem, margin: float) -> tuple[Solution, Mapping[int, Solution]]:
    """The best explanation of one part, and of each claim in question the best one that spares it.

    A part that has not changed since is not searched again.
    """
    best = solve(problem)
    while True:
        spared = _spared(problem, best, margin)
        better = min(spared.values(), key=lambda other: other.cost, default=best)
        if best.exact or better.cost >= best.cost:
            break
        best = better  # the first search was cut short
    needed = _needed(problem, best)  # what else is known of a claim by itself is its verifier's affair
    return best, {at: other for at, other in spared.items() if at not in best.wrong or at in needed}


def _needed(problem: Problem, best: Solution) -> set[int]:
    """The claims that are called wrong because of loops, and not only because they are improbable by themselves."""
    needed = sum(1 << at for at in best.wrong)
    for at in sorted(best.wrong, key=lambda one: (problem.penalties[one], one)):
        without = needed & ~(1 << at)
        if problem.penalties[at] > 0.0 and all(mask & without for mask in problem.broken):
            needed = without
    return {at for at in best.wrong if needed >> at & 1}


def _sparing(problem: Problem, at: int, below: float, most_work: int) -> Solution:
    """The best explanation in which a claim is right, if it is cheap enough; where that cannot be found out in time,
    the best that can."""
    found = solve(problem, (at,), below, most_work)
    if math.isfinite(found.cost) or found.exact:
        return found
    return solve(problem, (at,), math.inf, most_work)


def _spared(problem: Problem, best: Solution, margin: float) -> dict[int, Solution]:
    """Each claim that is wrong by the best explanation → the best one in which it is right; where that is worse by less
    than the margin, so are those that are then wrong instead, and what would be wrong in their stead."""
    below, share = best.cost + margin, MOST_WORK // max(1, len(best.wrong))
    out = {at: _sparing(problem, at, below, share) for at in best.wrong}
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
