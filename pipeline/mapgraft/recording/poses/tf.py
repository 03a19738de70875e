"""A tree of frames joined by transforms that change in time: kept for a while, looked up between samples.

Frames are joined by edges ``T_parent_child``, fixed or sampled in time. A lookup walks from the source frame up to the
common ancestor and down to the target frame, interpolates every sampled edge at the stamp, and says why when it cannot:
nothing is extrapolated, and two samples further apart than the allowed gap bracket nothing.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from typing import Literal, NamedTuple

from mapgraft.recording.poses.frames import MOST_DEEP, MOST_WAYS
from mapgraft.recording.poses.rigid import IDENTITY, Pose7, compose, interpolate, inverse

Cause = Literal[
    "no_link",  # no way through the tree between the two frames
    "before_first",  # the stamp lies before an edge's first sample
    "after_last",  # the stamp lies after an edge's last sample
    "gap_too_long",  # the samples around the stamp lie too far apart
    "forgotten",  # the samples around the stamp were let go already
    "loop",  # a frame is its own ancestor
    "two_parents",  # a frame hangs on two parents, and both lead to the target
    "pose_invalid",  # a pose is there, but its numbers are not finite
]

_PRUNE_AT_LEAST = 256  # samples: deleting from the front of an array moves all the rest
_NAMES_SHOWN = 8


class Missing(NamedTuple):
    """Why there is no transform; ``sentence`` is for a person."""

    cause: Cause
    sentence: str


class Edge:
    """``T_parent_child``: one fixed pose, or samples in time (8 + 56 bytes each)."""

    __slots__ = ("child", "first_ns", "fixed", "parent", "stamps_ns", "values")

    def __init__(self, parent: str, child: str) -> None:
        self.parent = parent
        self.child = child
        self.fixed: Pose7 | None = None
        self.first_ns: int | None = None  # stamp of the oldest sample ever, kept when that sample is let go
        self.stamps_ns = array("q")
        self.values = array("d")

    def __repr__(self) -> str:
        return f"Edge({self.parent} → {self.child})"

    def add(self, stamp_ns: int, pose: Pose7) -> None:
        """Add a sample; samples may come out of order, and the first of one stamp counts."""
        stamps = self.stamps_ns
        if not stamps or stamp_ns > stamps[-1]:
            stamps.append(stamp_ns)
            self.values.extend(pose)
        else:
            i = bisect_left(stamps, stamp_ns)
            if stamps[i] == stamp_ns:
                return
            stamps.insert(i, stamp_ns)
            self.values[7 * i : 7 * i] = array("d", pose)
        if self.first_ns is None or stamp_ns < self.first_ns:
            self.first_ns = stamp_ns

    def at(self, stamp_ns: int, max_gap_ns: int) -> Pose7 | None:
        """The pose at the stamp, or None; ``why_not`` tells the reason.

        Between two equal samples the frame has not moved, so that a mount may be published as seldom as it likes.
        """
        if self.fixed is not None:
            return self.fixed
        stamps = self.stamps_ns
        i = bisect_right(stamps, stamp_ns)
        if i == 0:
            return None
        before = self._value(i - 1)
        before_ns = stamps[i - 1]
        if before_ns == stamp_ns:
            return before
        if i == len(stamps):
            return None
        after = self._value(i)
        gap_ns = stamps[i] - before_ns
        if gap_ns > max_gap_ns and before != after:
            return None
        return interpolate(before, after, (stamp_ns - before_ns) / gap_ns)

    def why_not(self, stamp_ns: int) -> Missing:
        """Why ``at`` gave None for this stamp."""
        stamps, name = self.stamps_ns, f"{self.parent} → {self.child}"
        i = bisect_right(stamps, stamp_ns)
        if i == 0:
            first_ns = stamps[0] if self.first_ns is None else self.first_ns
            if stamp_ns >= first_ns:
                return Missing("forgotten", f"the poses {name} around it were let go already: it came far too late")
            return Missing("before_first", f"the poses {name} begin {_seconds(first_ns - stamp_ns)} after it")
        if i == len(stamps):
            return Missing("after_last", f"the poses {name} end {_seconds(stamp_ns - stamps[-1])} before it")
        gap = _seconds(stamps[i] - stamps[i - 1])
        return Missing("gap_too_long", f"the poses {name} around it lie {gap} apart, more than poses.max_gap_s")

    def forget(self, before_ns: int) -> None:
        """Let go of samples that no stamp from ``before_ns`` on needs."""
        n = bisect_right(self.stamps_ns, before_ns) - 1
        if n >= _PRUNE_AT_LEAST:
            del self.stamps_ns[:n]
            del self.values[: 7 * n]

    def _value(self, i: int) -> Pose7:
        x, y, z, qx, qy, qz, qw = self.values[7 * i : 7 * i + 7]
        return (x, y, z, qx, qy, qz, qw)


class Chain:
    """The way from a source frame to a target frame; neighbouring fixed edges are one step."""

    __slots__ = ("_steps", "sampled", "source", "target")

    def __init__(self, target: str, source: str, down: list[Edge], up: list[Edge]) -> None:
        """``down`` leads from the target down from the common ancestor's side (inverted), ``up`` on to the source."""
        self.target = target
        self.source = source
        self._steps: list[tuple[Edge | None, bool, Pose7]] = []
        for edge in down:
            self._append(edge, inverted=True)
        for edge in up:
            self._append(edge, inverted=False)
        self.sampled = tuple(edge for edge, _, _ in self._steps if edge is not None)

    def _append(self, edge: Edge, *, inverted: bool) -> None:
        if edge.fixed is None:
            self._steps.append((edge, inverted, IDENTITY))
            return
        pose = inverse(edge.fixed) if inverted else edge.fixed
        if self._steps and self._steps[-1][0] is None:
            pose = compose(self._steps.pop()[2], pose)
        self._steps.append((None, False, pose))

    def covers(self, stamp_ns: int) -> bool:
        """Whether every sampled edge has a sample at or after the stamp, so that waiting for more is of no use."""
        for edge in self.sampled:
            stamps = edge.stamps_ns
            if not stamps or stamps[-1] < stamp_ns:
                return False
        return True

    def at(self, stamp_ns: int, max_gap_ns: int) -> Pose7 | Missing:
        """``T_target_source`` at the stamp, or why there is none."""
        out: Pose7 | None = None
        for edge, inverted, pose in self._steps:
            if edge is not None:
                sample = edge.at(stamp_ns, max_gap_ns)
                if sample is None:
                    return edge.why_not(stamp_ns)
                pose = inverse(sample) if inverted else sample
            out = pose if out is None else compose(out, pose)
        return IDENTITY if out is None else out


class TransformBuffer:
    """Frames and the edges between them, as told so far.

    ``max_gap_ns`` is how far the samples around a stamp may lie apart. Samples stay until ``forget``.
    """

    def __init__(self, max_gap_ns: int) -> None:
        self.max_gap_ns = max_gap_ns
        self._parents: dict[str, dict[str, Edge]] = {}  # child → parent → edge
        self._chains: dict[tuple[str, str], Chain | Missing] = {}

    def add(self, parent: str, child: str, stamp_ns: int, pose: Pose7) -> None:
        """Add a sample of ``T_parent_child``; one that was said to be fixed stays fixed."""
        parents = self._parents.get(child)
        edge = parents.get(parent) if parents else None
        if edge is None:
            edge = self._new_edge(parent, child)
        if edge.fixed is None:
            edge.add(stamp_ns, pose)

    def fix(self, parent: str, child: str, pose: Pose7) -> None:
        """Set ``T_parent_child`` for all time; the last word counts."""
        edge = self._parents.get(child, {}).get(parent)
        if edge is None:
            edge = self._new_edge(parent, child)
        if edge.fixed != pose:
            edge.fixed = pose
            self._chains.clear()

    def fixed(self, parent: str, child: str) -> Pose7 | None:
        """``T_parent_child`` where it was said to hold for all time, else None."""
        edge = self._parents.get(child, {}).get(parent)
        return None if edge is None else edge.fixed

    def chain(self, target: str, source: str) -> Chain | Missing:
        """The way from ``source`` to ``target`` through the tree as it is now, or why there is none."""
        known = self._chains.get((target, source))
        if known is None:
            known = self._chains[target, source] = self._find(target, source)
        return known

    def lookup(self, target: str, source: str, stamp_ns: int) -> Pose7 | Missing:
        """``T_target_source`` at the stamp, or why there is none."""
        chain = self.chain(target, source)
        return chain if isinstance(chain, Missing) else chain.at(stamp_ns, self.max_gap_ns)

    def forget_older(self, kept_ns: int) -> None:
        """Let go of what lies more than ``kept_ns`` before each edge's own newest sample."""
        for edge in self.edges():
            if edge.stamps_ns:
                edge.forget(edge.stamps_ns[-1] - kept_ns)

    def edges(self) -> Iterator[Edge]:
        """All edges, in the order in which they were first told."""
        for parents in self._parents.values():
            yield from parents.values()

    def frames(self) -> tuple[str, ...]:
        """All frames, sorted by name."""
        return tuple(sorted({frame for edge in self.edges() for frame in (edge.parent, edge.child)}))

    def parents(self, frame: str) -> tuple[str, ...]:
        """The frames on which ``frame`` hangs: none for a root, several where the recording contradicts itself."""
        return tuple(self._parents.get(frame, ()))

    def closes_loop(self, parent: str, child: str) -> bool:
        """Whether ``T_parent_child`` would make a frame its own ancestor, as far as some thousand frames tell."""
        seen, todo = {parent}, [parent]
        while todo and len(seen) <= MOST_WAYS * MOST_DEEP:
            for upper in self._parents.get(todo.pop(), ()):
                if upper == child:
                    return True
                if upper not in seen:
                    seen.add(upper)
                    todo.append(upper)
        return False

    def contradictions(self) -> list[tuple[Cause, str]]:
        """Frames that hang on several parents, and loops: each once, with the time from which the recording says so."""
        found: list[tuple[Cause, str]] = []
        for child, parents in self._parents.items():
            first, *others = parents.values()
            for edge in others:
                text = f"{child!r} hangs on {first.parent!r} and{_since(edge)} on {edge.parent!r}, too"
                chosen = f"choose with poses.parents: {{{child}: {first.parent}}}"
                found.append(("two_parents", f"{text}: what has two places by that is left out; {chosen}"))
        for loop in self._loops():
            shown = [edge.parent for edge in reversed(loop)][:_NAMES_SHOWN]
            names = " → ".join(map(repr, shown)) + (" → …" if len(loop) > len(shown) else "")
            text = f"the frames {names} → {loop[0].child!r} go round in a loop{_since(loop[-1])}"
            found.append(("loop", f"{text}: what hangs on it is left out"))
        return found

    def _loops(self) -> Iterator[list[Edge]]:
        """Loops, each as the edges from a frame up to itself; every edge is followed once."""
        done: set[str] = set()
        for start in self._parents:
            way: list[Edge] = []  # from the start to the frame at hand
            on_way = {start: 0}
            ahead = [iter(self._parents[start].values())] if start not in done else []
            while ahead:
                edge = next(ahead[-1], None)
                if edge is None:
                    ahead.pop()
                    frame = way.pop().parent if way else start
                    done.add(frame)
                    del on_way[frame]
                elif edge.parent in on_way:
                    yield [*way[on_way[edge.parent] :], edge]
                elif edge.parent not in done:
                    way.append(edge)
                    on_way[edge.parent] = len(way)
                    ahead.append(iter(self._parents.get(edge.parent, {}).values()))

    def _new_edge(self, parent: str, child: str) -> Edge:
        edge = self._parents.setdefault(child, {})[parent] = Edge(parent, child)
        self._chains.clear()
        return edge

    def _find(self, target: str, source: str) -> Chain | Missing:
        from_source, from_target = self._ways_up(source), self._ways_up(target)
        if isinstance(from_source, Missing):
            return from_source
        if isinstance(from_target, Missing):
            return from_target
        ways: list[tuple[list[Edge], list[Edge]]] = []
        for up in from_source:
            for down in from_target:
                met = _meet(target, source, down, up)
                if met is not None and met not in ways:
                    ways.append(met)
        straight = [way for way in ways if not way[0] or not way[1]]  # between forefather and descendant: no detours
        ways = straight or ways
        if not ways:
            return Missing("no_link", self._no_link(target, source))
        if len(ways) > 1:
            return self._two_parents(target, source, [edge for way in ways for part in way for edge in part])
        return Chain(target, source, *ways[0])

    def _ways_up(self, frame: str) -> list[list[Edge]] | Missing:
        """All ways from the frame to a root, nearest edge first; or why they cannot be told."""
        done: list[list[Edge]] = []
        open_ways: list[list[Edge]] = [[]]
        while open_ways:
            way = open_ways.pop()
            parents = self._parents.get(way[-1].parent if way else frame)
            if not parents:
                done.append(way)
                continue
            for edge in parents.values():
                if edge.parent == frame or any(edge.parent == other.child for other in way):
                    names = " → ".join(e.parent for e in reversed([*way, edge]))
                    return Missing("loop", f"the frames {names} → {way[0].child if way else frame} go round in a loop")
                open_ways.append([*way, edge])
            if len(way) >= MOST_DEEP:
                return Missing("no_link", f"{frame!r} lies more than {MOST_DEEP} frames deep")
            if len(open_ways) + len(done) > MOST_WAYS:
                text = f"more than {MOST_WAYS} ways lead up from {frame!r}, because frames above hang on several others"
                text += ": choose with poses.parents"
                return Missing("two_parents", text)
        return done

    def _no_link(self, target: str, source: str) -> str:
        for frame in (source, target):
            if frame not in self.frames():
                known = ", ".join(self.frames()[:_NAMES_SHOWN]) or "none at all"
                return f"no transform knows the frame {frame!r}; known are {known}"
        return f"nothing links {source!r} to {target!r}: {self._lineage(source)}, {self._lineage(target)}"

    def _lineage(self, frame: str) -> str:
        ways = self._ways_up(frame)
        if isinstance(ways, Missing) or not ways[0]:
            return f"{frame!r} is a root"
        return f"{frame!r} ends at the root {ways[0][-1].parent!r}"

    def _two_parents(self, target: str, source: str, edges: list[Edge]) -> Missing:
        child = next(edge.child for edge in edges if len(self._parents[edge.child]) > 1)
        first, second = list(self._parents[child])[:2]
        return Missing(
            "two_parents",
            f"{child!r} hangs on both {first!r} and {second!r}, so that {source!r} has two places in {target!r}: "
            f"choose with poses.parents: {{{child}: {first}}}",
        )


def _meet(target: str, source: str, down: list[Edge], up: list[Edge]) -> tuple[list[Edge], list[Edge]] | None:
    """The parts of two ways up that lead to their nearest common frame: (from the target, towards the source)."""
    depth = {target: 0}
    for k, edge in enumerate(down):
        depth[edge.parent] = k + 1
    frame = source
    for k in range(len(up) + 1):
        if frame in depth:
            return down[: depth[frame]], up[:k][::-1]
        if k < len(up):
            frame = up[k].parent
    return None


def _since(edge: Edge) -> str:
    return "" if edge.first_ns is None else f" from {edge.first_ns / 1e9:.3f} s on"


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / 1e9:.3g} s"
