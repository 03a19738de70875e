"""The matcher ``kiss``: no prior needed; KISS-Matcher and wall columns guess, small_gicp refines, agreement decides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, Map, Match, Points, Prior, Transform
from mapgraft_cloud import wall_columns
from mapgraft_cloud.gicp import Pair, Refined, around_prior, as_matches, distinct, refine
from mapgraft_cloud.surface import thinned

_FEWEST_PAIRS: Final = 6  # correspondences that hold together
_SOLUTIONS: Final = 3  # of one set of correspondences: what the first leaves is solved again
_COARSER: Final = 1.6  # the second size of cubes
MOST_POINTS: Final = 40_000  # that features are made of
_MOST_NOISE_M: Final = 0.99  # beyond 1 m the library takes 1 m and writes so on the terminal
_LARGER: Final = 1.25  # the next size of cubes for clouds of more
_UPRIGHT_GUESSES: Final = 6
_RIVALS_RAD: Final = (math.pi / 2, math.pi, -math.pi / 2)  # rooms look alike after a quarter turn
_LARGEST_M: Final = 10.0


class Kiss:
    """Finds how two clouds lie without knowing anything beforehand.

    First guesses come from KISS-Matcher at cubes of ``voxel_m``, or of the larger voxels of the two maps where these
    are larger still, and 1.6 times that; huge maps get larger cubes. More guesses come from the correspondences that
    its solution does not explain, from the best of them turned by quarter turns about the middle of the donor's map,
    and with ``aligned`` (both z axes point up) from walls seen from above in all turns and shifts. small_gicp refines
    each; the agreement of the surfaces, in square metres, decides (see ``Gicp``, which also tells the evidence). So
    there are at least two hypotheses wherever a second guess holds together. With a prior only its neighbourhood is
    searched.

    Source: H. Lim et al., KISS-Matcher (ICRA 2025); K. Koide, small_gicp (JOSS 2024).
    """

    def __init__(self, *, aligned: bool = True, voxel_m: float = 0.3, hypotheses: int = 5) -> None:
        if not isinstance(aligned, bool):
            raise ConfigError(f"aligned of kiss must be true or false, found {aligned!r}")
        if not 0.0 < voxel_m <= _LARGEST_M:
            raise ConfigError(f"voxel_m of kiss must lie above 0 and up to {_LARGEST_M:g} m, found {voxel_m}")
        if hypotheses < 1:
            raise ConfigError(f"hypotheses of kiss must be at least 1, found {hypotheses}")
        self.aligned, self.voxel_m, self.hypotheses = aligned, float(voxel_m), hypotheses

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """Raises EmptyMapError where a map has nothing to hold on to."""
        pair = Pair.of(target, source, self.aligned)
        if prior is not None:
            return around_prior(pair, prior)[: self.hypotheses]
        refined = _refined(pair, self._guesses(pair))
        if refined:
            refined = distinct(pair, [*refined, *_refined(pair, _turned(pair, refined[0].T))])
        return as_matches(refined)[: self.hypotheses]

    def _guesses(self, pair: Pair) -> list[Transform]:
        guesses = []
        finest_m = max(self.voxel_m, pair.target.voxel_m, pair.source.voxel_m)
        for voxel_m in (finest_m, finest_m * _COARSER):
            guesses += kiss_guesses(pair.target.points_m, pair.source.points_m, voxel_m, self.aligned)
        if self.aligned:
            guesses += wall_columns.guesses(pair.target.surface, pair.source.surface, _UPRIGHT_GUESSES)
        return guesses


def _refined(pair: Pair, guesses: Sequence[Transform]) -> list[Refined]:
    return distinct(pair, [one for guess in guesses if (one := refine(pair, guess)) is not None])


def _turned(pair: Pair, T: Transform) -> list[Transform]:
    """A transform with the source's map turned on the spot, about the vertical."""
    middle = pair.source.surface.points_m.mean(axis=0)
    there, back = Transform.identity().matrix.copy(), Transform.identity().matrix.copy()
    there[:3, 3], back[:3, 3] = middle, -middle
    return [T @ Transform(there) @ Transform.planar(0.0, 0.0, yaw) @ Transform(back) for yaw in _RIVALS_RAD]


def kiss_guesses(target_m: Points, source_m: Points, voxel_m: float, aligned: bool) -> list[Transform]:
    """What KISS-Matcher makes of two clouds (n, 3), and of the correspondences that are left over each time.

    The clouds are thinned to one point in a cube of ``voxel_m``, larger where more than ``MOST_POINTS`` of one of them
    would be left. They are thinned and the correspondences sorted here, because the library does both in the order in
    which its threads come by.
    """
    import kiss_matcher

    clouds = [thinned(points, voxel_m) for points in (source_m, target_m)]
    while max(map(len, clouds)) > MOST_POINTS:
        voxel_m *= _LARGER
        clouds = [thinned(points, voxel_m) for points in (source_m, target_m)]
    config = kiss_matcher.KISSMatcherConfig(
        voxel_m,
        use_voxel_sampling=False,
        use_quatro=aligned,
        robin_noise_bound_gain=min(1.0, _MOST_NOISE_M / voxel_m),
        solver_noise_bound_gain=min(0.75, _MOST_NOISE_M / voxel_m),
    )
    matcher = kiss_matcher.KISSMatcher(config)
    found_ends = matcher.match(*(cloud.astype(np.float32) for cloud in clouds))
    ends = [np.asarray(end, np.float32).reshape(-1, 3) for end in found_ends]
    pairs = np.hstack(ends)
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    found: list[Transform] = []
    while len(pairs) >= _FEWEST_PAIRS and len(found) < _SOLUTIONS:
        T = _solved(matcher, pairs)
        if T is None:
            break
        explained = np.linalg.norm(T.apply(pairs[:, :3]) - pairs[:, 3:], axis=1) < 2.0 * voxel_m
        if np.count_nonzero(explained) < _FEWEST_PAIRS:
            break
        found.append(T)
        pairs = pairs[~explained]
    return found


def _solved(matcher: Any, pairs: NDArray[np.float32]) -> Transform | None:
    matcher.reset_solver()
    solution = matcher.prune_and_solve(list(pairs[:, :3]), list(pairs[:, 3:]))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.asarray(solution.rotation), np.asarray(solution.translation).ravel()
    if not (solution.valid and np.isfinite(matrix).all()):
        return None
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    matrix[:3, :3] = u @ np.diag((1.0, 1.0, np.linalg.det(u @ vt))) @ vt
    return Transform(matrix)
