"""Writes the JSON Schema of the configuration from its model: ``python -m mapgraft.outputs.config_schema``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mapgraft_schemas
from mapgraft.config import Config


def generated_config_schema() -> dict[str, Any]:
    """The JSON Schema (2020-12) of the configuration file, as the engine checks it today."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mapgraft configuration",
        **{key: value for key, value in Config.model_json_schema().items() if key != "title"},
    }


def main() -> None:
    """Replace the committed schema by the generated one."""
    path = Path(mapgraft_schemas.__file__).parent / "config.schema.json"
    path.write_text(json.dumps(generated_config_schema(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
