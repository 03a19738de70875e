"""The schemas: the committed configuration schema is the engine's, and tables hold only what everybody reads."""

from __future__ import annotations

import json
from typing import Any

import pyarrow as pa
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mapgraft.config import parse_config
from mapgraft.outputs.config_schema import generated_config_schema
from mapgraft_schemas import (
    MESSAGE_PACKAGE,
    TABLES,
    VERSION,
    arrow_schema,
    config_schema,
    message_texts,
    table,
    viewer_layout,
)
from mapgraft_schemas.tables import arrow_type


def test_the_committed_config_schema_is_what_the_engine_checks() -> None:
    generated = json.loads(json.dumps(generated_config_schema()))
    assert config_schema() == generated, "run: python -m mapgraft.outputs.config_schema"


def test_the_config_schema_names_every_section() -> None:
    parse_config({})
    assert {"mission", "robots", "exchange", "priors", "verdicts", "output"} <= config_schema()["properties"].keys()
    assert config_schema()["additionalProperties"] is False


def readable(kind: pa.DataType) -> bool:
    """Whether DuckDB, Polars, pandas and Hugging Face datasets all read the type."""
    if pa.types.is_dictionary(kind):
        return bool(kind.value_type == pa.string())
    if pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind):
        return readable(kind.value_type)
    if pa.types.is_struct(kind):
        return all(readable(kind.field(n).type) for n in range(kind.num_fields))
    plain = (pa.string(), pa.uint8(), pa.int64(), pa.float64(), pa.bool_(), pa.binary(), pa.timestamp("ns", tz="UTC"))
    return kind in plain


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_described_and_readable_by_all(name: str) -> None:
    schema = arrow_schema(name)
    assert schema.names == [column.name for column in table(name).columns]
    assert len(set(schema.names)) == len(schema.names)
    assert set(table(name).sorted_by) <= set(schema.names)
    assert schema.metadata[b"schema_version"] == VERSION.encode()
    for column, field in zip(table(name).columns, schema, strict=True):
        assert readable(field.type)
        assert column.doc and column.doc == column.doc.strip() and not column.doc.endswith(".")
        for ending, unit in (("_m", "m"), ("_rad", "rad"), ("_s", "s"), ("_bytes", "B"), ("_m2", "m²")):
            assert not column.name.endswith(ending) or column.unit == unit
        assert not column.name.startswith("T_") or "·" in column.convention


def test_types_are_spelt_as_arrow_prints_them_or_refused() -> None:
    assert arrow_type("list<struct<name: string, value: double>>") == pa.list_(
        pa.struct([("name", pa.string()), ("value", pa.float64())])
    )
    assert arrow_type("fixed_size_list<double>[16]") == pa.list_(pa.float64(), 16)
    for text in ("float", "map<string, double>", "list<uuid>", "fixed_size_list<double>"):
        with pytest.raises(ValueError, match="there is no column type"):
            arrow_type(text)
    with pytest.raises(KeyError):
        table("nothing")


def test_message_texts_are_complete_ros_2_definitions() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in message_texts().items():
        store.register(get_types_from_msg(text, name))
        assert name.startswith(f"{MESSAGE_PACKAGE}/msg/")
    for name in message_texts():
        assert store.hash_rihs01(name).startswith("RIHS01_")
        assert all(field == field.lower() for field, _ in store.fielddefs[name][1])


def test_the_viewer_layout_shows_world_with_panels_that_exist() -> None:
    layout = viewer_layout()
    panels = layout["configById"]

    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    assert panels["3D!mapgraft"]["followTf"] == "world"
    assert panels["RawMessages!events"]["topicPath"] == "/merge/events"
