"""With what a run was made: what the configuration says beyond the defaults, versions, and the decision table."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any

from mapgraft.config import Config, RobotConfig


def changed(config: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """What differs from the defaults: path, value, default. Of files only the names: where they lay is nobody's."""
    rows: list[tuple[str, str, str]] = []
    defaults = Config().model_dump(mode="json")
    for key, value in config.items():
        if key == "robots":
            standard = RobotConfig().model_dump(mode="json")
            for robot, said in value.items():
                rows += _differences(f"robots.{robot}", said, standard) or [(f"robots.{robot}", "as discovered", "")]
        else:
            rows += _differences(key, value, defaults.get(key))
    return rows


def _differences(path: str, value: object, default: object) -> list[tuple[str, str, str]]:
    if isinstance(value, Mapping) and isinstance(default, Mapping):
        return [row for key, inner in value.items() for row in _differences(f"{path}.{key}", inner, default.get(key))]
    return [] if value == default else [(path, _spelt(value), _spelt(default))]


def _spelt(value: object) -> str:
    if value is None:
        return "–"
    return value if isinstance(value, str) and not _is_place(value) else json.dumps(_bare(value), ensure_ascii=False)


def _bare(value: object) -> object:
    """The value with paths cut down to names."""
    if isinstance(value, str):
        return PurePath(value).name if _is_place(value) else value
    if isinstance(value, Mapping):
        return {key: _bare(inner) for key, inner in value.items()}
    return [_bare(inner) for inner in value] if isinstance(value, list) else value


def _is_place(text: str) -> bool:
    return PurePath(text).is_absolute()


def versions(metadata: Mapping[str, Mapping[str, str]], run_id: str) -> Iterator[tuple[str, str]]:
    """Software, plugins and digests; neither the machine nor the hour."""
    run = metadata.get("merge_run", {})
    yield "run", run_id
    yield "mapgraft", run.get("version", "")
    for name, version in sorted(json.loads(run.get("plugins", "{}")).items()):
        yield f"plugin {name}", version
    yield "schemas", metadata.get("merge_schema", {}).get("version", "")
    for name in ("config_sha256", "decision_table_sha256"):
        yield name.replace("_", " "), run.get(name, "")
