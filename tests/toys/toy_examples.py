"""Examples that nobody ran: little maps of rooms, right and wrong transforms, numbers that mostly tell them apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft.examples.pictures import DONOR, OWN, map_png, overlay_png
from mapgraft.examples.rows import picture, write_examples
from mapgraft.examples.window import Window, window_of
from mapgraft.outputs.report.rasters import Raster

ENVIRONMENTS: Final = ("aces", "belgioioso", "fr101", "intel", "mit")
MAP_TYPES: Final = ("occupancy_grid", "line_segments", "point_cloud", "floor_plan")
RUN: Final = "r0123456789abcdef"
CELL_M: Final = 0.2
_POOL: Final = 32  # pairs of maps that the examples share
_START_NS: Final = 1_600_000_000_000_000_123


def write_toys(
    folder: Path,
    count: int,
    *,
    seed: int = 0,
    run_id: str = RUN,
    environments: Sequence[str] = ENVIRONMENTS,
    truth: bool = True,
    shift: float = 0.0,
) -> str:
    """Write ``count`` examples into a folder; the same arguments give the same bytes.

    Half of the hypotheses are right. ``posterior`` is a true probability but for ``shift`` nats that are added to its
    log odds in the last environment, as a building does that is unlike the others. Without ``truth`` nobody knows which
    are right.
    """
    rng = np.random.default_rng(seed)
    pool = [_pair(rng) for _ in range(min(_POOL, count))]
    rows = [_row(rng, number, pool[number % len(pool)], environments, truth, shift) for number in range(count)]
    return write_examples(folder, run_id, rows)


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Two maps of one building, the true transform and a wrong one, and what is seen under both."""

    truth: Transform
    wrong: Transform
    windows: tuple[Window, Window]
    own: Raster
    donor: Raster
    own_png: bytes
    donor_png: bytes
    overlay_png: tuple[bytes, bytes]


def _pair(rng: np.random.Generator) -> _Pair:
    building = _building(rng)
    own = Raster(building[:, :55], 0.0, 0.0, CELL_M)
    donor = Raster(building[:, 25:], -2.0, -3.0, CELL_M)
    truth = Transform.planar(25 * CELL_M + 2.0, 3.0, 0.0)
    wrong = truth @ Transform.planar(*rng.uniform(1.5, 6.0, 2).tolist(), float(rng.uniform(0.3, 3.0)))
    windows = window_of(own, donor, truth), window_of(own, donor, wrong)
    overlays = tuple(overlay_png(window.fine_own, window.fine_donor) for window in windows)
    pngs = map_png(own.cells, OWN), map_png(donor.cells, DONOR)
    return _Pair(truth, wrong, windows, own, donor, *pngs, (overlays[0], overlays[1]))


def _building(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Rooms along a corridor, 16 m × 9 m."""
    cells = np.ones((45, 80), np.uint8)
    cells[[0, 19, 25, 44]] = cells[:, [0, 79]] = 2
    for side in (slice(0, 20), slice(25, 45)):
        walls = np.cumsum(rng.integers(6, 20, 8))
        cells[side, walls[walls < 79]] = 2
    for row in (19, 25):
        for door in rng.integers(2, 74, 6).tolist():
            cells[row, door : door + 4] = 1
    return cells


def _row(
    rng: np.random.Generator, number: int, pair: _Pair, environments: Sequence[str], truth: bool, shift: float
) -> dict[str, Any]:
    right = bool(rng.random() < 0.5)
    environment = environments[int(rng.integers(len(environments)))]
    log_odds = float(rng.normal(2.5 if right else -2.5, math.sqrt(5.0)))  # log odds of which this is the truth
    log_odds += shift if environment == environments[-1] else 0.0
    own_type = MAP_TYPES[number % 4 if number % 3 == 0 else 0]  # most are grids
    donor_type = MAP_TYPES[number // 4 % 4 if number % 5 == 0 else 0]
    resolutions = (0.05, 0.1, 0.2)
    own_m, donor_m = (resolutions[int(rng.integers(3))] for _ in range(2))
    evidence = _evidence(rng, right, log_odds)
    verdict = "provisional" if log_odds > 2.2 else "ambiguous" if log_odds > 0.0 else "unmatched"
    history, state = _history(rng, right, log_odds, number) if verdict == "provisional" else ([], "")
    T = pair.truth if right else pair.wrong
    return {
        "position": number,
        "example_id": f"alpha.beta.{number + 1}",
        "merge_id": f"alpha.beta.{number + 1}",
        "seq": 3 * number,
        "environment": environment,
        "recording": environment,
        "stamp": _START_NS + number * 1_000_000_000,
        "receiver": "alpha",
        "donor": "beta",
        "receiver_type": own_type,
        "donor_type": donor_type,
        "compared_type": "occupancy_grid",
        "receiver_resolution_m": own_m,
        "donor_resolution_m": donor_m,
        "resolution_ratio": own_m / donor_m,
        "receiver_quality": float(rng.uniform(0.4, 1.0)),
        "donor_quality": float(rng.uniform(0.4, 1.0)),
        "receiver_area_m2": 99.0,
        "donor_area_m2": 99.0,
        "receiver_version": 100 + number,
        "donor_version": 90 + number,
        "reversal": "ledger",
        "rule": "grids of any resolution",
        "matcher": "correlation",
        "acceptor": "posterior",
        "fuser": "log_odds",
        "verifier": "sequential",
        "verdict": verdict,
        "state": state,
        "reason": f"candidate 1 of 1 is right with probability {evidence['posterior']:.3g}",
        "state_reason": "as the test says" if state else "",
        **_of_hypothesis(pair, T, evidence, right),
        "history": history,
        "later": {row["metric"]: row["value"] for row in history},
        "T_final": T.matrix if state else None,
        "new_wall_m": float(rng.uniform(0.0, 20.0)) if state else None,
        **(_truth(pair, right, bool(state)) if truth else {}),
        "software": "0.1.0",
        "config_sha256": "c" * 64,
        "table_sha256": "d" * 64,
        "recording_sha256": ["e" * 64],
    }


def _evidence(rng: np.random.Generator, right: bool, log_odds: float) -> dict[str, float]:
    return {
        "score": float(rng.normal(300.0 if right else 180.0, 60.0)),
        "margin": float(rng.gamma(2.0, 30.0 if right else 8.0)),
        "evidence.overlap_m": float(rng.uniform(4.0, 40.0)),
        "posterior": 1.0 / (1.0 + math.exp(-log_odds)),
        "contradiction": float(rng.beta(2.0, 30.0 if right else 8.0)),
        "recall": float(rng.beta(8.0 if right else 3.0, 3.0)),
    }


def _history(rng: np.random.Generator, right: bool, log_odds: float, number: int) -> tuple[list[dict[str, Any]], str]:
    """What a sequential test would have seen in ten looks, and what came of it."""
    rows: list[dict[str, Any]] = []
    agreed = against = 0
    wrong = -max(-6.0, min(6.0, log_odds))
    for look in range(11):
        new = 0 if look == 0 else int(rng.integers(0, 8))
        bad = int(rng.binomial(new, 0.05 if right else 0.4))
        agreed, against = agreed + new - bad, against + bad
        wrong += bad * math.log(5.0) + (new - bad) * math.log(0.6 / 0.92)
        seen = {"news": against / max(1, agreed + against), "news.agreed": agreed, "news.against": against}
        seen |= {"news.places": min(against, 5), "news.agreed_m": 0.5 * agreed, "verifier.log_odds_wrong": wrong}
        stamp = _START_NS + number * 1_000_000_000 + look * 100_000_000
        rows += [
            {
                "stamp": stamp,
                "observations": 10 * look,
                "metric": name,
                "value": float(value),
                "support": agreed + against if name == "news" else 0,
            }
            for name, value in seen.items()
        ]
        if wrong > 6.9:
            return rows, "reverted"
    return rows, "confirmed" if wrong < -5.3 else "provisional"


def _of_hypothesis(pair: _Pair, T: Transform, evidence: dict[str, float], right: bool) -> dict[str, Any]:
    window = pair.windows[0 if right else 1]
    pose = {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad}
    h, w = window.own.shape
    return {
        "T_receiver_donor": T.matrix,
        **pose,
        "scale": 1.0,
        "covariance": np.diag((0.01, 0.01, 0.0, 0.0, 0.0, 1e-4)),
        "score": evidence["score"],
        "margin": evidence["margin"],
        "overlap": window.overlap,
        "hypotheses": [{**pose, "scale": 1.0, "score": evidence["score"]}],
        "chosen": 0,
        "evidence": evidence,
        "own_picture": picture(pair.own_png),
        "own_px_m": pair.own.cell_m,
        "own_x_m": pair.own.x_m,
        "own_y_m": pair.own.y_m,
        "donor_picture": picture(pair.donor_png),
        "donor_px_m": pair.donor.cell_m,
        "donor_x_m": pair.donor.x_m,
        "donor_y_m": pair.donor.y_m,
        "overlay_picture": picture(pair.overlay_png[0 if right else 1]),
        "classes_own": window.own.ravel(),
        "classes_donor": window.donor.ravel(),
        "window_px_w": w,
        "window_px_h": h,
        "window_px_m": window.canvas.cell_m,
        "window_x_m": window.canvas.x_m,
        "window_y_m": window.canvas.y_m,
    }


def _truth(pair: _Pair, right: bool, merged: bool) -> dict[str, Any]:
    word = "right" if right else "wrong"
    return {
        "truth": word,
        "truth_T": pair.truth.matrix,
        "truth_overlap": pair.windows[0].overlap,
        "truth_error_m": 0.0 if right else 4.0,
        "truth_error_deg": 0.0 if right else 60.0,
        "truth_final": word if merged else None,
        "truth_by": "recorded poses",
    }
