"""The loops of all claims that stand, kept up to date: what has not changed is not looked at again."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from mapgraft.graph.claims import Claim, Edge, Source
from mapgraft.graph.loops import Cycle, Links, Loop, Tolerance, cycles_of, links_of, measured, walks_of

View = tuple[Edge, ...]  # claims about the same two maps that agree, from either side: one and the same opinion
Pair = frozenset[Source]


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


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """One cycle of sources: its loops of claims, and the same as loops of views, each told once with whether it closes.

    However many claims say the same, the loops that they make are one statement.
    """

    loops: tuple[Loop, ...] = ()
    merged: tuple[tuple[frozenset[View], bool], ...] = ()


@dataclass(slots=True)
class Book:
    """Loops by cycle of sources, and by claim how many of its loops do not close.

    ``bring_up_to`` makes it that of some claims; what comes of it depends on these alone, and what it costs on how many
    of them are others than the last time.
    """

    tolerance: Tolerance
    rounds: dict[Cycle, Round] = field(default_factory=dict)
    views: dict[Edge, View] = field(default_factory=dict)
    _open: Counter[Edge] = field(default_factory=Counter)
    _changed: set[Edge] = field(default_factory=set)  # claims whose loops are others than before
    _grounds: dict[Edge, Grounds] = field(default_factory=dict)
    _claims: dict[Edge, Claim] = field(default_factory=dict)
    _neighbours: object = None
    _through: dict[Pair, list[Cycle]] = field(default_factory=dict)

    @property
    def loops(self) -> tuple[Loop, ...]:
        """All of them, in the order of their cycles."""
        return tuple(loop for one in self.rounds.values() for loop in one.loops)

    def told(self) -> dict[Edge, Grounds]:
        """The grounds of every claim in a loop that does not close, in the order of edges."""
        for edge in self._changed:
            self._grounds.pop(edge, None)
            if self._open[edge] > 0:
                self._grounds[edge] = _grounds(self._claims[edge], self._loops_of(edge))
        self._changed.clear()
        return {edge: self._grounds[edge] for edge in sorted(self._grounds)}

    def _loops_of(self, edge: Edge) -> list[Loop]:
        met = (self.rounds[cycle] for cycle in self._through.get(frozenset(edge), ()))
        return [loop for one in met for loop in one.loops if edge in loop.edges]

    def bring_up_to(self, claims: Iterable[Claim]) -> None:
        """Look again at the loops through claims that are others than the last time.

        Whatever breaks it off, even Ctrl-C, the next time begins anew.
        """
        links = links_of(claims)
        told = {claim.edge: claim for others in links.values() for some in others.values() for claim in some}
        neighbours = tuple((here, tuple(others)) for here, others in links.items())
        before, self._neighbours = self._neighbours, None
        if neighbours != before:
            self._begin(neighbours)
        edges = [edge for edge in {**told, **self._claims} if told.get(edge) != self._claims.get(edge)]
        self._claims = told
        pairs = dict.fromkeys(frozenset(edge) for edge in edges)
        self._look(dict.fromkeys(cycle for pair in pairs for cycle in self._through[pair]), links)
        self._neighbours = neighbours

    def _begin(self, neighbours: tuple[tuple[Source, tuple[Source, ...]], ...]) -> None:
        """Others are linked than before: all that is known is of other cycles."""
        self._claims = {}
        self.rounds = dict.fromkeys(cycles_of(neighbours), Round())
        self._through, self.views, self._open = {}, {}, Counter()
        self._changed, self._grounds = set(), {}
        for cycle in self.rounds:
            for pair in dict.fromkeys(map(frozenset, zip(cycle, (*cycle[1:], cycle[0]), strict=True))):
                self._through.setdefault(pair, []).append(cycle)

    def _look(self, cycles: Mapping[Cycle, None], links: Links) -> None:
        walks = {cycle: list(walks_of(cycle, links)) for cycle in cycles}
        found = iter(measured([walk for some in walks.values() for walk in some], self.tolerance))
        fresh = {cycle: tuple(next(found) for _ in some) for cycle, some in walks.items()}
        for cycle, loops in fresh.items():
            if len(cycle) == 2:
                self._see([claim.edge for claim in links[cycle[0]][cycle[1]]], any(one.consistent for one in loops))
        for cycle, loops in fresh.items():
            self._count(self.rounds[cycle].loops, -1)
            self._count(loops, 1)
            merged = ((frozenset(self.views[edge] for edge in loop.edges), loop.consistent) for loop in loops)
            self.rounds[cycle] = Round(loops, tuple(dict.fromkeys(one for one in merged if len(one[0]) > 1)))

    def _see(self, edges: Sequence[Edge], agree: bool) -> None:
        """Where bravo sees alpha as alpha sees bravo, that is one view of the same two maps.

        Whatever deceives one of them deceives the other, so they are right or wrong together.
        """
        for edge in edges:
            self.views[edge] = tuple(edges) if agree else (edge,)

    def _count(self, loops: Iterable[Loop], times: int) -> None:
        for loop in loops:
            self._changed.update(loop.edges)
            if not loop.consistent:
                for edge in loop.edges:
                    self._open[edge] += times


def _grounds(claim: Claim, loops: Sequence[Loop]) -> Grounds:
    bad = [loop for loop in loops if not loop.consistent]
    worst = max(bad, key=lambda loop: loop.mahalanobis2 / loop.limit)
    return Grounds(claim, len(bad), len(loops) - len(bad), worst.mahalanobis2, worst.limit)
