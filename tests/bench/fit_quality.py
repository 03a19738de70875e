"""Fit the quality model on simulated missions whose scans were made worse, and say how well it ranks windows.

    python tests/bench/fit_quality.py            # fit, print, compare with the model in the package
    python tests/bench/fit_quality.py --write    # and put it into the package

Worlds, missions and degradations come from the seed alone. No recorded data takes part.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import spearmanr
from simulated_missions import grid_of, missions

from mapgraft_grid.degradation import Degradation, degrade
from mapgraft_grid.grid_map import OCCUPIED, DenseGrid
from mapgraft_grid.quality import MODEL_FILE, WALL_MIN_M, QualityModel, WindowLayout, window_features
from mapgraft_grid.quality_features import FEATURES
from mapgraft_grid.wall_error import wall_error_m

SEED, WORLDS = 20_260_101, 30
RESOLUTIONS_M = (0.05, 0.07, 0.1)
ERROR_SCALE_M = 0.1  # a window whose wall cells lie that far off on average has the target quality 1/e
REFERENCE_M = 0.05  # resolution of the undegraded map that holds the true walls
MOST_WALL_M = 4.0  # of a window, when windows are weighted
RIDGE = 1e-4
SIGNS = {"certainty": 1}  # quality may only rise with this one, and only fall with all others

POSE, RANGE, DROPPED = (0.02, 0.05, 0.1, 0.2), (0.025, 0.06, 0.12, 0.25), (0.25, 0.5, 0.75, 0.95)
DEGRADATIONS = (
    Degradation(),
    *(Degradation(pose_sigma_m=s, pose_sigma_rad=math.radians(10.0 * s)) for s in POSE),
    *(Degradation(range_sigma_m=s) for s in RANGE),
    *(Degradation(dropped=s) for s in DROPPED),
)


@dataclass(frozen=True, slots=True)
class Sample:
    """The windows of one map: features (n, f), true wall error (n,) in metres, wall (n,) in metres."""

    features: NDArray[np.float64]
    error_m: NDArray[np.float64]
    wall_m: NDArray[np.float64]


def sample_of(grid: DenseGrid, reference: DenseGrid) -> Sample:
    layout = WindowLayout.of(grid)
    features, wall_m = window_features(grid, layout)
    cells = np.maximum(layout.sums(grid.classes == OCCUPIED), 1.0)
    error_m = layout.sums(wall_error_m(grid, reference)) / cells
    judged = wall_m >= WALL_MIN_M
    roots = np.stack([np.sqrt(features[name][judged]) for name in FEATURES], axis=1)
    return Sample(roots, error_m[judged], wall_m[judged])


def gather(seed: int, worlds: int) -> list[Sample]:
    samples = []
    for number in range(worlds):
        (observations,) = missions(np.random.default_rng([seed, number]))
        reference = grid_of(observations, REFERENCE_M)
        resolution_m = RESOLUTIONS_M[number % len(RESOLUTIONS_M)]
        samples += [
            sample_of(grid_of(degrade(observations, d, seed=k), resolution_m), reference)
            for k, d in enumerate(DEGRADATIONS)
        ]
    return samples


def fit(samples: list[Sample]) -> QualityModel:
    """Logistic regression of exp(−error / 0.1 m) with ridge and given signs."""
    x = np.concatenate([s.features for s in samples])
    target = np.exp(-np.concatenate([s.error_m for s in samples]) / ERROR_SCALE_M)
    weight = np.minimum(np.concatenate([s.wall_m for s in samples]), MOST_WALL_M)
    weight /= weight.sum()
    mean, scale = x.mean(axis=0), x.std(axis=0)
    z = np.column_stack(((x - mean) / scale, np.ones(len(x))))

    def loss(b: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        u = z @ b
        value = (weight * (np.logaddexp(0.0, u) - target * u)).sum() + RIDGE * (b[:-1] ** 2).sum()
        return value, z.T @ (weight * (1 / (1 + np.exp(-u)) - target)) + np.append(2 * RIDGE * b[:-1], 0.0)

    bounds = [(0.0, None) if SIGNS.get(name, -1) > 0 else (None, 0.0) for name in FEATURES]
    found = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B", bounds=[*bounds, (None, None)])
    weights = found.x[:-1] / scale
    intercept = found.x[-1] - (weights * mean).sum()
    return QualityModel(round(float(intercept), 4), dict(zip(FEATURES, np.round(weights, 4).tolist(), strict=True)))


def rank_correlation(model: QualityModel, samples: list[Sample]) -> float:
    quality = np.concatenate([_quality(model, s) for s in samples])
    return float(spearmanr(-quality, np.concatenate([s.error_m for s in samples])).statistic)


def _quality(model: QualityModel, sample: Sample) -> NDArray[np.float64]:
    return model.quality({name: sample.features[:, i] ** 2 for i, name in enumerate(FEATURES)})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--worlds", type=int, default=WORLDS)
    arguments = parser.parse_args()
    samples = gather(SEED, arguments.worlds)
    model = fit(samples)
    windows = sum(len(s.error_m) for s in samples)
    print(f"{windows} windows of {len(samples)} maps; rank correlation {rank_correlation(model, samples):.3f}")
    halves = samples[: len(samples) // 2], samples[len(samples) // 2 :]
    for train, held_out in (halves, halves[::-1]):
        print(f"fitted on one half of the worlds, on the other: {rank_correlation(fit(train), held_out):.3f}")
    provenance = {
        "script": "tests/bench/fit_quality.py",
        "seed": SEED,
        "worlds": arguments.worlds,
        "windows": windows,
        "target": f"exp(-e / {ERROR_SCALE_M} m), e = mean distance of a window's occupied cells to undegraded walls",
    }
    text = json.dumps(
        {"provenance": provenance, "intercept": model.intercept, "weights": dict(model.weights)}, indent=2
    )
    print(text)
    if arguments.write:
        MODEL_FILE.write_text(text + "\n", encoding="utf-8")
    elif MODEL_FILE.exists():
        print("the package has", QualityModel.load())


if __name__ == "__main__":
    main()
