"""``mapgraft convert``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapgraft.console import cell, results


def convert_and_show(sources: Sequence[Path], out: Path) -> None:
    """Convert, and say what was written and what was left out."""
    from mapgraft.recording.writing import convert

    results().print(cell(convert(list(sources), out)))
