"""The .db3 files of ROS 2 bags, with or without their metadata.yaml."""

from __future__ import annotations

import sqlite3
import weakref
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from mapgraft.contracts.sources import Channel, RawMessage, ReadFaults, RecordedScan, ScanMessage, SchemaText
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.latching import keeps_last
from mapgraft.recording.containers.scanning import scans_of
from mapgraft.recording.containers.selection import Wanted, wanted
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, Codec, Undecodable, codec_for
from mapgraft.recording.decoding.names import message_type

MAGIC = b"SQLite format 3\0"

_INT64 = 2**63
_TABLES = "SELECT name FROM sqlite_master WHERE type = 'table'"
_DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY id DESC"
_COUNTS = "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages GROUP BY topic_id"
_ROWS = """
    SELECT id, topic_id, timestamp, data FROM messages {}
    WHERE (timestamp, id) > (?, ?) AND timestamp BETWEEN ? AND ? AND topic_id IN ({{}}) ORDER BY {}
"""
_BY_TIME = _ROWS.format("", "timestamp, id")
_BY_ID = _ROWS.format("NOT INDEXED", "id")


class SqliteSource:
    """One .db3 file. Raises RecordingError when it is empty, no database, or not one of a ROS 2 bag.

    Message types come from the file where it has them (recorders since 2023) and else from ``typestore``. A database
    that is damaged in the middle is read as far as possible; ``faults`` says so.
    """

    container = "rosbag2"

    def __init__(self, path: Path, *, typestore: str = DEFAULT_TYPESTORE) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._database = _open(path, self.faults)
        weakref.finalize(self, self._database.close)
        self._codecs: dict[int, Codec] = {}
        self._schemas: dict[int, SchemaText] = {}
        try:
            self._tables = {name for (name,) in self._database.execute(_TABLES)}
            if not {"topics", "messages"} <= self._tables:
                raise RecordingError(f"{path} is a database but no ROS 2 bag: it has no tables of topics and messages")
            counts = self._count()
            self.channels = tuple(self._channel(topic, counts, typestore) for topic in self._topics())
        except sqlite3.Error as error:
            self._database.close()
            raise RecordingError(
                f"{path} cannot be read as a ROS 2 bag ({error}): if it was cut off, "
                f"'sqlite3 {path.name} .recover' may help"
            ) from error

    def _topics(self) -> list[_Topic]:
        definitions = {}
        if "message_definitions" in self._tables:
            rows = self._database.execute(_DEFINITIONS)
            definitions = {name: (encoding, text.encode()) for name, encoding, text in rows}
        columns = {row[1] for row in self._database.execute("PRAGMA table_info(topics)")}
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        rows = self._database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id")
        return [
            _Topic(number, topic, SchemaText(kind, *definitions.get(kind, ("ros2msg", b""))), encoding, str(profiles))
            for number, topic, kind, encoding, profiles in rows
        ]

    def _count(self) -> dict[int, int] | None:
        """Messages per topic, and the times of the first and the last; None where damage forbids counting."""
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        try:
            rows = self._database.execute(_COUNTS).fetchall()
        except sqlite3.Error as error:
            self._note_damage(error)
            return None
        if rows:
            self.start_ns = min(start_ns for _, _, start_ns, _ in rows)
            self.end_ns = max(end_ns for _, _, _, end_ns in rows)
        return {number: count for number, count, _, _ in rows}

    def _channel(self, topic: _Topic, counts: dict[int, int] | None, typestore: str) -> Channel:
        self._schemas[topic.id] = topic.schema
        codec = codec_for(topic.encoding, topic.schema, typestore)
        if not isinstance(codec, Undecodable):
            self._codecs[topic.id] = codec
        return Channel(
            topic.id,
            topic.name,
            message_type(topic.schema.name),
            topic.encoding,
            None if counts is None else counts.get(topic.id, 0),
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
        for query in (_BY_TIME, _BY_ID):
            try:
                for row, message in self._rows(query, want, last):
                    last = (message.log_ns, row)
                    yield message
                return
            except sqlite3.Error as error:  # then what lies behind the damage, in the order of recording
                self._note_damage(error)

    def _rows(self, query: str, want: Wanted, after: tuple[int, int]) -> Iterator[tuple[int, RawMessage]]:
        """Rows and messages that come after a (log time, row)."""
        if not want.channels:
            return
        marks = ",".join("?" * len(want.channels))
        window = (max(after[0], -_INT64), after[1], max(want.start_ns, -_INT64), min(want.end_ns, _INT64 - 1))
        for row, number, log_ns, data in self._database.execute(query.format(marks), (*window, *want.channels)):
            yield row, RawMessage(want.channels[number], log_ns, data)

    def _note_damage(self, error: sqlite3.Error) -> None:
        sentence = f"the database is damaged ({error}): what can still be reached is read"
        self.faults.add("database_damaged", sentence, place=0)

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


class _Topic(NamedTuple):
    id: int
    name: str
    schema: SchemaText
    encoding: str
    qos: str


def _open(path: Path, faults: ReadFaults) -> sqlite3.Connection:
    """Open read-only; what a killed recorder left in its write-ahead log is read where the folder allows it."""
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    if head != MAGIC:
        what = "empty (0 bytes)" if not head else "not a database"
        raise RecordingError(f"{path} is {what}: it cannot be a ROS 2 bag")
    address = path.resolve().as_uri() + "?mode=ro"
    log = path.with_name(path.name + "-wal")
    if log.exists() and log.stat().st_size:
        try:
            database = sqlite3.connect(address, uri=True, check_same_thread=False)
            database.execute(_TABLES).fetchall()
            return database
        except sqlite3.Error:
            faults.add("log_unread", f"{log.name} beside the bag cannot be read: the last messages may be missing")
    return sqlite3.connect(f"{address}&immutable=1", uri=True, check_same_thread=False)
