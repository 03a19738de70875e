"""Texts that people write: configurations and decision tables."""

from __future__ import annotations

import dataclasses
import json
from contextlib import suppress
from random import Random

from fuzz_mutations import Damage
from fuzz_recordings import Run, scratch


def _without_plug_ins() -> None:
    """The YAML library looks for plug-ins of its own in its folder at every text anew: a third of the time."""
    from ruamel.yaml import YAML

    YAML.official_plug_ins = lambda _: []


def config() -> Run:
    """The first byte chooses: YAML, TOML, a mapping that JSON tells, or what is no file."""
    from mapgraft.config import load_config, parse_config
    from mapgraft.errors import MapgraftError

    _without_plug_ins()
    yaml, toml = scratch("a.yaml"), scratch("a.toml")
    (yaml.parent / "there.mcap").touch()

    def read(kind: bytes, text: bytes):
        if kind == b"j":
            return parse_config(_mapping(text))
        if kind == b"f":
            return load_config(yaml.parent / text.decode("latin1").replace("\0", "")[:100])
        path = toml if kind == b"t" else yaml
        path.write_bytes(text)
        return load_config(path)

    def run(data: bytes) -> None:
        try:
            found = read(data[:1], data[1:])
        except MapgraftError as error:
            str(error).encode(errors="backslashreplace")
        else:
            found.model_dump_json()

    return run


def _mapping(text: bytes) -> dict[str, object]:
    with suppress(ValueError, RecursionError):
        found = json.loads(text)
        if isinstance(found, dict):
            return found
    return {}


def decision() -> Run:
    """The first byte chooses where the rules come from; behind a zero byte stand the facts of a pair as JSON."""
    from mapgraft.contracts import MapMetadata
    from mapgraft.decision import build_table, facts_of
    from mapgraft.errors import MapgraftError
    from mapgraft.plugins import Plugins, load_plugins

    _without_plug_ins()
    plugins, path = load_plugins(), scratch("r.yaml")
    grid, other = MapMetadata("occupancy_grid", 0.05, known_area_m2=50.0), MapMetadata("beacons")

    def table_of(kind: bytes, text: bytes):
        if kind == b"j":
            return build_table(plugins, _rules(text))
        if kind == b"p":  # a plugin's own table
            told = dataclasses.replace(plugins.rules[0], text=text.decode(errors="replace"))
            return build_table(Plugins(plugins.offered, [told], []))
        path.write_bytes(text)
        return build_table(plugins, path)

    def run(data: bytes) -> None:
        kind, (text, _, told) = data[:1], data[1:].partition(b"\0")
        try:
            table = table_of(kind, text)
        except MapgraftError as error:
            str(error).encode(errors="backslashreplace")
            return
        facts = facts_of(grid, other, 1.0) | _facts(told)
        for these in (facts, facts_of(grid, grid), facts_of(other, other, None, "single_map")):
            ruling = table.choose(these)
            assert ruling.reason
            assert ruling.rejected or ruling.rule is not None
        for record in table.records:
            with suppress(MapgraftError):
                assert record.rule.procedure.metric_names is not None
        table.source.encode(errors="backslashreplace")

    return run


def _rules(text: bytes) -> list[dict[str, object]]:
    """The rules in a configuration that is read already: a list of mappings of what can be stored; else none."""
    with suppress(ValueError, RecursionError):
        found = json.loads(text)
        if isinstance(found, list) and all(isinstance(rule, dict) for rule in found):
            json.dumps(found, ensure_ascii=False).encode()
            return found
    return []


def _facts(told: bytes) -> dict[str, bool | int | float | str]:
    return {k: v for k, v in _mapping(told).items() if isinstance(v, bool | int | float | str)}


_ATOMS = (
    None,
    True,
    False,
    0,
    1,
    -1,
    0.5,
    1e308,
    -1e-9,
    10**30,
    "",
    "x",
    "a\nb",
    "\x1b[31m",
    "ledger",
    "auto",
    [],
    {},
    [0],
)
_KEYS = ("name", "use", "when", "min", "max", "own.type", "metrics", "every", "mission", "robots", "files", "x", "")


def damaged_document(data: bytes, chance: Random, damage: Damage) -> bytes:
    """A document with a few values or keys changed, where its text is JSON; else, and now and then, with any bytes."""
    text, zero, told = data[1:].partition(b"\0")
    try:
        document = json.loads(text) if chance.random() < 0.7 else None
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, list | dict):
        return damage(data)
    for _ in range(chance.randint(1, 3)):
        document = _changed(document, chance)
    kind = data[:1] if chance.random() < 0.9 else bytes([chance.choice(b"jypf")])
    return kind + json.dumps(document, ensure_ascii=chance.random() < 0.5).encode(errors="replace") + zero + told


def _changed(value: object, chance: Random, depth: int = 0) -> object:
    """A value with one place in it changed."""
    inner = isinstance(value, list | dict) and value and depth < 20
    if not inner or chance.random() < 0.15:
        return chance.choice((*_ATOMS, [value], {"use": value}))
    if isinstance(value, list):
        at, copy = chance.randrange(len(value)), list(value)
        kind = chance.randrange(8)
        if kind == 0:
            del copy[at]
        elif kind == 1 and len(copy) < 30:
            copy.insert(at, copy[chance.randrange(len(copy))])
        else:
            copy[at] = _changed(copy[at], chance, depth + 1)
        return copy
    key, told = chance.choice(sorted(value)), dict(value)
    kind = chance.randrange(8)
    if kind == 0:
        del told[key]
    elif kind == 1:
        told[chance.choice(_KEYS)] = told[key]
    else:
        told[key] = _changed(told[key], chance, depth + 1)
    return told
