"""Topics and messages of a .db3 file that SQLite itself cannot read any more."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.sources import RawMessage, ReadFaults, SchemaText
from mapgraft.recording.containers.chunks import MESSAGES_LOST
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.mapping import map_file
from mapgraft.recording.containers.selection import Wanted
from mapgraft.recording.containers.sqlite_pages import Cell, Pages, Value
from mapgraft.recording.containers.sqlite_topics import Topic

_DEFINITION_KINDS = ("ros2msg", "ros2idl")
_BLOB = 12  # even serial types from here on are bytes, odd ones texts


class SalvagedBag:
    """The rows that the pages of a .db3 file hold.

    ``topics`` are by their ids; ``counts`` are messages per topic id, those included that turn out unreadable. Raises
    ValueError when its head is broken, RecordingError when so many rows share pages that they would unpack to far more
    than the file has.
    """

    def __init__(self, path: Path, limits: ReadLimits) -> None:
        view = map_file(path)
        self._pages, self._limits = Pages(view), limits
        self._text_bytes = 0
        topics, definitions = dict[int, list[Value]](), dict[str, tuple[str, bytes]]()
        rows: dict[int, tuple[int, int, int, int, int]] = {}
        for cell in self._pages.cells():
            types = self._pages.types(cell)
            if types is None or not types or types[0] != 0:  # all tables begin with the number of the row
                continue
            if len(types) == 4 and types[3] >= _BLOB and types[3] % 2 == 0 and max(types[1:3]) < _BLOB:
                self._take_message(cell, types, rows)
            elif len(types) >= 4 and all(kind >= _BLOB and kind % 2 for kind in types[1:4]):
                self._take_text(cell, types, topics, definitions)
        self.topics = tuple(_topic(number, values, definitions) for number, values in sorted(topics.items()))
        table = np.array(sorted(rows.values()), np.int64).reshape(-1, 5)
        self._rows: NDArray[np.int64] = table  # (n, 5): log time, row, topic, where its cell begins, its size
        self.counts: Counter[int] = Counter(table[:, 2].tolist())
        limits.check_expansion(path, len(view), int(table[:, 4].sum(dtype=np.float64)))  # pages may be shared by many

    @property
    def span_ns(self) -> tuple[int | None, int | None]:
        """The first and the last log time."""
        times = self._rows[:, 0]
        return (int(times[0]), int(times[-1])) if len(times) else (None, None)

    def _take_message(self, cell: Cell, types: Sequence[int], rows: dict[int, tuple[int, int, int, int, int]]) -> None:
        values = self._pages.values(cell, types, 3, self._limits.chunk_bytes)
        if values is None or not isinstance(values[1], int) or not isinstance(values[2], int):
            return
        if cell.rowid < 1 << 63:
            rows.setdefault(cell.rowid, (values[2], cell.rowid, values[1], cell.begin, cell.size))

    def _take_text(
        self,
        cell: Cell,
        types: Sequence[int],
        topics: dict[int, list[Value]],
        definitions: dict[str, tuple[str, bytes]],
    ) -> None:
        left = self._limits.chunk_bytes - self._text_bytes
        values = self._pages.values(cell, types, min(len(types), 5), left)
        if values is None:
            return
        self._text_bytes += cell.size
        if values[2] in _DEFINITION_KINDS:
            definitions.setdefault(str(values[1]), (str(values[2]), str(values[3]).encode()))
        elif str(values[1]).startswith("/") and "/" in str(values[2]):
            topics.setdefault(cell.rowid, values)

    def messages(self, want: Wanted, after: tuple[int, int], faults: ReadFaults) -> Iterator[tuple[int, RawMessage]]:
        """Rows and messages by log time that come after a (log time, row); what cannot be read is counted."""
        for log_ns, row, topic, begin, size in self._rows.tolist():
            channel = want.channels.get(topic)
            if channel is None or not want.start_ns <= log_ns <= want.end_ns or (log_ns, row) <= after:
                continue
            cell = Cell(begin // self._pages.page_bytes, row, begin, size)
            data, types = self._pages.payload(cell, self._limits.chunk_bytes), self._pages.types(cell)
            if data is None or types is None:
                why = "pages of it are missing or damaged"
                if size > self._limits.chunk_bytes:
                    why = f"it has more than {self._limits.chunk_bytes:,} bytes (limits.chunk_bytes)"
                sentence = f"message {row} of the database cannot be read: {why}"
                faults.add(MESSAGES_LOST, sentence, topic=channel.topic, place=row)
            else:
                yield row, RawMessage(channel, log_ns, data[size - (types[3] - _BLOB) // 2 :])


def _topic(number: int, values: Sequence[Value], definitions: dict[str, tuple[str, bytes]]) -> Topic:
    name, kind, encoding = (str(value) for value in values[1:4])
    profiles = str(values[4]) if len(values) > 4 and isinstance(values[4], str) else ""
    return Topic(number, name, SchemaText(kind, *definitions.get(kind, ("ros2msg", b""))), encoding, profiles)
