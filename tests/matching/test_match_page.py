"""The page on matching names everything that machines read."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from mapgraft.cli import invoke
from mapgraft.matching.pair_list import ListedPair

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "match.md").read_text(encoding="utf-8")
COUNTED = set(re.findall(r"`(?:\w+\.)*(\w+)`", (DOCS / "evaluate.md").read_text(encoding="utf-8")))
NAMED = set(re.findall(r"`([A-Za-z0-9_]+)`", PAGE))
FREE = ("evidence", "metrics", "details", "auc", "recall", "findings")  # whose keys are names of metrics, bins, rules


def keys_of(document: Any) -> Iterator[str]:
    """All keys, at any depth, but not those that are names of something."""
    if isinstance(document, list):
        for item in document:
            yield from keys_of(item)
    elif isinstance(document, Mapping):
        for key, value in document.items():
            yield key
            inner = value.values() if key in FREE and isinstance(value, Mapping) else [value]
            for item in inner:
                yield from keys_of(item)


def test_every_key_of_the_documents_is_named(capsys: pytest.CaptureFixture[str], save, floor, rules, tmp_path) -> None:
    save("a.png", floor(0.1))
    entry = {"a": "a.png", "b": "a.png", "T_px_b2a": [1, 0, 0, 0, 1, 0]}
    (tmp_path / "pairs.json").write_text(json.dumps([entry, {**entry, "suspect": True}]))
    options = ["--rules", str(rules), "--resolution", "0.1", "--json"]
    assert (
        invoke(["match", str(tmp_path / "a.png"), str(tmp_path / "a.png"), *options, "-o", str(tmp_path / "out")]) == 0
    )
    one = json.loads(capsys.readouterr().out)
    assert invoke(["match", "--pairs", str(tmp_path / "pairs.json"), *options]) == 0
    several = json.loads(capsys.readouterr().out)
    counted = [several.pop("summary"), several.pop("times")]
    assert "afterwards" not in counted[0]
    assert sorted(set(keys_of([one, several])) - NAMED) == []
    assert sorted(set(keys_of(counted)) - COUNTED) == []


def test_every_key_of_a_list_is_named() -> None:
    assert sorted(set(ListedPair.model_fields) - NAMED) == []
    assert {"groups", "pairs", "res_a", "res_b"} <= NAMED


def test_every_option_and_verdict_is_named() -> None:
    for word in ("--resolution", "--other-resolution", "--unknown-gray", "--rules", "--config", "--matcher", "--json"):
        assert word in PAGE
    for word in ("--hypotheses", "--pairs", "--unrelated", "--across", "--keypoint-px"):
        assert word in PAGE
    assert {"provisional", "ambiguous", "unmatched", "rejected"} <= NAMED
