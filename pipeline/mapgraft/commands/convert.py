"""``mapgraft convert``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapgraft.console import cell, results
from mapgraft.job import as_config


def convert_and_show(sources: Sequence[Path], out: Path, config: Path | None) -> None:
    """Convert, and say what was written and what was left out; the limits and the typestore are the configuration's."""
    from mapgraft.recording.containers.limits import ReadLimits
    from mapgraft.recording.writing import convert

    checked = as_config(config)
    limits = ReadLimits(checked.limits.chunk_bytes, checked.limits.expansion)
    results().print(cell(convert(list(sources), out, typestore=checked.mission.typestore, limits=limits)))
