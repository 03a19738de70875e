"""The two JSON documents: the schema of the configuration and the layout for viewers."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any


def config_schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of the configuration file, as generated from the engine's own model."""
    return _document("config.schema.json")


def viewer_layout() -> dict[str, Any]:
    """The layout for Foxglove and Lichtblick: three-dimensional view in frame ``world``, events, log, state.

    Topics of robots are not in it: whoever writes a file adds them to the ``topics`` of the panel ``3D!mapgraft``.
    """
    return _document("viewer_layout.json")


def _document(name: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((files("mapgraft_schemas") / name).read_text(encoding="utf-8"))
    return document
