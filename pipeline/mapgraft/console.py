"""What a person sees in a terminal."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.text import Text


def plain(text: str) -> str:
    """The text without control characters: names from a recording may hold escape sequences.

    Lines stay lines, but none that a name begins can pass for one of ours: what follows the first is indented.
    """
    lines = "".join(c if c == "\n" or c.isprintable() else f"\\x{ord(c):02x}" for c in text).split("\n")
    return "\n".join([lines[0], *(line if line.startswith("  ") or not line else f"  {line}" for line in lines[1:])])


def cell(text: object) -> Text:
    """A table cell that shows what it holds and interprets nothing."""
    return Text(plain(str(text)))


def results() -> Console:
    """The console for results (stdout)."""
    return Console(file=sys.stdout, highlight=False)


def remarks() -> Console:
    """The console for everything else (stderr)."""
    return Console(file=sys.stderr, highlight=False)


def print_json(content: Any) -> None:
    """One JSON document on stdout; what a terminal would take for a command is escaped, which changes no value."""
    text = json.dumps(content, indent=2, ensure_ascii=False, default=str)
    sys.stdout.write("".join(c if c == "\n" or c.isprintable() else _escaped(c) for c in text) + "\n")


def _escaped(character: str) -> str:
    """A character as JSON spells it by its number; beyond 16 bits as a pair."""
    return json.dumps(character)[1:-1]
