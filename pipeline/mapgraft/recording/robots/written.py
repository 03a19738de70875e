"""What a run has written is no recording of robots: each map in it would be taken for one more robot."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mapgraft.contracts import RecordingError
from mapgraft.contracts.sources import Source
from mapgraft.recording.reach import is_file
from mapgraft_schemas import MESSAGE_PACKAGE

_EVENT: Final = f"{MESSAGE_PACKAGE}/msg/MergeEvent"  # no robot sends it
_RUN: Final = ("summary.json", "mission.json")
_REPORT: Final = "report.html"
_BAG: Final = "metadata.yaml"


def refuse_run(path: Path) -> None:
    """Raise RecordingError where a path is the folder of a finished run."""
    if all(is_file(path / name) for name in _RUN) and not is_file(path / _BAG):
        raise RecordingError(_sentence(path, path))


def refuse_written(source: Source) -> None:
    """Raise RecordingError where a recording is one that a run has written, whatever it is called."""
    if any(channel.message_type == _EVENT for channel in source.channels):
        raise RecordingError(_sentence(source.path, source.path.parent))


def _sentence(path: Path, folder: Path) -> str:
    page = folder / _REPORT
    see = f"see {page}" if page.is_file() else "'mapgraft report' shows it"
    return f"{path} is what mapgraft run wrote: {see}, or give the recordings that it was made from"
