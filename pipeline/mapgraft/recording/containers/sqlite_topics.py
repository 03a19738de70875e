"""What the table of topics of a .db3 file tells."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from typing import Any, NamedTuple

from mapgraft.contracts.sources import SchemaText

_DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY id DESC"

Row = tuple[Any, ...]


class Topic(NamedTuple):
    id: int
    name: str
    schema: SchemaText
    encoding: str
    qos: str


def read_topics(database: sqlite3.Connection, tables: Collection[str], most_bytes: int) -> list[Topic]:
    """The topics of an open database that has these tables.

    Raises sqlite3.Error when they cannot be read, TypeError when a row is no topic, or all have more than
    ``most_bytes`` letters.
    """
    room, definitions = _Room(most_bytes), dict[str, tuple[str, bytes]]()
    if "message_definitions" in tables:
        for name, encoding, text in map(room.take, database.execute(_DEFINITIONS)):
            definitions[str(name)] = (str(encoding), text.encode())
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    rows = database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id")
    topics = []
    for number, topic, kind, encoding, profiles in map(room.take, rows):
        if not isinstance(number, int) or not all(isinstance(text, str) for text in (topic, kind, encoding)):
            raise TypeError("topics must have a name, a type and a format")
        schema = SchemaText(kind, *definitions.get(kind, ("ros2msg", b"")))
        topics.append(Topic(number, topic, schema, encoding, str(profiles)))
    return topics


class _Room:
    """What all rows together may take: the texts of a few pages may be shared by many."""

    def __init__(self, most_bytes: int) -> None:
        self._most, self._taken = most_bytes, 0

    def take(self, row: Row) -> Row:
        self._taken += sum(len(value) for value in row if isinstance(value, str | bytes))
        if self._taken > self._most:
            raise TypeError(f"its topics have more than {self._most:,} letters")
        return row
