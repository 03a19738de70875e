"""The .db3 files of ROS 2 bags, with or without their metadata.yaml."""

from __future__ import annotations

import sqlite3
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from mapgraft.contracts.sources import Channel, RawMessage, ReadFaults, RecordedScan, ScanMessage, SchemaText
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.chunks import MESSAGES_LOST
from mapgraft.recording.containers.latching import keeps_last
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.scanning import scans_of
from mapgraft.recording.containers.selection import Wanted, wanted
from mapgraft.recording.containers.sqlite_opening import StepLimit, open_database, plain_tables
from mapgraft.recording.containers.sqlite_salvage import SalvagedBag
from mapgraft.recording.containers.sqlite_topics import Topic, read_topics
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, Codec, Undecodable, codec_for
from mapgraft.recording.decoding.names import message_type

_INT64 = 2**63
_BROKEN = (sqlite3.Error, UnicodeDecodeError, AttributeError, TypeError, LookupError, OverflowError, MemoryError)
# In one pass over the rows' heads: the LIMIT keeps SQLite from sorting whole rows, and a value of another type, which
# may be large and shared by many rows, is not loaded.
_COUNTS = """
    SELECT topic, COUNT(*), MIN(time), MAX(time), COUNT(*) - COUNT(time), TOTAL(size) FROM (
        SELECT CASE typeof(topic_id) WHEN 'integer' THEN topic_id END AS topic,
            CASE typeof(timestamp) WHEN 'integer' THEN timestamp END AS time,
            CASE typeof(data) WHEN 'blob' THEN length(data) END AS size FROM messages LIMIT -1
    ) GROUP BY topic
"""
_ROWS = """
    SELECT id, topic_id, timestamp, data FROM messages
    WHERE (timestamp, id) > (?, ?) AND timestamp BETWEEN ? AND ? AND topic_id IN ({}) ORDER BY timestamp, id
"""


class SqliteSource:
    """One .db3 file. Raises RecordingError when it is empty, no database, or not one of a ROS 2 bag.

    Message types come from the file where it has them (recorders since 2023) and else from ``typestore``. Of a
    database that was cut off or damaged the rows of all pages that are left are read; ``faults`` says so.
    """

    container = "rosbag2"

    def __init__(self, path: Path, *, typestore: str = DEFAULT_TYPESTORE, limits: ReadLimits = DEFAULT_LIMITS) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._limits = limits
        self._salvaged: SalvagedBag | None = None
        self._database = open_database(path, self.faults, limits)
        weakref.finalize(self, self._database.close)
        self._steps = StepLimit(self._database, path)
        self._codecs: dict[int, Codec] = {}
        self._schemas: dict[int, SchemaText] = {}
        topics, counts = self._contents()
        self.channels = tuple(self._channel(topic, counts, typestore) for topic in topics)

    def _contents(self) -> tuple[Sequence[Topic], Mapping[int, int]]:
        """The topics, and how many messages each has; sets the times of the first and the last."""
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        try:
            topics, rows = self._told()
        except _BROKEN as error:
            salvaged = self._salvage(error)
            self.start_ns, self.end_ns = salvaged.span_ns
            return salvaged.topics, salvaged.counts
        if rows:
            self.start_ns = min(start_ns for _, _, start_ns, _ in rows)
            self.end_ns = max(end_ns for _, _, _, end_ns in rows)
        return topics, {number: count for number, count, _, _ in rows}

    def _told(self) -> tuple[Sequence[Topic], list[tuple[int, int, int, int]]]:
        """The topics, and the id, number of messages, first and last time of each; raises one of ``_BROKEN``."""
        self._steps.begin()
        tables, computed = plain_tables(self._database)
        if computed or not {"topics", "messages"} <= tables:
            self._database.close()
            if computed:
                raise RecordingError(f"{self.path} computes {computed} where recorders write: it is not read")
            raise RecordingError(f"{self.path} is a database but no ROS 2 bag: it has no tables of topics and messages")
        topics = read_topics(self._database, tables, self._limits.chunk_bytes)
        self._steps.begin()
        rows = self._database.execute(_COUNTS).fetchall()
        if any(number is None or strange for number, _, _, _, strange, _ in rows):
            raise TypeError("times and topics must be numbers")
        if sum(size for *_, size in rows) > self._steps.stored_bytes:
            raise TypeError("its rows share pages")
        return topics, [row[:4] for row in rows]

    def _salvage(self, error: Exception) -> SalvagedBag:
        """What the pages hold, from now on read without SQLite; raises RecordingError when that is no bag."""
        if self._salvaged is None:
            why = str(error) or "it asks for too much memory"
            sentence = f"the database is damaged or cut off ({why}): the rows that are left in its pages are read"
            self.faults.add("database_damaged", sentence, place=0)
            try:
                self._salvaged = SalvagedBag(self.path, self._limits)
            except ValueError as broken:
                self._database.close()
                raise RecordingError(f"{self.path} cannot be read as a ROS 2 bag ({broken})") from error
            if not self._salvaged.topics:
                self._database.close()
                raise RecordingError(
                    f"{self.path} cannot be read as a ROS 2 bag ({error}), and no topic is left in it"
                ) from error
        return self._salvaged

    def _note_missing(self, salvaged: SalvagedBag) -> None:
        """Count the messages that the database knows of and whose pages are gone."""
        for channel in self.channels:
            missing = (channel.count or 0) - salvaged.counts[channel.id]
            if missing > 0:
                sentence = "a message of the database is lost with its page"
                self.faults.add(MESSAGES_LOST, sentence, topic=channel.topic, place=-1 - channel.id, count=missing)

    def _channel(self, topic: Topic, counts: Mapping[int, int], typestore: str) -> Channel:
        self._schemas[topic.id] = topic.schema
        codec = codec_for(topic.encoding, topic.schema, typestore)
        if not isinstance(codec, Undecodable):
            self._codecs[topic.id] = codec
        return Channel(
            topic.id,
            topic.name,
            message_type(topic.schema.name),
            topic.encoding,
            counts.get(topic.id, 0),
            keeps_last(topic.qos),
            not isinstance(codec, Undecodable),
            codec.why_not if isinstance(codec, Undecodable) else "",
        )

    def schema(self, channel: Channel) -> SchemaText | None:
        """See ``Source.schema``."""
        return self._schemas.get(channel.id)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``; a database holds its messages by time, so memory is bounded by one message."""
        want = wanted(self.channels, topics, start_ns, end_ns)
        last = (want.start_ns, -1)  # (log time, row) of the last message given
        if self._salvaged is None:
            try:
                for row, message in self._rows(want, last):
                    last = (message.log_ns, row)
                    yield message
                return
            except _BROKEN as error:
                if isinstance(error, sqlite3.ProgrammingError):
                    raise RecordingError(f"{self.path} was closed while it was still being read") from error
                self._note_missing(self._salvage(error))
        if self._salvaged is not None:
            for _, message in self._salvaged.messages(want, last, self.faults):
                yield message

    def _rows(self, want: Wanted, after: tuple[int, int]) -> Iterator[tuple[int, RawMessage]]:
        """Rows and messages that come after a (log time, row)."""
        if not want.channels:
            return
        self._steps.begin()
        marks = ",".join("?" * len(want.channels))
        window = (max(after[0], -_INT64), after[1], max(want.start_ns, -_INT64), min(want.end_ns, _INT64 - 1))
        for row, number, log_ns, data in self._database.execute(_ROWS.format(marks), (*window, *want.channels)):
            if isinstance(row, int) and isinstance(log_ns, int) and isinstance(data, bytes):
                yield row, RawMessage(want.channels[number], log_ns, data)
            else:
                sentence = f"row {row} of the messages holds no time or no bytes: it is left out"
                self.faults.add("row_broken", sentence, topic=want.channels[number].topic, place=row)

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        return scans_of(self, topics, start_ns, end_ns, self.faults)

    def decode(self, message: RawMessage) -> object:
        """See ``Source.decode``."""
        return self._codecs[message.channel.id].decode(message.data)

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """See ``Source.decode_scan``."""
        return self._codecs[message.channel.id].decode_scan(message.data)

    def close(self) -> None:
        """See ``Source.close``."""
        self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
