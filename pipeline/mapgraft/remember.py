"""What a run folder remembers of the run, so that it can be made again with a person's verdict."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mapgraft.config import Config, parse_config
from mapgraft.errors import UsageError
from mapgraft.outputs.lock import settled
from mapgraft.outputs.staging import SUFFIX

MISSION_FILE = "mission.json"
HAND_FIELDS = ("priors", "forbid", "verdicts", "examples")  # what persons say of a run does not make it another one


@dataclass(frozen=True, slots=True)
class Remembered:
    """The recordings and the configuration of a run."""

    files: Sequence[Path]
    config: Config


def remembered_text(files: Sequence[Path], config: Config) -> str:
    """The content of ``mission.json``: absolute paths, because the run may be made again from elsewhere.

    The robots keep their order, and links are not followed: robots are called after the files as they were given.
    """
    content = {"files": [str(path.absolute()) for path in files], "config": _anchored(files, config)}
    return json.dumps(content, indent=2) + "\n"


def recall(folder: Path) -> Remembered:
    """Read it back; raises UsageError when the folder is not one of a run, or a file that the run read is gone.

    Raises OutputError when the folder is being written just now.
    """
    settled(folder)
    path = folder / MISSION_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        files, config = [Path(file) for file in content["files"]], parse_config(content["config"], str(path))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        if (partial := path.with_name(MISSION_FILE + SUFFIX)).is_file() and not path.exists():
            said = f"the run in {folder} is not finished ({partial.name} is there)"
            raise UsageError(f"{said}: wait for it, or run it again if it was ended") from None
        raise UsageError(f"{folder} is not the folder of a finished run: it has no readable {MISSION_FILE}") from None
    named = [Path(file) for robot in config.robots.values() for file in robot.files]  # absolute, no patterns any more
    poses = [robot.poses.file for robot in config.robots.values() if robot.poses.file is not None]
    if gone := [str(file) for file in dict.fromkeys((*files, *named, *poses)) if not file.exists()]:
        raise UsageError(f"the recording of {folder} is gone: {', '.join(gone)}; put it back or run again")
    return Remembered(files, config)


def inputs_of(files: Sequence[Path], config: Config) -> list[Path]:
    """Everything that a run reads, each once: the files, those that only ``robots.*.files`` names, the pose files.

    Raises ConfigError when the configuration names a file that is not there.
    """
    from mapgraft.recording.robots.roster import further_files

    poses = [robot.poses.file for robot in config.robots.values() if robot.poses.file is not None]
    return list(dict.fromkeys((*files, *further_files(files, config), *poses)))


def essence_text(files: Sequence[Path], config: Config, identities: Mapping[Path, str]) -> str:
    """The configuration as far as it makes a run another one: with contents instead of paths, without a person's hand.

    ``identities`` tells what the files of ``inputs_of`` hold. The decision table is left out: a run's id has its text.
    """
    content = config.model_dump(mode="json", exclude={*HAND_FIELDS, "rules"})
    del content["output"]["report"], content["output"]["examples"]  # what is written about the run
    for name, robot in config.robots.items():
        named, poses = _named(files, config, name), robot.poses.file
        content["robots"][name]["files"] = [identities[path] for path in named]
        content["robots"][name]["poses"]["file"] = None if poses is None else identities[poses]
    return json.dumps(content, sort_keys=True)


def _anchored(files: Sequence[Path], config: Config) -> dict[str, Any]:
    """The configuration with absolute paths; patterns give way to the files that they meant."""
    content = config.model_dump(mode="json")
    for name, robot in config.robots.items():
        content["robots"][name]["files"] = [str(path.absolute()) for path in _named(files, config, name)]
        if robot.poses.file is not None:
            content["robots"][name]["poses"]["file"] = str(robot.poses.file.absolute())
    if isinstance(config.rules, Path):
        content["rules"] = str(config.rules.absolute())
    if isinstance(config.examples.truth, Path):
        content["examples"]["truth"] = str(config.examples.truth.absolute())
    return content


def _named(files: Sequence[Path], config: Config, robot: str) -> list[Path]:
    """The files that an entry ``robots.<robot>.files`` means, in the order of the inputs."""
    from mapgraft.recording.robots.roster import further_files, matches

    every = dict.fromkeys((*files, *further_files(files, config)))
    return [path for path in every if any(matches(path, pattern) for pattern in config.robots[robot].files)]
