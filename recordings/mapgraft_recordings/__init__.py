"""The demo recording, and the simulator that makes it and others like it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

DEMO_ROBOTS = ("alpha", "bravo", "charlie")


def demo_files() -> tuple[list[Path], Path, Path]:
    """Where the demo is installed: (the recording's files, its configuration, its expected outcome)."""
    folder = Path(str(files(__name__) / "demo"))
    return [folder / f"{robot}.mcap" for robot in DEMO_ROBOTS], folder / "config.yaml", folder / "expected.json"
