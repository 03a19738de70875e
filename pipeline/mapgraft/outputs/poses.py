"""Body poses of all robots, gathered one by one and handed on in batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.outputs.tf import pose_numbers
from mapgraft.outputs.world import Box

Pose = tuple[int, str, int, NDArray[np.float64]]  # order, robot, stamp in nanoseconds, T_map_base (4, 4)

_MARGIN_M = 5.0  # how far around its path a robot is taken to map, as long as nothing else is known


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A piece of one robot's path: stamps (n,) int64, ``numbers`` (n, 7) x, y, z in metres and quaternion x, y, z, w,
    both in the robot's map frame; ``order`` (n,) tells when, among all that is written with it, each one came in."""

    robot: str
    order: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    numbers: NDArray[np.float64]

    @property
    def box_m(self) -> Box:
        """Bounds of the path in the map frame, with a margin."""
        low, high = self.numbers[:, :2].min(axis=0) - _MARGIN_M, self.numbers[:, :2].max(axis=0) + _MARGIN_M
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def paths_of(poses: Sequence[Pose]) -> list[Path]:
    """The poses robot by robot, robots in order of appearance; no poses, no paths."""
    if not poses:
        return []
    numbers = pose_numbers(np.stack([matrix for _, _, _, matrix in poses]))
    order = np.array([number for number, _, _, _ in poses], dtype=np.int64)
    stamps = np.array([stamp_ns for _, _, stamp_ns, _ in poses], dtype=np.int64)
    rows: dict[str, list[int]] = {}
    for row, (_, robot, _, _) in enumerate(poses):
        rows.setdefault(robot, []).append(row)
    return [Path(robot, order[at], stamps[at], numbers[at]) for robot, at in rows.items()]
