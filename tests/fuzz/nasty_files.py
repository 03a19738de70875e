"""Small nasty inputs, each with what mapgraft is asked to do with it; the same bytes every time.

``python tests/fuzz/nasty_files.py FOLDER`` writes them all, for whoever wants to try another program on them.
``python tests/fuzz/nasty_files.py --expected`` asks mapgraft and rewrites ``nasty_expected.json``: read the difference.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import nasty_bags
import nasty_documents
import nasty_mcap
import nasty_texts
import nasty_times
from nasty_case import Nasty

EXPECTED = Path(__file__).with_name("nasty_expected.json")


def all_cases() -> list[Nasty]:
    """Every case, by name; names are unique."""
    cases = [
        *nasty_documents.configs(),
        *nasty_documents.tables(),
        *nasty_mcap.recordings(),
        *nasty_mcap.liars(),
        *nasty_times.times(),
        *nasty_times.poses(),
        *nasty_mcap.definitions(),
        *nasty_texts.logs(),
        *nasty_texts.maps(),
        *nasty_texts.drawings(),
        *nasty_bags.bags(),
        *nasty_bags.strange(),
    ]
    names = [case.name for case in cases]
    assert len(set(names)) == len(names), sorted(name for name in names if names.count(name) > 1)
    return cases


def write(case: Nasty, folder: Path) -> list[str]:
    """Put the files of a case into a folder; returns the command line."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in case.folders:
        (folder / name).mkdir(parents=True, exist_ok=True)
    for name, data in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return [word.replace("@", str(folder)) for word in case.command]


def outcome(case: Nasty, folder: Path) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the case's command, the folder written as ``@``."""
    from mapgraft.cli import invoke

    command = write(case, folder)
    out, err, before = io.StringIO(), io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "20000"  # a terminal so wide that nothing is wrapped
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = invoke(command)
    finally:
        os.environ.pop("COLUMNS")
        os.environ.update({} if before is None else {"COLUMNS": before})
    return code, *(stream.getvalue().replace(str(folder), "@") for stream in (out, err))


def told(text: str) -> str:
    """A text without the line breaks that a terminal's width makes."""
    return " ".join(text.split())


def _expected() -> None:
    found: dict[str, dict[str, object]] = {}
    for case in all_cases():
        with tempfile.TemporaryDirectory() as name:
            code, out, err = outcome(case, Path(name))
        found[case.name] = {"code": code, "says": (told(err) if code else _picked(case, out))[:300]}
    EXPECTED.write_text(json.dumps(found, indent=1, ensure_ascii=True) + "\n")


def _picked(case: Nasty, out: str) -> str:
    """What tells most of a command that did its work: a sentence on what was lost, else the last one with the hint.

    The line of all rules tells of plugins, not of the input.
    """
    marks = ("left out", "limits.", "did not enter", "cut off", "damaged", "is lost", "cannot be", "without")
    told_all = [line for line in out.splitlines() if not line.lstrip().startswith("rules: ")]
    lines = [line for line in told_all if any(mark in line for mark in marks)]
    return told((lines or [line for line in told_all if case.hint in line] or [out])[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", help="where to write them")
    parser.add_argument("--expected", action="store_true", help="rewrite what is expected of them")
    asked = parser.parse_args()
    if asked.expected:
        _expected()
    elif asked.folder is None:
        parser.error("name a folder to write to, or --expected")
    else:
        for case in all_cases():
            write(case, asked.folder / case.name)


if __name__ == "__main__":
    main()
