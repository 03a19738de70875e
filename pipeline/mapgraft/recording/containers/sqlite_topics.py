"""What the table of topics of a .db3 file tells."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection
from typing import NamedTuple

from mapgraft.contracts.sources import SchemaText

_DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY id DESC"


class Topic(NamedTuple):
    id: int
    name: str
    schema: SchemaText
    encoding: str
    qos: str


def read_topics(database: sqlite3.Connection, tables: Collection[str]) -> list[Topic]:
    """The topics of an open database that has these tables; raises sqlite3.Error when they cannot be read."""
    definitions = {}
    if "message_definitions" in tables:
        rows = database.execute(_DEFINITIONS)
        definitions = {str(name): (str(encoding), text.encode()) for name, encoding, text in rows}
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    told = database.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id").fetchall()
    if not all(isinstance(value, str) for row in told for value in row[1:4]):
        raise TypeError("topics must have a name, a type and a format")
    return [
        Topic(number, topic, SchemaText(kind, *definitions.get(kind, ("ros2msg", b""))), encoding, str(profiles))
        for number, topic, kind, encoding, profiles in told
    ]


def computed_columns(database: sqlite3.Connection) -> str:
    """The columns that a database's schema computes instead of holding them; empty when there are none."""
    found = [
        f"{table}.{row[1]}"
        for table in ("topics", "messages", "message_definitions")
        for row in database.execute(f"PRAGMA table_xinfo({table})")
        if row[6]  # hidden: a generated column, or one of a virtual table
    ]
    return ", ".join(found)
