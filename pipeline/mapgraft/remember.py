"""What a run folder remembers of the run, so that it can be made again with a person's verdict."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mapgraft.config import Config, parse_config
from mapgraft.errors import UsageError

MISSION_FILE = "mission.json"


@dataclass(frozen=True, slots=True)
class Remembered:
    """The recordings and the configuration of a run."""

    files: Sequence[Path]
    config: Config


def remembered_text(files: Sequence[Path], config: Config) -> str:
    """The content of ``mission.json``: absolute paths, because the run may be made again from elsewhere."""
    content = {"files": [str(path.resolve()) for path in files], "config": config.model_dump(mode="json")}
    return json.dumps(content, indent=2, sort_keys=True) + "\n"


def recall(folder: Path) -> Remembered:
    """Read it back; raises UsageError when the folder is not one of a run, or a recording is gone."""
    path = folder / MISSION_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        files, config = [Path(file) for file in content["files"]], parse_config(content["config"], str(path))
    except (OSError, ValueError, KeyError, TypeError):
        raise UsageError(f"{folder} is not the folder of a finished run: it has no readable {MISSION_FILE}") from None
    if gone := [str(file) for file in files if not file.exists()]:
        raise UsageError(f"the recording of {folder} is gone: {', '.join(gone)}; put it back or run again")
    return Remembered(files, config)
