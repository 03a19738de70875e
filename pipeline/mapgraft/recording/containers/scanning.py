"""Scans out of any source, message by message."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from mapgraft.contracts.sources import SCAN_TYPES, RawMessage, ReadFaults, RecordedScan, Source
from mapgraft.errors import RecordingError


def decoded_scan(source: Source, message: RawMessage, faults: ReadFaults) -> RecordedScan | None:
    """The scan in a message; None, counted as a fault, when it cannot be decoded."""
    try:
        return RecordedScan(message.channel, message.log_ns, source.decode_scan(message))
    except RecordingError as error:
        faults.add("scan_undecodable", str(error), topic=message.channel.topic, place=message.log_ns)
        return None


def scans_of(
    source: Source, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None, faults: ReadFaults
) -> Iterator[RecordedScan]:
    """``Source.scans`` for sources that have no faster way."""
    names = {
        channel.topic
        for channel in source.channels
        if channel.message_type in SCAN_TYPES and (topics is None or channel.topic in topics)
    }
    if not names:
        return
    for message in source.messages(names, start_ns, end_ns):
        if message.channel.message_type in SCAN_TYPES:
            scan = decoded_scan(source, message, faults)
            if scan is not None:
                yield scan
