"""Which tf topics make up a robot's tree of frames, under which names, and which of them another file replaces."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from mapgraft.errors import ConfigError
from mapgraft.recording.poses.frames import Frames, SeenEdge
from mapgraft.recording.robots.glimpse import Glimpse, is_static
from mapgraft.recording.robots.payloads import TF_TYPES


@dataclass(frozen=True, slots=True)
class TfTopic:
    """One topic of transforms. ``prefix`` is put before frames without a namespace (``/robot_1/tf`` with bare frames).

    ``fixed`` topics hold for all time.
    """

    topic: str
    prefix: str
    fixed: bool

    def frame(self, name: str) -> str:
        """The frame's name in the robot's tree."""
        return name if "/" in name else self.prefix + name


@dataclass(frozen=True, slots=True)
class Tree:
    """A robot's tree as a sample shows it: its own tf topics, and another file's, which go before.

    ``replaced`` are the children that the other file (or a pose topic) tells; the own topics are not asked for them.
    ``chosen`` are the edges (parent, child) that alone count for their child.
    """

    own: tuple[TfTopic, ...]
    other: tuple[TfTopic, ...]
    replaced: frozenset[str]
    own_edges: tuple[SeenEdge, ...]
    other_edges: tuple[SeenEdge, ...]
    chosen: frozenset[tuple[str, str]] = frozenset()

    @property
    def frames(self) -> Frames:
        return Frames((*self.other_edges, *self.own_edges))

    def without(self, children: Collection[str]) -> Tree:
        """The tree in which the own topics are not asked for these children either."""
        kept = tuple(edge for edge in self.own_edges if edge.child not in children)
        return replace(self, replaced=self.replaced.union(children), own_edges=kept)


def tree_of(
    own: Sequence[Glimpse],
    other: Glimpse | None,
    namespace: Sequence[str],
    sensors: Collection[str],
    prefix: str | None,
    parents: Mapping[str, str] | None = None,
) -> Tree:
    """The tree of the robot with this namespace and these sensor frames.

    ``prefix`` is the configured one; None puts the namespace before bare frames only where the rest of the recording
    speaks of ``<namespace>/…`` frames, for else there is nothing to tell them from. ``parents`` says which parent
    counts for a frame. Raises ConfigError for a parent that the recording does not know of.
    """
    own_topics, own_edges = _topics_and_edges(own, namespace, sensors, prefix)
    other_topics, other_edges = _topics_and_edges([other], namespace, sensors, prefix) if other else ((), ())
    chosen = _chosen((*own_edges, *other_edges), parents or {})
    own_edges, other_edges = _counting(own_edges, chosen), _counting(other_edges, chosen)
    replaced = frozenset(edge.child for edge in other_edges)
    kept = tuple(edge for edge in own_edges if edge.child not in replaced)
    return Tree(own_topics, other_topics, replaced, kept, other_edges, chosen)


def _chosen(edges: Iterable[SeenEdge], parents: Mapping[str, str]) -> frozenset[tuple[str, str]]:
    """The configured edges (parent, child), each of which the sample must show."""
    seen = {(edge.parent, edge.child) for edge in edges}
    for child, parent in parents.items():
        if (parent, child) not in seen:
            known = ", ".join(repr(above) for above, below in sorted(seen) if below == child) or "nothing"
            raise ConfigError(f"poses.parents hangs {child!r} on {parent!r}: in the recording it hangs on {known}")
    return frozenset((parent, child) for child, parent in parents.items())


def _counting(edges: tuple[SeenEdge, ...], chosen: frozenset[tuple[str, str]]) -> tuple[SeenEdge, ...]:
    children = {child for _, child in chosen}
    return tuple(edge for edge in edges if edge.child not in children or (edge.parent, edge.child) in chosen)


def tf_namespace(topic: str) -> tuple[str, ...]:
    """``/robot_1/tf`` → ``("robot_1",)``."""
    return tuple(topic.strip("/").split("/")[:-1])


def _topics_and_edges(
    glimpses: Sequence[Glimpse], namespace: Sequence[str], sensors: Collection[str], prefix: str | None
) -> tuple[tuple[TfTopic, ...], tuple[SeenEdge, ...]]:
    channels = {c.topic: c for g in glimpses for c in g.source.channels if c.message_type in TF_TYPES and c.decodable}
    edges = [edge for g in glimpses for edge in g.edges]
    names = {edge.child for edge in edges} | {edge.parent for edge in edges}
    chosen = [t for t in sorted(channels) if tuple(namespace[: len(tf_namespace(t))]) == tf_namespace(t)]
    if not any(_knows(edges, t, sensors) for t in chosen):
        chosen += [t for t in sorted(channels) if t not in chosen and _knows(edges, t, sensors)]
    topics = {t: TfTopic(t, _prefix(t, names, prefix), is_static(channels[t])) for t in chosen}
    placed = [
        replace(edge, parent=topics[edge.topic].frame(edge.parent), child=topics[edge.topic].frame(edge.child))
        for edge in edges
        if edge.topic in topics
    ]
    return tuple(topics.values()), tuple(placed)


def _knows(edges: Sequence[SeenEdge], topic: str, sensors: Collection[str]) -> bool:
    return any(edge.topic == topic and edge.child in sensors for edge in edges)


def _prefix(topic: str, names: Collection[str], configured: str | None) -> str:
    namespace = tf_namespace(topic)
    if not namespace:
        return ""
    if configured is not None:
        return configured
    prefix = "/".join(namespace) + "/"
    return prefix if any(name.startswith(prefix) for name in names) else ""
