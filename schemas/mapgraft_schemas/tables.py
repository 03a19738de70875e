"""The schemas of the Parquet tables: TOML files with types, units and conventions, turned into Arrow schemas.

Only types that DuckDB, Polars, pandas and Hugging Face ``datasets`` all read: no map, no uuid, no tensor, no bool8.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

VERSION = "1.1.0"
EXPERIMENTS = ("experiment_merges", "experiment_evidence", "experiment_verdicts", "experiment_times")
CORPORA = ("runs", "failures")
TABLES = (
    *("events", "metrics", "maps", "examples", "labels", "recordings", "timings", "traffic", "transforms", "dataset"),
    *CORPORA,
    *EXPERIMENTS,
)


@dataclass(frozen=True, slots=True)
class Column:
    """One column; ``type`` is spelt as Arrow prints it, ``unit`` and ``convention`` are empty where there is none.

    ``feature`` says what Hugging Face ``datasets`` makes of it where the type does not tell: ``image``.
    """

    name: str
    type: str
    doc: str
    unit: str = ""
    convention: str = ""
    feature: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """One table: its columns in order, and the columns by which its rows are sorted."""

    name: str
    doc: str
    sorted_by: tuple[str, ...]
    columns: tuple[Column, ...]


@cache
def table(name: str) -> Table:
    """The description of one of ``TABLES``; raises KeyError for another name."""
    if name not in TABLES:
        raise KeyError(name)
    text = (files("mapgraft_schemas") / "tables" / f"{name}.toml").read_text(encoding="utf-8")
    given = tomllib.loads(text)
    columns = tuple(Column(**column) for column in given["columns"])
    if "extends" in given:
        columns = (*table(given["extends"]).columns, *columns)
    return Table(given["name"], given["doc"], tuple(given["sorted_by"]), columns)


@cache
def arrow_schema(name: str) -> Any:
    """The ``pyarrow.Schema`` of one of ``TABLES``, with doc, unit and convention in the metadata of its fields.

    The schema's own metadata hold ``schema_name``, ``schema_version``, ``doc`` and ``sorted_by``, and where there are
    pictures what tells Hugging Face ``datasets`` so (``huggingface``).
    """
    import pyarrow as pa  # here: message texts and descriptions are used without Arrow

    described = table(name)
    fields = [pa.field(column.name, arrow_type(column.type), metadata=_notes(column)) for column in described.columns]
    metadata = {
        "schema_name": f"mapgraft.{name}",
        "schema_version": VERSION,
        "doc": described.doc,
        "sorted_by": ",".join(described.sorted_by),
    }
    if images := {column.name: {"_type": "Image"} for column in described.columns if column.feature == "image"}:
        metadata["huggingface"] = json.dumps({"info": {"features": images}})
    return pa.schema(fields, metadata=metadata)


def arrow_type(text: str) -> Any:
    """The ``pyarrow.DataType`` of a type's text, e.g. ``list<struct<name: string, value: double>>``.

    Raises ValueError for a text that it does not know.
    """
    import pyarrow as pa

    scalars: Mapping[str, Any] = {
        "string": pa.string(),
        "int64": pa.int64(),
        "uint8": pa.uint8(),
        "double": pa.float64(),
        "bool": pa.bool_(),
        "binary": pa.binary(),
        "timestamp[ns, UTC]": pa.timestamp("ns", tz="UTC"),
        "dictionary<string>": pa.dictionary(pa.int32(), pa.string()),
    }
    if text in scalars:
        return scalars[text]
    if fixed := re.fullmatch(r"fixed_size_list<(.+)>\[(\d+)\]", text):
        return pa.list_(arrow_type(fixed[1]), int(fixed[2]))
    if listed := re.fullmatch(r"list<(.+)>", text):
        return pa.list_(arrow_type(listed[1]))
    if struct := re.fullmatch(r"struct<(.+)>", text):
        members = re.split(r", (?=\w+: )", struct[1])  # they are scalars: nothing nests deeper
        parts = [member.partition(": ") for member in members]
        return pa.struct([pa.field(name, arrow_type(inner)) for name, _, inner in parts])
    raise ValueError(f"there is no column type {text!r}")


def _notes(column: Column) -> dict[str, str]:
    notes = {"doc": column.doc, "unit": column.unit, "convention": column.convention}
    return {key: value for key, value in notes.items() if value}
