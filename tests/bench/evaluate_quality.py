"""Quality and quality-weighted fusion on recorded logs, which took no part in fitting either.

    python tests/bench/evaluate_quality.py LOG...      # CARMEN logs, MCAP files or bags with poses

Each recording is cut into thirds, mapped, and mapped again from scans made worse. Printed are rank correlations between
quality and true wall error (distance of occupied cells to the walls of the undegraded map), over windows and over maps,
and the wall error of the fused map when the donor's scans are made worse, weighted by quality over plain Bayes.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr
from simulated_missions import grid_of, map_of

from mapgraft.config import Config
from mapgraft.contracts import Donation, Match, Observation, Provenance, Transform
from mapgraft.recording.mission import open_mission
from mapgraft_grid.degradation import Degradation, degrade
from mapgraft_grid.grid_map import OCCUPIED
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.quality import window_quality
from mapgraft_grid.wall_error import mean_wall_error_m, wall_error_m

RESOLUTIONS_M = (0.05, 0.07, 0.1)
DEGRADATIONS = (
    *(Degradation(pose_sigma_m=s, pose_sigma_rad=math.radians(10.0 * s)) for s in (0.02, 0.05, 0.1, 0.2)),
    *(Degradation(range_sigma_m=s) for s in (0.025, 0.06, 0.12, 0.25)),
    *(Degradation(dropped=s) for s in (0.25, 0.5, 0.75, 0.95)),
)
HERE = Match(Transform.identity(), 1.0, math.inf)
Numbers = list[float]


def ranked(scans: Sequence[Observation], resolution_m: float) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Quality and error of all windows, and of all maps, over the degradations of one stretch."""
    truth = grid_of(scans, resolution_m)
    quality: Numbers = []
    error: Numbers = []
    of_maps: Numbers = []
    errors_of_maps: Numbers = []
    for seed, degradation in enumerate((Degradation(), *DEGRADATIONS)):
        grid = grid_of(degrade(scans, degradation, seed), resolution_m)
        found = window_quality(grid)
        judged = ~np.isnan(found.quality)
        cells = np.maximum(found.layout.sums(grid.classes == OCCUPIED), 1)
        quality += found.quality[judged].tolist()
        error += (found.layout.sums(wall_error_m(grid, truth)) / cells)[judged].tolist()
        if judged.any():
            of_maps.append(found.mean())
            errors_of_maps.append(mean_wall_error_m(grid, truth))
    return quality, error, of_maps, errors_of_maps


def fused_error_m(scans: Sequence[Observation], degradation: Degradation, resolution_m: float) -> tuple[float, float]:
    """Wall error of plain Bayes and of the weighted map; alternate blocks of ten scans, the donor's made worse."""
    own, donor = ([s for n, s in enumerate(scans) if n // 10 % 2 == side] for side in (0, 1))
    truth = grid_of(scans, resolution_m)
    grids, layer, view = map_of(own, resolution_m)
    given = Donation(map_of(degrade(donor, degradation, 7), resolution_m)[1], Provenance("donor", 1, len(donor)))
    plain, weighted = (
        mean_wall_error_m(grids.view(layer, [LogOdds(quality=q).fuse(grids, view, given, HERE)]).dense(), truth)
        for q in ("none", "windowed")
    )
    return plain, weighted


@dataclasses.dataclass(slots=True)
class _Numbers:
    """Quality and error, of windows and of maps."""

    windows: tuple[Numbers, Numbers] = dataclasses.field(default_factory=lambda: ([], []))
    maps: tuple[Numbers, Numbers] = dataclasses.field(default_factory=lambda: ([], []))

    def add(self, quality: Numbers, error: Numbers, of_maps: Numbers, errors_of_maps: Numbers) -> None:
        for kept, new in zip((*self.windows, *self.maps), (quality, error, of_maps, errors_of_maps), strict=True):
            kept.extend(new)

    def __str__(self) -> str:
        n = len(self.windows[0])
        return f"windows {correlation(*self.windows):.3f} (n = {n}), maps {correlation(*self.maps):.3f}"


def correlation(quality: Iterable[float], error: Iterable[float]) -> float:
    return float(spearmanr(list(quality), [-e for e in error]).statistic)


def main(paths: Sequence[Path]) -> None:
    every = _Numbers()
    fused: dict[Degradation, list[tuple[float, float]]] = {d: [] for d in DEGRADATIONS}
    for path in paths:
        with open_mission([path], Config()) as mission:
            scans = list(mission.observations())
        third = len(scans) // 3
        here = _Numbers()
        for n, resolution_m in enumerate(RESOLUTIONS_M):
            made = ranked(scans[n * third : (n + 1) * third], resolution_m)
            here.add(*made)
            every.add(*made)
        print(f"{path.name:32} {len(scans)} scans: {here}")
        for degradation, results in fused.items():
            results.append(fused_error_m(scans[: len(scans) // 2], degradation, RESOLUTIONS_M[len(results) % 3]))
    print(f"all: {every}")
    print("wall error of the fused map, weighted / plain (plain in metres), per recording:")
    for degradation, results in fused.items():
        text = "  ".join(f"{weighted / plain:.3f} ({plain:.4f})" for plain, weighted in results)
        print(
            f"  pose {degradation.pose_sigma_m:g} m, range {degradation.range_sigma_m:g} m, "
            f"dropped {degradation.dropped:.0%}:  {text}"
        )


if __name__ == "__main__":
    main([Path(argument) for argument in sys.argv[1:]])
