"""The present: which merges stand, which robots they connect, and where one map lies in another through them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mapgraft.contracts import Covariance, Transform
from mapgraft.events import STANDING, Event
from mapgraft.graph.chains import Similarity


@dataclass(frozen=True, slots=True, eq=False)
class StandingMerge:
    """One merge whose contribution is in the receiver's map now. ``seq`` is that of the event that made it."""

    merge_id: str
    seq: int
    receiver: str
    donor: str
    T_receiver_donor: Transform
    scale: float = 1.0
    covariance: Covariance | None = None
    state: str = "provisional"


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Where the source's map frame lies in the target's, through standing merges, told from target to source.

    ``covariance`` is in the target's frame, to first order; None where a merge has none.
    """

    target: str
    source: str
    T_target_source: Transform
    scale: float = 1.0
    covariance: Covariance | None = None
    merges: tuple[str, ...] = ()
    state: str = "confirmed"


class StandingMerges:
    """The view on the history that says what stands. Feed it every event in order."""

    def __init__(self, events: Iterable[Event] = ()) -> None:
        self._by_id: dict[str, StandingMerge] = {}
        for event in events:
            self.happened(event)

    def happened(self, event: Event) -> bool:
        """Take one event in; True when what stands, or where, is different from before."""
        if event.state in ("attached", "detached"):
            return False  # what is attached connects nothing that the merges on the way do not
        known = self._by_id.get(event.merge_id)
        if event.kind == "reverted":
            return self._by_id.pop(event.merge_id, None) is not None
        if event.kind not in STANDING or (known is None and event.T_receiver_donor is None):
            return False
        merge = _made(event) if known is None else _changed(known, event)
        self._by_id[event.merge_id] = merge
        return known is None or merge is not known

    @property
    def merges(self) -> tuple[StandingMerge, ...]:
        """In the order in which they were made."""
        return tuple(self._by_id.values())


def components(robots: Iterable[str], merges: Sequence[StandingMerge]) -> list[tuple[str, ...]]:
    """Robots connected by standing merges, each component sorted by name, components by their first robot."""
    neighbours = _neighbours(merges)
    names = sorted({*robots, *neighbours})
    out, seen = [], set[str]()
    for name in names:
        if name not in seen:
            found = tuple(sorted(chains_from(name, merges)))
            seen.update(found)
            out.append(found)
    return out


def chains_from(target: str, merges: Sequence[StandingMerge]) -> dict[str, Chain]:
    """Every robot connected to ``target`` (and itself) → its chain, the shortest one.

    Among equally short ones those win in which the nearer robot received (its own fused map shows that transform),
    then those of older merges: a later merge moves a robot only by connecting it more directly.
    """
    neighbours = _neighbours(merges)
    found = {target: Chain(target, target, Transform.identity(), covariance=np.zeros((6, 6)))}
    waiting = deque([target])
    while waiting:
        here = found[waiting.popleft()]
        for merge, forward in neighbours.get(here.source, ()):
            there = merge.donor if forward else merge.receiver
            if there not in found:
                found[there] = _extended(here, merge, forward)
                waiting.append(there)
    return found


def _neighbours(merges: Sequence[StandingMerge]) -> Mapping[str, list[tuple[StandingMerge, bool]]]:
    """Robot → its merges, those in which it receives (True) before those in which it gives (False), older first."""
    out: dict[str, list[tuple[StandingMerge, bool]]] = {}
    for merge in merges:
        out.setdefault(merge.receiver, []).append((merge, True))
        out.setdefault(merge.donor, []).append((merge, False))
    for edges in out.values():
        edges.sort(key=lambda edge: (not edge[1], edge[0].seq))
    return out


def _made(event: Event) -> StandingMerge:
    assert event.T_receiver_donor is not None
    return StandingMerge(
        event.merge_id,
        event.seq,
        event.receiver,
        event.donor,
        event.T_receiver_donor,
        event.scale,
        event.covariance,
        event.state or "provisional",
    )


def _changed(known: StandingMerge, event: Event) -> StandingMerge:
    """``known`` itself when the event changes nothing that stands."""
    state = event.state or known.state
    T = event.T_receiver_donor
    if T is None or (known.T_receiver_donor == T and event.scale == known.scale):
        return known if state == known.state else replace(known, state=state)
    return replace(known, T_receiver_donor=T, scale=event.scale, covariance=event.covariance, state=state)


def _extended(chain: Chain, merge: StandingMerge, forward: bool) -> Chain:
    step = Similarity(merge.T_receiver_donor, merge.scale, merge.covariance)
    so_far = Similarity(chain.T_target_source, chain.scale, chain.covariance)
    whole = so_far.then(step if forward else step.inverse())
    return Chain(
        chain.target,
        merge.donor if forward else merge.receiver,
        whole.T_target_source,
        whole.scale,
        whole.covariance,
        (*chain.merges, merge.merge_id),
        "confirmed" if chain.state == merge.state == "confirmed" else "provisional",
    )
