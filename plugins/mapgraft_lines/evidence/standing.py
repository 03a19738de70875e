"""How the walls of two maps of one frame stand to each other: made once for all metrics that look at them."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Comparison, Points
from mapgraft_lines.kernels.explaining import AGAINST, FULL, SQUARES, STEP_M
from mapgraft_lines.line_map import LineMap, as_map
from mapgraft_lines.scene import both_ways, judged, scene_of

ACROSS_M: Final = 0.25  # walls that may be one lie no further apart
PATCH_M: Final = 2.0  # so far apart, places err by themselves


class Standing(NamedTuple):
    """Lengths in metres, of the receiver's walls and the donor's: explained by the other map, and in its free space.

    ``joint_m`` is the length of both maps' walls that lie where the other knows something, ``squares`` Σ distance² ·
    length of what is explained; ``good`` and ``bad`` are the patches of 2 m in which clearly more is explained than
    against, and in which more is against.
    """

    explained_m: tuple[float, float]
    against_m: tuple[float, float]
    joint_m: float
    squares: float
    good: int
    bad: int

    @property
    def explained(self) -> float:
        return sum(self.explained_m)

    @property
    def against(self) -> float:
        return sum(self.against_m)

    @property
    def support(self) -> int:
        """How many pieces of wall, of 0.1 m, are explained or against."""
        return round((self.explained + self.against) / STEP_M)


def standing_of(comparison: Comparison) -> Standing:
    """The standing of the two maps of a comparison; MapError when one is of another type."""
    target, donor = as_map(comparison.target), as_map(comparison.donor)
    kept = target.kept.get("standing")
    if kept is None or kept[0] is not donor:
        kept = target.kept["standing"] = (donor, _standing(target, donor))
    found: Standing = kept[1]
    return found


def _standing(target: LineMap, donor: LineMap) -> Standing:
    if not len(target.walls) or not len(donor.walls):
        return Standing((0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0, 0)
    ours, theirs = scene_of(target, "receiver"), scene_of(donor, "donor")
    pose = np.array([[*(theirs.centre_m - ours.centre_m), 0.0]])
    told = both_ways(ours, theirs, pose, ACROSS_M)[0]
    (our_points, our_verdicts), (their_points, their_verdicts) = judged(ours, theirs, ACROSS_M)
    joint = int(donor.knows(our_points).sum()) + int(target.knows(their_points).sum())
    good, bad = patches(np.concatenate((our_points, their_points)), np.concatenate((our_verdicts, their_verdicts)))
    return Standing(
        (float(told[0, FULL]), float(told[1, FULL])),
        (float(told[0, AGAINST]), float(told[1, AGAINST])),
        joint * STEP_M,
        float(told[:, SQUARES].sum()),
        good,
        bad,
    )


def patches(points: Points, verdicts: NDArray[np.int8]) -> tuple[int, int]:
    """The patches with more than twice as many pieces explained as against, and those with more against."""
    agreed, against = votes(points, verdicts, PATCH_M)[1:]
    return int(np.count_nonzero(agreed > 2 * against)), int(np.count_nonzero(against > agreed))


def votes(
    points: Points, verdicts: NDArray[np.int8], side_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The squares (k, 2) in which pieces (n, 2) lie that speak, and how many in each are explained and against."""
    speaks = verdicts != 0
    index = np.floor(points[speaks] / side_m).astype(np.int64).reshape(-1, 2)
    squares, which = np.unique(index, axis=0, return_inverse=True)
    explained = np.bincount(which.ravel(), verdicts[speaks] > 0, len(squares)).astype(np.int64)
    every = np.bincount(which.ravel(), minlength=len(squares))
    return squares, explained, every - explained
