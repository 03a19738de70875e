"""The demo recordings, and the simulator that makes them and others like them."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Final

DEMOS: Final = ("grids", "heterogeneous")  # by name; the first is the one that runs when none is named
_FILES: Final = {
    "grids": ("demo/alpha.mcap", "demo/bravo.mcap", "demo/charlie.mcap"),
    "heterogeneous": ("demo/alpha.mcap", "heterogeneous/bravo.mcap", "demo/charlie.mcap", "heterogeneous/plan.svg"),
}
_FOLDERS: Final = {"grids": "demo", "heterogeneous": "heterogeneous"}


def demo_files(name: str = DEMOS[0]) -> tuple[list[Path], Path, Path]:
    """Where a demo is installed: (the recording's files, its configuration, its expected outcome).

    The heterogeneous demo shares two of its robots' files with the demo of grids. Raises KeyError for a name that is
    not in ``DEMOS``.
    """
    root = Path(str(files(__name__)))
    folder = root / _FOLDERS[name]
    return [root / file for file in _FILES[name]], folder / "config.yaml", folder / "expected.json"
