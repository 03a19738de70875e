"""The cheapest set of claims that hits every broken loop: branch and bound, exact within a bounded search."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

MOST_WORK: Final = 400_000  # loops looked at in one search; beyond, the best that was found is taken


@dataclass(frozen=True, slots=True)
class Problem:
    """Claims by number, each with the cost of calling it wrong, and loops as bit masks of claims.

    A claim that is by itself more probably wrong than right costs its ``penalties`` where it is called right. Every
    ``broken`` loop needs a wrong claim. A ``closed`` loop with one wrong claim costs ``by_chance``, with several
    ``by_alias``.
    """

    costs: tuple[float, ...]
    broken: tuple[int, ...]
    closed: tuple[int, ...]
    by_chance: float
    by_alias: float
    penalties: tuple[float, ...] = ()

    @property
    def improbable(self) -> int:
        """The claims that cost something where they are called right."""
        return sum(1 << at for at, penalty in enumerate(self.penalties) if penalty > 0.0)


@dataclass(frozen=True, slots=True)
class Solution:
    """The claims that are wrong, in order, what that costs, and whether nothing cheaper can exist.

    The cost is infinite where there is no solution.
    """

    wrong: tuple[int, ...]
    cost: float
    exact: bool


@dataclass(slots=True)
class _Search:
    """Everything that cannot beat the best so far is left out; that is what ``best_cost`` is at the beginning, too."""

    problem: Problem
    broken: tuple[tuple[int, int], ...]  # distinct masks, with how often they occur
    closed: tuple[tuple[int, int], ...]
    best_cost: float
    best: int = 0
    found: bool = False
    exact: bool = True
    improbable: int = 0
    sure: bool = False  # leave out only what cannot be better, not also what hardly will
    guessed: bool = False

    @property
    def all(self) -> int:
        return (1 << len(self.problem.costs)) - 1

    def cost(self, wrong: int, undecided: int) -> float:
        """What it costs at least to call these wrong, whatever becomes of the undecided ones."""
        total = math.fsum(self.problem.costs[at] for at in _bits(wrong))
        if improbable := self.improbable & ~(wrong | undecided):
            total += math.fsum(self.problem.penalties[at] for at in _bits(improbable))
        least = min(self.problem.by_chance, self.problem.by_alias)
        for mask, count in self.closed:
            hit = mask & wrong
            if not hit:
                continue
            if hit & (hit - 1):
                total += count * self.problem.by_alias
            else:
                total += count * (least if mask & undecided else self.problem.by_chance)
        return total

    def run(self, right: int, most_work: int) -> None:
        """Depth first, with a stack of its own: there may be more claims than Python nests calls."""
        waiting, work, loops = [(0, right)], 0, len(self.broken) + len(self.closed)
        while waiting and (work < most_work or not (self.found or math.isfinite(self.best_cost))):
            work += loops
            waiting += reversed(self._decided(*waiting.pop()))
        self.exact = not waiting

    def _decided(self, wrong: int, right: int) -> list[tuple[int, int]]:
        """What is to be looked at next, the more promising first, when these claims are wrong and right."""
        undecided = self.all & ~(wrong | right)
        cost = self.cost(wrong, undecided)
        if cost >= self.best_cost:
            return []
        unhit = [(mask & undecided, count) for mask, count in self.broken if not mask & wrong]
        if not unhit and (open_ones := self.improbable & undecided):
            return self._judged(wrong, right, open_ones & -open_ones)
        if not unhit:
            settled = self.cost(wrong, 0)
            if settled < self.best_cost:
                self.best_cost, self.best, self.found = settled, wrong, True
            return self._deeper(wrong, right, undecided) if settled > cost else []
        if any(not mask for mask, _ in unhit) or cost + self._least(unhit) >= self.best_cost:
            return []
        chosen = 1 << self._choose(unhit)
        into_wrong = (wrong | chosen, right)
        return [into_wrong] if any(mask == chosen for mask, _ in unhit) else [into_wrong, (wrong, right | chosen)]

    def _judged(self, wrong: int, right: int, chosen: int) -> list[tuple[int, int]]:
        """No loop needs it, but the claim is improbable by itself: is it worth what closed loops say for it?

        In a loop that nothing has hit it costs ``by_chance``, unless another one there turns out wrong, too. That is
        left out of account at first, for it is rare; ``guessed`` tells that it was.
        """
        at, problem, undecided = chosen.bit_length() - 1, self.problem, self.all & ~(wrong | right | chosen)
        more = problem.by_alias - problem.by_chance
        touched = [(mask, mask & wrong, count) for mask, count in self.closed if mask & chosen]
        alone = [(mask & undecided, count) for mask, hit, count in touched if not hit]
        once = sum(count for _, hit, count in touched if hit and not hit & (hit - 1))
        gain = problem.penalties[at] - problem.costs[at]
        if gain >= sum(n for _, n in alone) * max(problem.by_chance, more, 0.0) + once * max(more, 0.0):
            return [(wrong | chosen, right)]
        eased = gain - once * min(more, 0.0)
        shared = min(problem.by_chance, more, 0.0)
        if eased <= sum(count * (shared if others else problem.by_chance) for others, count in alone):
            return [(wrong, right | chosen)]
        if not self.sure and eased <= sum(n for _, n in alone) * min(problem.by_chance, problem.by_alias):
            self.guessed = True
            return [(wrong, right | chosen)]
        return [(wrong | chosen, right), (wrong, right | chosen)]

    def polish(self, right: int) -> None:
        """Spare every claim without which what was found is no worse; needed where the search was cut short."""
        improved = True
        while improved:
            improved = False
            for at in _bits(self.best & ~right):
                without = self.best & ~(1 << at)
                if all(mask & without for mask, _ in self.broken) and self.cost(without, 0) < self.best_cost:
                    self.best, self.best_cost, improved = without, self.cost(without, 0), True

    def _deeper(self, wrong: int, right: int, undecided: int) -> list[tuple[int, int]]:
        """Every broken loop is hit; one more wrong claim may still explain closed loops better, as an alias."""
        touching = Counter[int]()
        for mask, count in self.closed:
            hit = mask & wrong
            if hit and not hit & (hit - 1):
                touching.update(dict.fromkeys(_bits(mask & undecided), count))
        gain = self.problem.by_chance - self.problem.by_alias
        worth = [at for at, count in touching.items() if count * gain > self.problem.costs[at]]
        if not worth:
            return []
        chosen = 1 << min(worth, key=lambda one: (self.problem.costs[one] - touching[one] * gain, one))
        return [(wrong | chosen, right), (wrong, right | chosen)]

    def _least(self, unhit: list[tuple[int, int]]) -> float:
        """A lower bound: loops without a common claim need one each."""
        used, least = 0, 0.0
        for mask, _ in sorted(unhit, key=lambda one: (one[0].bit_count(), one[0])):
            if not mask & used:
                used |= mask
                least += min(self.problem.costs[at] for at in _bits(mask))
        return least

    def _choose(self, unhit: list[tuple[int, int]]) -> int:
        """Where one claim alone can hit a loop that one, else the claim that hits most for its cost."""
        alone = [mask for mask, _ in unhit if not mask & (mask - 1)]
        if alone:
            return min(alone).bit_length() - 1
        hits = Counter[int]()
        for mask, count in unhit:
            hits.update(dict.fromkeys(_bits(mask), count))
        return max(hits, key=lambda at: (hits[at] / self.problem.costs[at], -at))


def solve(
    problem: Problem, right: Collection[int] = (), below: float = math.inf, most_work: int = MOST_WORK
) -> Solution:
    """The cheapest wrong claims, those of lower numbers among equals.

    Those in ``right`` are taken as right; only solutions cheaper than ``below`` are looked for, and the cost is
    infinite where there is none.
    """
    search = _Search(problem, _counted(problem.broken), _counted(problem.closed), below)
    search.improbable = problem.improbable
    decided = sum(1 << at for at in set(right))
    search.run(decided, most_work)
    if search.exact and search.guessed:
        search.sure = True
        search.run(decided, most_work)
    if search.found and not search.exact:
        search.polish(decided)
    if not search.found:
        return Solution((), math.inf, search.exact)
    return Solution(tuple(_bits(search.best)), search.best_cost, search.exact)


def _counted(masks: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    return tuple(sorted(Counter(masks).items()))


def _bits(mask: int) -> list[int]:
    out = []
    while mask:
        low = mask & -mask
        out.append(low.bit_length() - 1)
        mask ^= low
    return out
