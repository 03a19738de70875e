"""Examples as rows of their table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import pyarrow as pa

from mapgraft.outputs.parquet_log import PartWriter
from mapgraft.outputs.staging import Staging, writing
from mapgraft.outputs.tables import Row, rows_table
from mapgraft_schemas import Column, table

NAME = "examples"
_SAID_EMPTY = ("compared_type", "rule", "matcher", "acceptor", "fuser", "verifier", "state", "reason", "state_reason")


@cache
def blank() -> Mapping[str, object]:
    """What a column of an example says where there is nothing to say."""
    return {column.name: _blank(column) for column in table(NAME).columns}


def _blank(column: Column) -> object:
    if column.type.startswith("list<struct<name: "):
        return {}
    if column.type.startswith("list<") and not column.name.startswith("classes_"):
        return []
    return "" if column.name in _SAID_EMPTY else None


def examples_table(rows: Sequence[Row]) -> pa.Table:
    """Rows (column → value) in the schema ``examples``; columns that a row leaves out are blank there."""
    return rows_table(NAME, [{**blank(), **row} for row in rows])


def picture(data: bytes | None) -> Mapping[str, object] | None:
    """A PNG as the column of a picture holds it."""
    return None if data is None else {"bytes": data, "path": None}


def write_examples(out: Path, run_id: str, rows: Sequence[Row]) -> str:
    """Write one part of the table into an output folder, atomically; returns its name, relative to the folder.

    Raises OutputError when the folder cannot be written.
    """
    with writing(out):
        staging = Staging(out)
        part = PartWriter(staging, NAME, run_id)
        try:
            for first in range(0, len(rows), 64):
                part.append(examples_table(rows[first : first + 64]))
            part.close()
        except BaseException:
            part.abandon()
            staging.remove()
            raise
        return staging.publish()[0]
