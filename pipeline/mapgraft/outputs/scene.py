"""What there is to see in ``world``: how far every robot's map reaches, where its frame lies, where its body is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft.outputs.poses import Path
from mapgraft.outputs.standing import StandingMerge
from mapgraft.outputs.world import Box, grown, lay_out, placed_box


class Scene:
    """Follows the robots and keeps their frames side by side, or together where merges stand."""

    def __init__(self) -> None:
        self._boxes_m: dict[str, Box | None] = {}
        self._T_world_map: dict[str, Transform] = {}
        self._bodies_m: dict[str, NDArray[np.float64]] = {}

    def moved(self, path: Path) -> None:
        """A robot's body went along a path."""
        self.grow(path.robot, path.box_m)
        self._bodies_m[path.robot] = path.numbers[-1, :3]

    def grow(self, robot: str, box_m: Box | None) -> None:
        """A robot's map reaches as far as this, in its own map frame; None says only that there is this robot."""
        self._boxes_m[robot] = grown(self._boxes_m.get(robot), box_m)

    def place(self, merges: Sequence[StandingMerge]) -> dict[str, Transform]:
        """``T_world_map`` of every robot, as of now."""
        self._T_world_map = lay_out(self._T_world_map, self._boxes_m, merges)
        return self._T_world_map

    @property
    def robots(self) -> list[str]:
        """In order of appearance."""
        return list(self._boxes_m)

    @property
    def bodies_m(self) -> Mapping[str, NDArray[np.float64]]:
        """Robot → (3,) last position of its body in its map frame."""
        return self._bodies_m

    def span_m(self) -> tuple[float, float, float] | None:
        """Centre x, centre y and the larger side of what there is to see; None when there is nothing."""
        box: Box | None = None
        for robot, T in self._T_world_map.items():
            box = grown(box, placed_box(T, self._boxes_m.get(robot)))
        if box is None:
            return None
        x0, y0, x1, y1 = box
        return (x0 + x1) / 2.0, (y0 + y1) / 2.0, max(x1 - x0, y1 - y0)
