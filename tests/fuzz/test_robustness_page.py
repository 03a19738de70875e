"""The page of promises names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path

import nasty_files

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "robustness.md").read_text()


def test_every_promise_names_a_test_that_exists():
    tables = re.findall(r"\| promise \|.*\n\|---.*\n((?:\|.*\n)+)", PAGE)
    rows = [row for table in tables for row in table.splitlines()]
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)
    assert len(rows) > 20
    assert all("`tests/" in row or "| the same (" in row for row in rows)
    for row in rows:  # further tests of the same file
        named += [(*re.findall(r"`(tests/[\w/]+\.py)::", row)[:1], other) for other in re.findall(r"`::(\w+)`", row)]
    for file, function in named:
        assert f"def {function}(" in (ROOT / file).read_text(), f"{file}::{function}"


def test_the_number_of_nasty_inputs_and_their_patterns_are_true():
    names = [case.name for case in nasty_files.all_cases()]
    assert f"{len(names)} small nasty inputs" in PAGE
    patterns = re.findall(r"\(((?:`[\w*-]+`,? ?)+)\)", PAGE)
    for pattern in re.findall(r"`([\w*-]+)`", " ".join(patterns)):
        shape = re.compile(pattern.replace("*", ".*"))
        assert any(map(shape.fullmatch, names)), pattern
