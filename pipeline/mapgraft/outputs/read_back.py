"""Reading a merge recording back, whole or left behind by a run that was killed."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from mapgraft.errors import OutputError
from mapgraft.events import Event
from mapgraft.outputs.event_message import event_of
from mapgraft.outputs.mcap_log import EVENTS, RUN_RECORD
from mapgraft.outputs.messages import MERGE_EVENT, MessageEncoder
from mapgraft.outputs.provenance import is_run_id

_BROKEN = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError)
_MAGIC = b"\x89MCAP0\r\n"


def read_events(path: Path) -> list[Event]:
    """All events of a ``.merge.mcap`` or a ``.merge.mcap.partial``, in order; of a cut file those before the cut.

    Raises OutputError when the file cannot be read, is no MCAP, was finished and is damaged, or tells of events with
    other fields than these have here.
    """
    encoder, channels, events, schemas = MessageEncoder(), set[int](), list[Event](), dict[int, bytes]()
    for record in _records(path):
        if isinstance(record, Schema):
            schemas[record.id] = record.data
        elif isinstance(record, Channel) and record.topic == EVENTS:
            if not encoder.is_as_here(MERGE_EVENT, schemas.get(record.schema_id, b"").decode(errors="replace")):
                raise OutputError(
                    f"{path} was written by another version of mapgraft, whose events have other fields: "
                    "read it with that version, or run again"
                )
            channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id in channels:
            events.append(event_of(encoder.decode(MERGE_EVENT, record.data)))
    return events


@dataclass(frozen=True, slots=True)
class Told:
    """What a recording tells of, as far as it can be read: of which run it is, and how many events there are."""

    run_id: str = ""
    events: int = 0


def told_by(path: Path) -> Told:
    """What a ``.merge.mcap.partial`` tells of; nothing where the file is none. Raises OSError."""
    run_id, events, channels = "", 0, set[int]()
    with path.open("rb") as stream, suppress(*_BROKEN):
        for record in _reader(stream).records:
            if isinstance(record, Metadata) and record.name == RUN_RECORD:
                run_id = record.metadata.get("run_id", "")
            elif isinstance(record, Channel) and record.topic == EVENTS:
                channels.add(record.id)
            elif isinstance(record, Message) and record.channel_id in channels:
                events += 1
    return Told(run_id if is_run_id(run_id) else "", events)


def read_attachment(path: Path, name: str) -> bytes:
    """What was attached to a ``.merge.mcap`` or its ``.partial`` under a name, such as ``config.yaml``.

    Raises OutputError when there is no such attachment, or as ``read_events`` does.
    """
    for record in _records(path):
        if isinstance(record, Attachment) and record.name == name:
            return record.data
    raise OutputError(f"{path} holds no attachment {name!r}: give the .merge.mcap of an output folder")


def _records(path: Path) -> Iterator[McapRecord]:
    try:
        with path.open("rb") as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise OutputError(f"{path} is no MCAP file: give the .merge.mcap of an output folder")
            finished = _is_finished(path)
            stream.seek(0)
            try:
                yield from _reader(stream).records
            except _BROKEN as error:
                if finished:
                    raise OutputError(f"{path} is damaged ({error}): run again to write it anew") from error
    except OSError as error:
        raise OutputError(f"{path} cannot be read: {error.strerror or error}") from error


class _Bounded:
    """A file that is asked for no more than it holds, whatever a damaged length says."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._size = stream, os.fstat(stream.fileno()).st_size

    def read(self, size: int) -> bytes:
        return self._stream.read(min(size, self._size))


def _reader(stream: BinaryIO) -> StreamReader:
    return StreamReader(cast("BinaryIO", _Bounded(stream)), validate_crcs=True)


def _is_finished(path: Path) -> bool:
    with path.open("rb") as stream:
        if stream.seek(-len(_MAGIC), 2) == 0:
            return False  # the mark is that of the beginning
        return stream.read() == _MAGIC
