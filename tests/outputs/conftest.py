"""Fixtures of the tests of what is written: one mission, told once to a folder and shared read-only."""

from __future__ import annotations

from pathlib import Path

import pytest
from plots import provenance, tell, told, traffic

from mapgraft.events import Event
from mapgraft.outputs.run_folder import RunFolder

RUN_ID = "r0123456789abcde"


@pytest.fixture(scope="session")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished output folder; tests must not change it."""
    folder = tmp_path_factory.mktemp("runs") / "out"
    with RunFolder(folder, "demo", RUN_ID, provenance()) as sink:
        tell(sink, told())
        sink.timed("replay", 1.5, 1800)
        sink.carried(traffic())
    return folder


@pytest.fixture(scope="session")
def merge_file(out: Path) -> Path:
    return out / "demo.merge.mcap"


@pytest.fixture(scope="session")
def events() -> list[Event]:
    """The events of the mission, in order."""
    return [item for item in told() if isinstance(item, Event)]
