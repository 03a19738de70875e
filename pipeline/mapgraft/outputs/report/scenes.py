"""What the maps looked like when something was decided, read from the merge recording in one pass."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mapgraft.errors import UsageError
from mapgraft.events import Event
from mapgraft.outputs.event_message import event_of
from mapgraft.outputs.findings import TOPIC as FINDINGS
from mapgraft.outputs.mcap_log import EVENTS
from mapgraft.outputs.messages import MERGE_EVENT, MessageEncoder
from mapgraft.outputs.qos import LATCHED
from mapgraft.outputs.report.rasters import Raster, drawable_of, raster_of

Said = Mapping[str, tuple[str, bytes]]  # topic below the robot's or donor's own → message type, last message


@dataclass(slots=True)
class Look:
    """One robot's maps at one moment, as the messages said last."""

    decoder: MessageEncoder
    own: Said
    fused: Said
    donors: Mapping[str, Said]

    def own_raster(self) -> Raster | None:
        return self._raster(self.own)

    def fused_raster(self) -> Raster | None:
        return self._raster(self.fused)

    def donor_raster(self, donor: str) -> Raster | None:
        return self._raster(self.donors.get(donor, {}))

    def undrawn(self) -> list[str]:
        """Message types of the robot's own map, if there is no picture of any of them."""
        types = sorted({message_type for message_type, _ in self.own.values()})
        return types if drawable_of(types) is None else []

    def _raster(self, said: Said) -> Raster | None:
        drawn = drawable_of(message_type for message_type, _ in said.values())
        for _, (message_type, data) in sorted(said.items()):
            if message_type == drawn:
                return raster_of(message_type, self.decoder.decode(message_type, data))
        return None


@dataclass(frozen=True, slots=True)
class Moment:
    """One event, and the receiver's maps right before and right after it."""

    event: Event
    before: Look
    after: Look


@dataclass(slots=True)
class _State:
    own: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    fused: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    donors: dict[str, dict[str, tuple[str, bytes]]] = field(default_factory=dict)

    def look(self, decoder: MessageEncoder) -> Look:
        donors = {name: dict(said) for name, said in self.donors.items()}
        return Look(decoder, dict(self.own), dict(self.fused), donors)


class Scenes:
    """The maps in a merge recording. ``last`` holds every robot's maps as they were said last, after ``moments``."""

    def __init__(self, path: Path) -> None:
        from mcap.reader import make_reader

        self._path = path
        with _reading(path), path.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            names = {record.name: record.metadata for record in reader.iter_metadata()}
            attached = {record.name: record.data for record in reader.iter_attachments()}
        if summary is None or "merge_names" not in names:
            raise UsageError(f"{path} was not finished or is no merge recording: run again")
        self.metadata, self.attached = names, attached
        self._names: Mapping[str, str] = names["merge_names"]  # ROS name → robot
        self._types = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        self._maps = {c.topic: self._whose(c) for c in summary.channels.values()}
        self._decoder = MessageEncoder()
        self._states: dict[str, _State] = {}

    @property
    def last(self) -> Mapping[str, Look]:
        return {robot: state.look(self._decoder) for robot, state in self._states.items()}

    def moments(self, seqs: Collection[int]) -> Iterator[Moment]:
        """The events with these numbers, in order, with the maps around them; reads the whole recording."""
        waiting: tuple[Event, Look] | None = None
        for topic, log_time, data in self._messages():
            if topic == EVENTS:
                if waiting is not None:
                    yield self._ended(waiting)
                    waiting = None
                event = event_of(self._decoder.decode(MERGE_EVENT, data))
                if event.seq in seqs:
                    waiting = event, self._state(event.receiver).look(self._decoder)
                continue
            if waiting is not None and log_time != waiting[0].stamp_ns:
                yield self._ended(waiting)
                waiting = None
            self._take(topic, data)
        if waiting is not None:
            yield self._ended(waiting)

    def _ended(self, waiting: tuple[Event, Look]) -> Moment:
        event, before = waiting
        return Moment(event, before, self._state(event.receiver).look(self._decoder))

    def _messages(self) -> Iterator[tuple[str, int, bytes]]:
        from mcap.reader import make_reader

        wanted = [EVENTS, *(topic for topic, whose in self._maps.items() if whose is not None)]
        with _reading(self._path), self._path.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages(topics=wanted, log_time_order=False):
                yield channel.topic, message.log_time, message.data

    def _take(self, topic: str, data: bytes) -> None:
        whose = self._maps[topic]
        assert whose is not None
        robot, kind, donor, suffix = whose
        state = self._state(robot)
        said = {"own": state.own, "merged": state.fused}.get(kind)
        if said is None:
            said = state.donors.setdefault(donor, {})
        said[suffix] = (self._types[topic], data)

    def _state(self, robot: str) -> _State:
        return self._states.setdefault(robot, _State())

    def _whose(self, channel: Any) -> tuple[str, str, str, str] | None:
        """Robot, which of its maps, donor, and the rest of the topic; None for what is no map."""
        parts = channel.topic.strip("/").split("/")
        robot = self._names.get(parts[0])
        if robot is None or channel.metadata.get("offered_qos_profiles") != LATCHED or parts[1:] == [FINDINGS]:
            return None
        if parts[1] == "donors" and len(parts) > 3 and parts[2] in self._names:
            return robot, "donor", self._names[parts[2]], "/".join(parts[3:])
        if parts[1] == "merged" and len(parts) > 2:
            return robot, "merged", "", "/".join(parts[2:])
        return robot, "own", "", "/".join(parts[1:])


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turns what a damaged file gives into a UsageError of one sentence."""
    from mcap.exceptions import McapError

    try:
        yield
    except (McapError, OSError, struct.error, ValueError) as error:
        raise UsageError(f"{path} cannot be read ({error or type(error).__name__}): run again") from error
