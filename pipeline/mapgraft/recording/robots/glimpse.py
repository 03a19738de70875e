"""A quick look at a source: what its payload topics, pose topics and transforms look like, from short stretches of it.

Nothing here reads a large file whole: transforms said to hold for all time are read completely, everything else in a
few short windows spread over the recording; text logs, which are small, are read in bursts of lines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from mapgraft.contracts.sources import Channel, RawMessage, Source
from mapgraft.errors import RecordingError
from mapgraft.recording.poses.frames import MOST_EDGES, SeenEdge, Stamped
from mapgraft.recording.poses.rigid import Pose7, pose7
from mapgraft.recording.robots.payloads import POSE_TYPES, TF_TYPES, Payloads, poses_in

_WINDOWS = 9
_WINDOW_NS = 2_000_000_000
_PER_WINDOW = 200  # messages of one topic in one window that are decoded
_BURST, _BURSTS = 60, 9  # messages in a row, and how many rows, of a topic in a text log
_ENDS = 5  # payloads looked at from the beginning and from the end of a topic
_TEXT_CONTAINERS = ("carmen", "tum")


@dataclass(frozen=True, slots=True)
class SeenPayload:
    """One topic of payloads: the first few and the last few of their times, in the order of recording."""

    channel: Channel
    kind: str
    frame: str
    first: tuple[Stamped, ...]
    last: tuple[Stamped, ...]

    @property
    def topic(self) -> str:
        return self.channel.topic

    @property
    def times(self) -> tuple[Stamped, ...]:
        """All times seen; one entry means that there is one message."""
        return (*self.first, *self.last) if len(self.first) > 1 else self.first


@dataclass(frozen=True, slots=True)
class SeenPoses:
    """One topic of poses of ``child`` (empty where the messages do not say) in ``frame``."""

    channel: Channel
    frame: str
    child: str
    times: tuple[Stamped, ...]
    poses: tuple[Pose7, ...]

    @property
    def topic(self) -> str:
        return self.channel.topic


@dataclass(frozen=True, slots=True)
class Glimpse:
    """What a sample of one source shows. ``edges`` have the frame names of the messages, no prefix added."""

    source: Source
    payloads: tuple[SeenPayload, ...]
    poses: tuple[SeenPoses, ...]
    edges: tuple[SeenEdge, ...]
    undecodable: tuple[str, ...]

    def payload(self, topic: str) -> SeenPayload | None:
        return next((seen for seen in self.payloads if seen.topic == topic), None)


def glimpse(source: Source, payloads: Payloads) -> Glimpse:
    """Look into a source; raises RecordingError when the file cannot be read, or has topics without end."""
    usable = [channel for channel in source.channels if channel.decodable and channel.count != 0]
    payloads.check_topics(source.path, len({channel.topic for channel in usable if _concerns_us(channel, payloads)}))
    seen_payloads: list[SeenPayload] = []
    broken: list[str] = []
    for channel in _one_per_topic(usable):
        if kind := payloads.kind_of(channel.message_type):
            seen = _payload(source, payloads, channel, kind)
            if isinstance(seen, SeenPayload):
                seen_payloads.append(seen)
            elif seen:
                broken.append(f"{channel.topic} ({channel.message_type}) is left out: {seen}")
    sampler = _PoseSampler(source)
    sampler.look([channel for channel in usable if is_static(channel)], everything=True)
    sampler.look([c for c in usable if c.message_type in TF_TYPES | POSE_TYPES and not is_static(c)], everything=False)
    undecodable = tuple(
        f"{channel.topic} ({channel.message_type}) is left out: {channel.why_not}"
        for channel in source.channels
        if not channel.decodable and _concerns_us(channel, payloads)
    )
    return Glimpse(source, tuple(seen_payloads), sampler.poses(), sampler.edges(), (*undecodable, *broken))


def is_static(channel: Channel) -> bool:
    """Whether a topic's transforms hold for all time."""
    return channel.message_type in TF_TYPES and (channel.latched or channel.topic.endswith("tf_static"))


def _concerns_us(channel: Channel, payloads: Payloads) -> bool:
    name = channel.message_type
    return payloads.kind_of(name) is not None or name in TF_TYPES or name in POSE_TYPES


def _one_per_topic(channels: Iterable[Channel]) -> list[Channel]:
    found: dict[str, Channel] = {}
    for channel in channels:
        found.setdefault(channel.topic, channel)
    return list(found.values())


def _payload(source: Source, payloads: Payloads, channel: Channel, kind: str) -> SeenPayload | str:
    """What is seen of a topic, or why nothing is (empty when it has no message)."""
    faults: list[str] = []
    first = _opened(source, payloads, islice(source.messages([channel.topic]), _ENDS), faults)
    if not first:
        return faults[0] if faults else ""
    last = _opened(source, payloads, _tail(source, channel.topic))
    times = tuple(stamped for stamped, _ in first)
    return SeenPayload(channel, kind, first[0][1], times, tuple(stamped for stamped, _ in last) or times)


def times_between(
    source: Source, payloads: Payloads, topic: str, from_ns: int, until_ns: int | None
) -> tuple[Stamped, ...]:
    """The first and last few times of a topic's messages recorded from ``from_ns`` on and before ``until_ns``."""
    last_ns = None if until_ns is None else until_ns - 1
    first = _opened(source, payloads, islice(source.messages([topic], from_ns, last_ns), _ENDS))
    last = _opened(source, payloads, _last(source.messages([topic], from_ns, last_ns)))
    return tuple(stamped for stamped, _ in (*first, *last))


def _opened(
    source: Source, payloads: Payloads, messages: Iterable[RawMessage], faults: list[str] | None = None
) -> list[tuple[Stamped, str]]:
    found = []
    for raw in messages:
        try:
            opened = payloads.open(source, raw)
        except RecordingError as error:  # counted when the recording is replayed
            if faults is not None:
                faults.append(str(error))
            continue
        found.append((Stamped(raw.log_ns, opened.stamp_ns), opened.frame))
    return found


def _tail(source: Source, topic: str) -> list[RawMessage]:
    """The last few messages of a topic, found by looking back from the end further and further."""
    if source.start_ns is not None and source.end_ns is not None and source.container not in _TEXT_CONTAINERS:
        back_ns = _WINDOW_NS
        while back_ns < source.end_ns - source.start_ns:
            kept = _last(source.messages([topic], start_ns=source.end_ns - back_ns))
            if len(kept) == _ENDS:
                return kept
            back_ns *= 8
    return _last(source.messages([topic]))


def _last(messages: Iterable[RawMessage]) -> list[RawMessage]:
    kept: list[RawMessage] = []
    for raw in messages:
        kept.append(raw)
        if len(kept) > _ENDS:
            del kept[0]
    return kept


class _PoseSampler:
    """Collects transforms and poses from stretches of a source."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._edges: dict[tuple[str, str, str], tuple[bool, list[Stamped], list[Pose7]]] = {}
        self._poses: dict[tuple[str, str, str], tuple[Channel, list[Stamped], list[Pose7]]] = {}

    def look(self, channels: list[Channel], *, everything: bool) -> None:
        """Read all messages of these channels, or some from all over the recording."""
        topics = sorted({channel.topic for channel in channels})
        if not topics:
            return
        chosen = self._source.messages(topics) if everything else self._stretches(topics, channels)
        for raw in chosen:
            try:
                self._add(raw)
            except RecordingError:
                continue  # counted when the recording is replayed

    def edges(self) -> tuple[SeenEdge, ...]:
        return tuple(
            SeenEdge(parent, child, topic, fixed, tuple(times), tuple(poses))
            for (topic, parent, child), (fixed, times, poses) in self._edges.items()
        )

    def poses(self) -> tuple[SeenPoses, ...]:
        return tuple(
            SeenPoses(channel, frame, child, tuple(times), tuple(poses))
            for (_, frame, child), (channel, times, poses) in self._poses.items()
        )

    def _stretches(self, topics: list[str], channels: list[Channel]) -> Iterator[RawMessage]:
        start_ns, end_ns = self._source.start_ns, self._source.end_ns
        if start_ns is None or end_ns is None or self._source.container in _TEXT_CONTAINERS:
            yield from _bursts(self._source.messages(topics), channels)
            return
        step_ns = max(end_ns - start_ns - _WINDOW_NS, 0) // (_WINDOWS - 1)
        for k in range(_WINDOWS):
            from_ns = start_ns + k * step_ns
            until_ns = from_ns + min(max(step_ns - 1, 1), _WINDOW_NS) if k < _WINDOWS - 1 else end_ns
            seen: Counter[str] = Counter()
            for raw in self._source.messages(topics, from_ns, until_ns):
                seen[raw.channel.topic] += 1
                if seen[raw.channel.topic] <= _PER_WINDOW:
                    yield raw

    def _add(self, raw: RawMessage) -> None:
        channel = raw.channel
        for record in poses_in(self._source, raw):
            if not record.valid:
                continue
            stamped, pose = Stamped(raw.log_ns, record.stamp_ns), pose7(record.xyz_m, record.xyzw)
            if channel.message_type in POSE_TYPES:
                key = (channel.topic, record.frame, record.child)
                _, times, poses = self._poses.setdefault(key, (channel, [], []))
            elif record.frame and record.child and record.frame != record.child:
                key = (channel.topic, record.frame, record.child)
                if len(self._edges) >= MOST_EDGES and key not in self._edges:
                    continue  # counted when the recording is replayed
                fixed, times, poses = self._edges.setdefault(key, (is_static(channel), [], []))
                if fixed:  # the last word counts
                    times.clear()
                    poses.clear()
            else:
                continue
            times.append(stamped)
            poses.append(pose)


def _bursts(messages: Iterable[RawMessage], channels: list[Channel]) -> Iterator[RawMessage]:
    """Rows of messages from all over each topic, and all of a topic that is short or of unknown length."""
    counts: Counter[str] = Counter()
    for channel in channels:
        counts[channel.topic] += channel.count or 0
    seen: Counter[str] = Counter()
    for raw in messages:
        topic = raw.channel.topic
        period = max(counts[topic] // _BURSTS, _BURST)
        if seen[topic] % period < _BURST:
            yield raw
        seen[topic] += 1
