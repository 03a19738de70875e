"""The page about the configuration shows every key, and its example is a valid configuration."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import BaseModel
from ruamel.yaml import YAML

from mapgraft.config import Choice, Config, MapConfig, parse_config

PAGE = Path(__file__).parents[2] / "docs" / "configuration.md"


@pytest.fixture(scope="module")
def example() -> dict:
    text = re.search(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    return YAML(typ="safe", pure=True).load(text.group(1))


def keys_of(model: type[BaseModel]) -> set[str]:
    """The keys of a section and of the sections inside it."""
    keys = set()
    for name, field in model.model_fields.items():
        keys.add(name)
        for inner in re.findall(r"\b\w+Config\b", str(field.annotation)):
            keys |= keys_of(vars(__import__("mapgraft.config", fromlist=[inner]))[inner])
    return keys


def words_in(value) -> set[str]:
    if isinstance(value, dict):
        return set(map(str, value)) | set().union(*map(words_in, value.values()), set())
    return set().union(*map(words_in, value), set()) if isinstance(value, list) else set()


def test_the_example_is_valid(example):
    assert parse_config(example).robots["alpha"].map.parameters == {"resolution_m": 0.07}


def test_every_key_is_shown(example):
    told = words_in(example) | set(re.findall(r"\w+", PAGE.read_text()))
    assert keys_of(Config) - keys_of(MapConfig) - keys_of(Choice) <= told
