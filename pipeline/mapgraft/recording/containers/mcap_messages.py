"""The messages inside the content of one MCAP chunk."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from typing import NamedTuple

from mapgraft.contracts.sources import RawMessage
from mapgraft.recording.containers.mcap_records import (
    MESSAGE_HEAD,
    OPCODE_CHANNEL,
    OPCODE_MESSAGE,
    OPCODE_SCHEMA,
    parsed,
    records,
)
from mapgraft.recording.containers.selection import Wanted

_message_head = struct.Struct("<BQHIQ").unpack_from  # opcode, length, channel, sequence, log time
_log_ns = attrgetter("log_ns")


@dataclass(slots=True)
class Spans:
    """How many messages of which channel a chunk holds, and from when to when."""

    counts: dict[int, int] = field(default_factory=dict)
    start_ns: int = 0
    end_ns: int = 0


def spans(data: bytes | memoryview, declare: Callable[[object], None]) -> Spans:
    """Look through a chunk's content; its schemas and channels are handed to ``declare``."""
    view, found = memoryview(data), Spans()
    for record in records(view, 0, len(view)):
        if record.opcode in (OPCODE_SCHEMA, OPCODE_CHANNEL):
            declare(parsed(view, record))
        elif record.opcode == OPCODE_MESSAGE and record.whole and record.end - record.offset >= MESSAGE_HEAD:
            _, _, channel, _, log_ns = _message_head(view, record.offset)
            if not found.counts:
                found.start_ns = found.end_ns = log_ns
            found.start_ns, found.end_ns = min(found.start_ns, log_ns), max(found.end_ns, log_ns)
            found.counts[channel] = found.counts.get(channel, 0) + 1
    return found


class Messages(NamedTuple):
    """The wanted messages of a chunk; ``broken`` when its records do not add up to its content, ``strangers`` how many
    messages are of no channel of the file.
    """

    found: list[RawMessage]
    broken: bool
    strangers: int


def messages(data: bytes | memoryview, want: Wanted) -> Messages:
    """The wanted messages of a chunk's content by log time, equal times as they were written.

    ``RawMessage.data`` are views into ``data``. A record that is cut ends the list.
    """
    view = memoryview(data)
    size, position, last_ns, in_order = len(view), 0, 0, True
    channels, declared, start_ns, end_ns = want.channels, want.declared, want.start_ns, want.end_ns
    strangers = 0
    found: list[RawMessage] = []
    while size - position >= MESSAGE_HEAD:  # what is shorter cannot be a message
        opcode, length, channel_id, _, log_ns = _message_head(view, position)
        begin, position = position + MESSAGE_HEAD, position + 9 + length
        if opcode != OPCODE_MESSAGE:
            continue
        if position > size or position < begin:
            return Messages(sorted(found, key=_log_ns), True, strangers)
        if channel_id not in channels or not start_ns <= log_ns <= end_ns:
            strangers += channel_id not in declared
            continue
        found.append(RawMessage(channels[channel_id], log_ns, view[begin:position]))
        in_order = in_order and last_ns <= log_ns
        last_ns = log_ns
    if not in_order:
        found.sort(key=_log_ns)
    return Messages(found, position > size, strangers)
