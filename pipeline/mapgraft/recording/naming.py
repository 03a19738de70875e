"""What the names of frames, topics and files tell: which frame is a map, which topic is a goal, whose scan this is."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path, PurePath

MAP_WORDS = ("map",)
ODOM_WORDS = ("odom", "odometry")
WORLD_WORDS = ("world", "earth", "global", "mocap", "vicon", "optitrack", "ground_truth")
BASE_NAMES = ("base_footprint", "base_stabilized", "base_link", "base_frame", "base", "chassis", "body")

# Last parts of a namespace that say which sensor it is, not whose.
_SENSOR = re.compile(
    r"laser|lidars?|scans?|scanner|hokuyo|urg|utm|ust|sick|lms|tim|rplidar|ydlidar|velodyne|ouster|livox|front|rear|back"
    r"|left|right|top|bottom|upper|lower|center|sensors?|base|depth|camera|merged|filtered|main"
)
# Words in the topics of poses that nobody has reached yet.
_WISH = re.compile(r"goals?|initial|initialpose|target|waypoints?|clicked|setpoint|cmd|command")
_SUFFIXES = (".log.gz", ".clf.gz", ".gfs.gz", ".tum.gz", ".bag.active")


def bare(frame: str) -> str:
    """The frame's own name: ``robot_1/base_link`` → ``base_link``."""
    return frame.rpartition("/")[2]


def is_map(frame: str) -> bool:
    """Whether the frame is called a map: ``map``, ``robot_1/map``, ``robot_1_map``, ``map_frame``."""
    return _says(frame, MAP_WORDS)


def is_odom(frame: str) -> bool:
    """Whether the frame is called odometry: ``odom``, ``robot_1/odom``, ``odom_combined``."""
    return _says(frame, ODOM_WORDS)


def is_world(frame: str) -> bool:
    """Whether the frame is called the world: ``world``, ``earth``, ``mocap``."""
    return _says(frame, WORLD_WORDS)


def is_base(frame: str) -> bool:
    """Whether the frame is a usual name of a robot's body: ``base_link``, ``robot_1_base_footprint``."""
    name = bare(frame).lower()
    return any(name == base or name.endswith("_" + base) for base in BASE_NAMES)


def frame_prefix(frame: str) -> str:
    """Whose frame it is, by its name: ``robot_1/base_link`` and ``robot_1_base_link`` → ``robot_1``, else empty."""
    path, _, name = frame.rpartition("/")
    if path:
        return path.replace("/", "_")
    for word in (*BASE_NAMES, *MAP_WORDS, *ODOM_WORDS):
        if name.lower().endswith("_" + word):
            return name[: -len(word) - 1]
    return ""


def robot_namespace(topic: str) -> tuple[str, ...]:
    """The parts of a topic that name its robot: ``/fleet/robot_1/front_laser/scan`` → ``("fleet", "robot_1")``."""
    parts = topic.strip("/").split("/")[:-1]
    while parts and any(map(_SENSOR.fullmatch, _tokens(parts[-1]))):
        parts.pop()
    return tuple(parts)


def is_wish(topic: str) -> bool:
    """Whether a topic of poses holds goals, guesses and clicks, not where the robot was."""
    return any(_WISH.fullmatch(token) for part in topic.split("/") for token in _tokens(part))


def is_costmap(topic: str) -> bool:
    """Whether a topic of grids holds a planner's costs, not a map."""
    return "cost" in topic.lower()


def stem(path: PurePath) -> str:
    """A file's or folder's name without what says its format: ``intel-corrected.log.gz`` → ``intel-corrected``."""
    name = path.name
    for suffix in _SUFFIXES:
        if name.lower().endswith(suffix):
            return name[: -len(suffix)]
    return path.stem if path.suffix else name


def robot_name(text: str) -> str:
    """The text as a robot's name: what cannot be part of a topic, a frame and a file becomes ``_``."""
    name = re.sub(r"[^\w@.-]|[^\x00-\x7f]", "_", text)[:100]
    return name if name.strip("._") else "robot"


def real_path(path: PurePath) -> Path:
    """The file that a path leads to; links that lead to themselves stay as they are."""
    return Path(os.path.realpath(path))


def told_apart(paths: Sequence[PurePath]) -> list[str]:
    """A name for each of several files: its stem, with as many folders before it as it takes to tell them apart."""
    parts = [[*(part.strip("/") for part in path.parts[:-1]), stem(path)] for path in paths]
    depth = [1] * len(paths)
    while True:
        names = [robot_name("_".join(filter(None, part[-k:]))) for part, k in zip(parts, depth, strict=True)]
        again = [k for k, name in enumerate(names) if names.count(name) > 1 and depth[k] < len(parts[k])]
        if not again:
            return [name if names.index(name) == k else f"{name}_{k}" for k, name in enumerate(names)]
        for k in again:
            depth[k] += 1


def _says(frame: str, words: tuple[str, ...]) -> bool:
    name = bare(frame).lower()
    return any(name == word or name.startswith(word + "_") or name.endswith("_" + word) for word in words)


def _tokens(part: str) -> list[str]:
    return [re.sub(r"\d+$", "", token) for token in part.lower().split("_")]
