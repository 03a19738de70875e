"""What a person sees in a terminal."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.text import Text


def plain(text: str) -> str:
    """The text without control characters: names from a recording may hold escape sequences."""
    return "".join(c if c == "\n" or c.isprintable() else f"\\x{ord(c):02x}" for c in text)


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
    """One JSON document on stdout."""
    sys.stdout.write(json.dumps(content, indent=2, ensure_ascii=False, default=str) + "\n")
