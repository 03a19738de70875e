"""Poses that jump farther than a robot moves: slips are told from a robot that goes on elsewhere."""

from __future__ import annotations

import math
from typing import Final

from mapgraft.recording.poses.rigid import Pose7, angle_of, compose, inverse

LASTING: Final = 3
"""So many poses in a row that go together are no slip: the robot was carried, or found itself."""

_SLACK_M, _SLACK_RAD = 1.0, 0.5  # what a correction by SLAM may move a robot at any time
_NEAR_COSINE = math.cos(0.5 * _SLACK_RAD)
_TURN_RAD_PER_S = 20.0  # three turns a second, more than any robot that maps


class JumpWatch:
    """Follows the poses of one robot's observations in the order of time."""

    __slots__ = ("_count", "_last", "_max_speed_m_s", "_other")

    def __init__(self, max_speed_m_s: float) -> None:
        self._max_speed_m_s = max_speed_m_s
        self._last: tuple[int, Pose7] | None = None
        self._other: tuple[int, Pose7] | None = None  # the last pose that jumped
        self._count = 0  # how many such go together

    def judge(self, stamp_ns: int, T_map_base: Pose7) -> tuple[str, bool]:
        """A clause on how the pose jumps, empty where it does not; and whether it is to be used all the same."""
        now = (stamp_ns, T_map_base)
        if self._last is not None and self._other is None and _is_near(self._last[1], T_map_base):
            self._last = now  # as nearly always
            return "", True
        if self._last is None or not (why := self._jump(self._last, now)):
            self._last, self._other, self._count = now, None, 0
            return "", True
        together = self._other is not None and not self._jump(self._other, now)
        self._other, self._count = now, self._count + 1 if together else 1
        if self._count < LASTING:
            return why, False
        self._last, self._other, self._count = now, None, 0
        return f"{why}; those after it stay there, so the robot goes on from there", True

    def _jump(self, one: tuple[int, Pose7], other: tuple[int, Pose7]) -> str:
        moved = compose(inverse(one[1]), other[1])
        passed_s = abs(other[0] - one[0]) / 1e9
        far_m, turned_rad = math.hypot(moved[0], moved[1], moved[2]), angle_of(moved)
        if far_m > _SLACK_M + self._max_speed_m_s * passed_s:
            return f"its pose lies {far_m:.4g} m from the one {passed_s:.3g} s before (poses.max_speed_m_s)"
        if turned_rad > _SLACK_RAD + _TURN_RAD_PER_S * passed_s:
            return f"its pose is turned by {turned_rad:.3g} rad against the one {passed_s:.3g} s before"
        return ""


def _is_near(one: Pose7, other: Pose7) -> bool:
    """Whether two poses lie within the slack, whatever time has passed: the cosine is that of half the turn."""
    x, y, z = other[0] - one[0], other[1] - one[1], other[2] - one[2]
    cosine = one[3] * other[3] + one[4] * other[4] + one[5] * other[5] + one[6] * other[6]
    return x * x + y * y + z * z <= _SLACK_M * _SLACK_M and abs(cosine) >= _NEAR_COSINE
