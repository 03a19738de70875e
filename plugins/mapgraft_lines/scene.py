"""A map of line segments as matching and measuring take it: arrays about a centre, made once."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, MapError, Points
from mapgraft_lines.kernels import explaining
from mapgraft_lines.line_map import LineMap

MOST_WALLS: Final = 2000  # the longest; more tell no more of how two maps lie to each other
PROPOSING: Final = 300  # of them that are compared for every proposal
TURN_COSINE: Final = math.cos(math.radians(8.0))  # two walls that may be one run as alike

Poses = NDArray[np.float64]  # (k, 3) x, y (m), yaw (rad) of T_target_source between two centres


class Scene(NamedTuple):
    """Walls (n, 4) x0, y0, x1, y1 about ``centre_m`` with the side seen (``faced``), their variance across (m²), and
    the cells that are free with all around them (``deep``, whose [0, 0] has its corner at ``origin`` cells from the
    centre).
    """

    ends: NDArray[np.float64]
    faced: NDArray[np.bool_]
    variance: NDArray[np.float64]
    deep: NDArray[np.uint8]
    origin: NDArray[np.float64]
    cell_m: float
    centre_m: NDArray[np.float64]

    @property
    def lengths_m(self) -> NDArray[np.float64]:
        lengths: NDArray[np.float64] = np.hypot(self.ends[:, 2] - self.ends[:, 0], self.ends[:, 3] - self.ends[:, 1])
        return lengths

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        angles: NDArray[np.float64] = np.arctan2(self.ends[:, 3] - self.ends[:, 1], self.ends[:, 2] - self.ends[:, 0])
        return angles

    def longest(self, most: int) -> Scene:
        """The scene with so many walls, the longest."""
        return self._replace(ends=self.ends[:most], faced=self.faced[:most], variance=self.variance[:most])

    @property
    def extent_m(self) -> float:
        """The diagonal of the rectangle around the walls."""
        points = self.ends.reshape(-1, 2)
        return math.hypot(*(points.max(axis=0) - points.min(axis=0)).tolist())


def scene_of(map_: LineMap, name: str) -> Scene:
    """The scene of a map; EmptyMapError when it knows nothing, MapError when it has no wall."""
    if "scene" not in map_.kept:
        map_.kept["scene"] = _scene(map_, name)
    found: Scene = map_.kept["scene"]
    return found


def judged(target: Scene, source: Scene, across_m: float) -> list[tuple[Points, NDArray[np.int8]]]:
    """The pieces of the target's walls and of the source's, two maps of one frame: middles (k, 2) in that frame, and 1
    where the other map explains them, -1 where they stand in its free space, else 0.
    """
    out = []
    for here, there in ((target, source), (source, target)):
        shift = here.centre_m - there.centre_m
        points, verdicts = explaining.judged(
            here.ends + np.tile(shift, 2),
            here.faced,
            there.ends,
            there.faced,
            there.deep,
            there.origin,
            there.cell_m,
            across_m,
            TURN_COSINE,
        )
        out.append((points + there.centre_m, verdicts))
    return out


def _scene(map_: LineMap, name: str) -> Scene:
    if not map_.known():
        raise EmptyMapError(f"the {name}'s map of line segments is empty: integrate observations first")
    walls = map_.walls
    if not len(walls):
        raise MapError(
            f"the {name}'s map of line segments knows {map_.known()} cells but has no wall of "
            f"{map_.reading.length_min_m:g} m or more: there is nothing to tell where it lies"
        )
    chosen = slice(MOST_WALLS)  # they are sorted by length
    ends = walls.ends_m[chosen].reshape(-1, 4)
    points = ends.reshape(-1, 2)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    cells = map_.cells
    return Scene(
        np.ascontiguousarray(ends - np.tile(centre, 2)),
        np.ascontiguousarray(walls.faced[chosen]),
        np.ascontiguousarray(walls.sigma_m[chosen] ** 2),
        explaining.deep_free(cells.classes),
        np.array(cells.origin) - centre / cells.cell_m,
        cells.cell_m,
        centre,
    )


def both_ways(target: Scene, source: Scene, poses: Poses, across_m: float) -> NDArray[np.float64]:
    """What each placement explains of the target's walls and of the source's: (k, 2, 5), see ``kernels.explaining``."""
    found: NDArray[np.float64] = explaining.both_ways(
        *(target.ends, target.faced, target.deep, target.origin, target.cell_m),
        *(source.ends, source.faced, source.deep, source.origin, source.cell_m),
        np.ascontiguousarray(poses, np.float64).reshape(-1, 3),
        across_m,
        TURN_COSINE,
    )
    return found
