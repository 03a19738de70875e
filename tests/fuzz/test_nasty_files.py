"""Every nasty input through the command line: its exit code, its sentence, no traceback, no command to a terminal."""

from __future__ import annotations

import json
from pathlib import Path

import nasty_files
import nasty_recording
import pytest
from nasty_case import Nasty

CASES = nasty_files.all_cases()
EXPECTED = json.loads(nasty_files.EXPECTED.read_text())


def test_there_are_many_distinct_inputs_each_with_its_outcome():
    assert len(CASES) >= 150
    assert len({tuple(sorted(case.files.items())) + case.command + case.folders for case in CASES}) == len(CASES)
    assert {case.name for case in CASES} == set(EXPECTED)
    assert all(expected["says"] for expected in EXPECTED.values())
    assert not [name for name, expected in EXPECTED.items() if "internal error" in expected["says"]]


def test_the_inputs_are_the_same_every_time():
    nasty_recording.sound_recording.cache_clear()
    again = nasty_files.all_cases()
    assert [case.files for case in again] == [case.files for case in CASES]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_nasty_input_gets_its_sentence(case: Nasty, tmp_path: Path):
    code, out, err = nasty_files.outcome(case, tmp_path / "here")
    expected = EXPECTED[case.name]
    said = nasty_files.told(err if code else out)
    assert code == expected["code"], said
    assert expected["says"] in said
    assert "Traceback" not in out + err
    assert "internal error" not in err
    assert all(c == "\n" or c.isprintable() for c in out + err)
    assert not code or all(line.startswith(("mapgraft: ", "  ")) for line in err.splitlines() if line)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"here"}, "nothing is written elsewhere"
