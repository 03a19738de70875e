"""The lines of a CARMEN log and what they say.

Source: the CARMEN robot navigation toolkit, log format; fields of each kind of line in its order:

``FLASER n [ranges] laser.x y theta robot.x y theta stamp host logger_stamp``; RLASER the same, for the rear laser.
``ROBOTLASER1 type start fov step max accuracy mode n [ranges] m [remissions] laser.x y theta robot.x y theta …``
``ODOM x y theta tv rv acceleration stamp host logger_stamp``; TRUEPOS has the true and the odometry pose instead.
``LASER_READING n [ranges] x y theta stamp`` is GMapping's, with the pose of odometry.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.recording.containers.text_lines import seconds_to_ns
from mapgraft.recording.decoding.poses import CARMEN_ODOM

SCAN_KEYWORDS = ("FLASER", "RLASER", "LASER_READING", "ROBOTLASER1", "ROBOTLASER2")
POSE_KEYWORDS = ("ODOM", "TRUEPOS")
KEYWORDS = frozenset(keyword.encode() for keyword in (*SCAN_KEYWORDS, *POSE_KEYWORDS))
LASER_FRAMES = {
    "FLASER": "front_laser",
    "RLASER": "rear_laser",
    "LASER_READING": "front_laser",
    "ROBOTLASER1": "laser_1",
    "ROBOTLASER2": "laser_2",
}
TRUE_FRAME = "world"

_MOST_BEAMS = 100_000
_LONGEST_M = 1e6
_NARROW_FIELD = {401: math.radians(0.25), 400: math.radians(0.25)}  # SICK LMS: 100 degrees in quarters

Pose = tuple[float, float, float]  # x m, y m, yaw rad


@dataclass(frozen=True, slots=True, eq=False)
class CarmenScan:
    """One line with a scan. ``laser_pose`` is where the laser was as the log has it (corrected, in corrected logs),
    ``robot_pose`` where odometry had the robot. Ranges from ``no_return_m`` on (inf: unknown) saw nothing.
    """

    stamp_ns: int
    laser: str
    start_rad: float
    step_rad: float
    no_return_m: float
    ranges_m: NDArray[np.float32]
    laser_pose: Pose
    robot_pose: Pose


@dataclass(frozen=True, slots=True)
class CarmenOdometry:
    """One line with a pose of the robot in ``frame``."""

    stamp_ns: int
    frame: str
    pose: Pose


class Stamps(NamedTuple):
    """The times on a line in nanoseconds: the sender's, and the logger's own (0 where there is none)."""

    sent_ns: int
    logged_ns: int


class ScanLine(NamedTuple):
    """The parts of a line with a scan; ``stated_max_m`` is inf where the line does not say."""

    ranges_m: NDArray[np.float32]
    start_rad: float
    step_rad: float
    stated_max_m: float
    laser_pose: Pose
    robot_pose: Pose


def keyword_of(text: bytes) -> str | None:
    """The keyword of a line that is read; None for comments, parameters and everything else."""
    word = text.split(None, 1)[0]
    return word.decode() if word in KEYWORDS else None


def stamps(keyword: str, words: list[bytes]) -> Stamps:
    """The times on a line split into words; raises ValueError when there are none."""
    at = _stamp_at(keyword, words)
    if at >= len(words):
        raise ValueError("the line ends before its time")
    logged = words[at + 2] if at + 2 < len(words) else b"0"
    return Stamps(seconds_to_ns(words[at]), seconds_to_ns(logged))


def _stamp_at(keyword: str, words: list[bytes]) -> int:
    if keyword in ("FLASER", "RLASER"):
        return 2 + _count(words, 1) + 6
    if keyword == "LASER_READING":
        return 2 + _count(words, 1) + 3
    if keyword in POSE_KEYWORDS:
        return 7 if len(words) > 5 else 4  # GMapping's own ODOM lines have no velocities
    beams = _count(words, 8)
    return 9 + beams + 1 + _count(words, 9 + beams) + 11


def _count(words: list[bytes], at: int) -> int:
    if at >= len(words):
        raise ValueError("the line ends before its count of readings")
    n = int(words[at])
    if not 0 <= n <= _MOST_BEAMS:
        raise ValueError(f"{n} readings are not believable")
    return n


def scan_line(keyword: str, words: list[bytes]) -> ScanLine:
    """The scan on a line split into words; raises ValueError when the line is broken."""
    if keyword.startswith("ROBOTLASER"):
        return _robot_laser(words)
    n = _count(words, 1)
    ranges = _ranges(words, 2, n)
    laser_pose = _pose(words, 2 + n)
    robot_pose = _pose(words, 5 + n) if keyword != "LASER_READING" else laser_pose
    start, step = beam_angles(n)
    return ScanLine(ranges, start, step, math.inf, laser_pose, robot_pose)


def _robot_laser(words: list[bytes]) -> ScanLine:
    n = _count(words, 8)
    start, step, longest = float(words[2]), float(words[4]), float(words[5])
    field = float(words[3])
    if step <= 0 and n > 1:
        step = field / (n - 1)
    poses = 9 + n + 1 + _count(words, 9 + n)
    stated = longest if 0 < longest < _LONGEST_M else math.inf
    return ScanLine(_ranges(words, 9, n), start, step, stated, _pose(words, poses), _pose(words, poses + 3))


def beam_angles(beams: int) -> tuple[float, float]:
    """(start, step) in radians of a laser known by its number of readings alone.

    Half a circle from -90 degrees: an odd number includes both ends, an even one leaves the last end out. 400 and 401
    readings are 100 degrees in quarters.
    """
    if beams in _NARROW_FIELD:
        return -math.radians(50.0), _NARROW_FIELD[beams]
    steps = beams - 1 if beams % 2 else beams
    return -math.pi / 2, math.pi / max(steps, 1)


def pose_line(keyword: str, words: list[bytes]) -> tuple[str, Pose]:
    """The frame and pose on an ODOM or TRUEPOS line split into words; raises ValueError when the line is broken."""
    return (TRUE_FRAME if keyword == "TRUEPOS" else CARMEN_ODOM), _pose(words, 1)


def _ranges(words: list[bytes], at: int, n: int) -> NDArray[np.float32]:
    if at + n > len(words):
        raise ValueError("the line ends before its last reading")
    with np.errstate(over="ignore"):
        ranges = np.array([float(word) for word in words[at : at + n]]).astype(np.float32)
    ranges.setflags(write=False)
    return ranges


def _pose(words: list[bytes], at: int) -> Pose:
    if at + 3 > len(words):
        raise ValueError("the line ends before its pose")
    return float(words[at]), float(words[at + 1]), float(words[at + 2])
