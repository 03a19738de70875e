"""MCAP files that describe one channel twice, differently: several files joined to one, or writers that start over.

Within a file an id stands for what was said of it last, in the order of the file. So each description gets a number of
its own, and each chunk remembers which of them hold in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

from mcap.records import Channel as ChannelRecord
from mcap.records import Schema

from mapgraft.recording.containers.mcap_messages import Messages, Spans, messages, spans
from mapgraft.recording.containers.mcap_records import OPCODE_CHANNEL, OPCODE_SCHEMA, parsed, records
from mapgraft.recording.containers.selection import Wanted

_FIRST_NUMBER = 1 << 16  # ids have two bytes


class Renaming(NamedTuple):
    """From ``offset`` in a chunk's content on the channel ``told`` is the one with this ``number``."""

    offset: int
    told: int
    number: int


@dataclass(slots=True)
class Descriptions:
    """Every description of a schema or channel in a file, by a number: the id itself for the first one of an id."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    told: dict[int, int] = field(default_factory=dict)  # number → id
    _schemas: dict[int, int] = field(default_factory=dict)  # id → the number that holds now
    _channels: dict[int, int] = field(default_factory=dict)
    _numbers: dict[object, int] = field(default_factory=dict)

    def declare(self, value: object) -> None:
        """Take in a schema or channel: from now on its id stands for that."""
        if isinstance(value, Schema):
            key = (value.id, value.name, value.encoding, value.data)
            number = self._schemas[value.id] = self._number(key, value.id, self.schemas)
            self.schemas.setdefault(number, replace(value, id=number))
        elif isinstance(value, ChannelRecord):
            schema = self._schemas.get(value.schema_id, value.schema_id)
            channel_key = (value.id, value.topic, value.message_encoding, schema)
            number = self._channels[value.id] = self._number(channel_key, value.id, self.channels)
            self.channels.setdefault(number, replace(value, id=number, schema_id=schema))
            self.told[number] = value.id

    def _number(self, key: object, told: int, taken: Mapping[int, object]) -> int:
        if key not in self._numbers:
            self._numbers[key] = _FIRST_NUMBER + len(self._numbers) if told in taken else told
        return self._numbers[key]

    @property
    def renamed(self) -> dict[int, int]:
        """The channels whose id stands for another than the first of that id: id → number."""
        return {told: number for told, number in self._channels.items() if told != number}

    def look_through(self, data: bytes | memoryview) -> tuple[Spans, tuple[Renaming, ...]]:
        """What a chunk's content holds, counted by number, and which numbers hold where in it."""
        view = memoryview(data)
        changes = [Renaming(0, *item) for item in sorted(self.renamed.items())]
        for record in records(view, 0, len(view)):
            if record.opcode in (OPCODE_SCHEMA, OPCODE_CHANNEL):
                before = dict(self._channels)
                self.declare(parsed(view, record))
                now = sorted(self._channels.items())
                changes += [Renaming(record.offset, *item) for item in now if before.get(item[0], item[0]) != item[1]]
        found = Spans()
        for part, names in _parts(view, changes):
            _add(found, spans(part, lambda _: None), names)
        return found, tuple(changes)


def renamed_messages(data: bytes | memoryview, want: Wanted, changes: Sequence[Renaming]) -> Messages:
    """The wanted messages of a chunk in which ids stand for other channels, as ``messages``."""
    out = Messages([], False, 0)
    for part, names in _parts(memoryview(data), changes):
        numbers = {number: number for number in want.declared if number < _FIRST_NUMBER} | names
        channels = {told: want.channels[number] for told, number in numbers.items() if number in want.channels}
        found, broken, strangers = messages(part, replace(want, channels=channels, declared=frozenset(numbers)))
        out = Messages(out.found + found, broken, out.strangers + strangers)
        if broken:
            break
    out.found.sort(key=lambda message: message.log_ns)
    return out


def _parts(view: memoryview, changes: Sequence[Renaming]) -> list[tuple[memoryview, dict[int, int]]]:
    """The content between two changes, with the ids that stand for another number there."""
    parts, names = [], dict[int, int]()
    for begin, end in pairwise(sorted({0, len(view), *(change.offset for change in changes)})):
        names = names | {change.told: change.number for change in changes if change.offset == begin}
        parts.append((view[begin:end], names))
    return parts


def _add(found: Spans, more: Spans, names: Mapping[int, int]) -> None:
    if not more.counts:
        return
    known = bool(found.counts)
    found.start_ns = min(found.start_ns, more.start_ns) if known else more.start_ns
    found.end_ns = max(found.end_ns, more.end_ns) if known else more.end_ns
    for told, count in more.counts.items():
        number = names.get(told, told)
        found.counts[number] = found.counts.get(number, 0) + count
