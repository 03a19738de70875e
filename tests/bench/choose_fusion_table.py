"""What weighting by quality does to the walls of the fused map, for several tables, on simulated missions.

    python tests/bench/choose_fusion_table.py

Two robots map one floor. First, with scans as good as each other's: how far their quality differs in a tile, by
chance. Then the scans of one of them are made worse: the mean wall error of the fused map over that of plain Bayes
(below 1 is better), and in how many missions it is not above. No recorded data takes part.
"""

from __future__ import annotations

import math

import numpy as np
from simulated_missions import map_of, missions

from mapgraft.contracts import Donation, Match, Observation, Provenance, Transform
from mapgraft_grid.degradation import Degradation, degrade
from mapgraft_grid.grid_map import DenseGrid
from mapgraft_grid.log_odds import LogOdds, tile_differences
from mapgraft_grid.quality import window_quality
from mapgraft_grid.wall_error import mean_wall_error_m

SEED, MISSIONS, CHANCE_MISSIONS = 20_260_102, 9, 30
RESOLUTIONS_M = (0.05, 0.07, 0.1)
TABLES = ((-0.5, 0.25, 0.5), (-0.2, 0.2, 0.4), (-0.15, 0.2, 0.4), (-0.1, 0.2, 0.4), (-0.05, 0.1, 0.2))
DEGRADATIONS = (
    *(Degradation(pose_sigma_m=s, pose_sigma_rad=math.radians(10.0 * s)) for s in (0.02, 0.05, 0.1, 0.2)),
    *(Degradation(range_sigma_m=s) for s in (0.06, 0.12, 0.25)),
    *(Degradation(dropped=s) for s in (0.5, 0.9)),
)
HERE = Match(Transform.identity(), 1.0, math.inf)


def fused(own: list[Observation], donor: list[Observation], fuser: LogOdds, resolution_m: float) -> DenseGrid:
    grids, layer, view = map_of(own, resolution_m)
    donation = Donation(map_of(donor, resolution_m)[1], Provenance("donor", 1, len(donor)))
    return grids.view(layer, [fuser.fuse(grids, view, donation, HERE)]).dense()


def print_chance() -> None:
    """The spread of a tile's difference about the mean of its map, times the root of the wall it rests on."""
    spreads = []
    for number in range(CHANCE_MISSIONS):
        resolution_m = RESOLUTIONS_M[number % 3]
        ours, theirs = (map_of(m, resolution_m)[2] for m in missions(np.random.default_rng([SEED, 1, number]), 2))
        keys = np.array([key for key in ours.tiles if key in theirs.tiles], np.int64)
        d, wall_m = tile_differences(window_quality(ours.dense()), window_quality(theirs.dense()), keys)
        d, wall_m = d[wall_m > 0], wall_m[wall_m > 0]
        if d.size > 1:
            spreads += ((d - np.average(d, weights=wall_m)) * np.sqrt(wall_m)).tolist()
    print(f"equally good maps: sd of the difference · √wall = {np.std(spreads):.3f} √m over {len(spreads)} tiles")


def main() -> None:
    print_chance()
    fusers = [LogOdds(quality="none"), *(LogOdds(table=table) for table in TABLES)]
    print("worse       how much   plain    ", "  ".join(str(table) for table in TABLES))
    for side in ("donor", "receiver"):
        for degradation in DEGRADATIONS:
            errors = []
            for number in range(MISSIONS):
                first, second = missions(np.random.default_rng([SEED, number]), 2)
                resolution_m = RESOLUTIONS_M[number % 3]
                truth = map_of([*first, *second], resolution_m)[2].dense()
                worse = list(degrade(second, degradation, seed=number))
                own, donor = (first, worse) if side == "donor" else (worse, first)
                errors.append([mean_wall_error_m(fused(own, donor, f, resolution_m), truth) for f in fusers])
            plain = np.array(errors)[:, :1]
            ratio = np.array(errors)[:, 1:].mean(axis=0) / plain.mean()
            wins = (np.array(errors)[:, 1:] <= plain + 1e-12).sum(axis=0)
            text = "  ".join(f"{r:.3f} ({w}/{MISSIONS})" for r, w in zip(ratio, wins, strict=True))
            print(f"{side:9} {_short(degradation):18} {plain.mean():.4f} m  {text}")


def _short(degradation: Degradation) -> str:
    d = degradation
    return (
        f"pose {d.pose_sigma_m:g} m"
        if d.pose_sigma_m
        else (f"range {d.range_sigma_m:g} m" if d.range_sigma_m else f"dropped {d.dropped:.0%}")
    )


if __name__ == "__main__":
    main()
