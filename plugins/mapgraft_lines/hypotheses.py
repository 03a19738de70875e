"""Where one map of line segments may lie in another: rotations by direction, shifts by votes of pairs of walls."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.gate import Gate
from mapgraft_lines.kernels import voting
from mapgraft_lines.scene import Poses, Scene

BINS: Final = 720  # of the full circle
BLUR_RAD: Final = math.radians(1.5)  # of directions
ROTATIONS_APART: Final = 8  # bins: 4°
ROTATIONS: Final = 12
VOTERS: Final = 150  # walls of either map, the longest
ALIKE_COSINE: Final = math.cos(math.radians(6.0))  # walls that vote for a shift
SHIFT_M: Final = 0.2  # the cells of votes
WIDEST: Final = 1200  # cells of a table of votes, in either direction
SHIFTS: Final = 24  # of each rotation
SHIFTS_APART: Final = 2  # cells
GATE_STEP_RAD: Final = math.radians(2.0)  # within a prior
GATE_ROTATIONS: Final = 24


def propose(target: Scene, source: Scene, gate: Gate | None) -> Poses:
    """Placements (k, 3) that many pairs of walls agree on, within the gate if there is one."""
    found = [
        np.column_stack((shifts, np.full(len(shifts), yaw)))
        for yaw in rotations(target, source, gate)
        for shifts in (_shifts(target, source, yaw, gate),)
    ]
    return np.concatenate(found) if found else np.empty((0, 3))


def rotations(target: Scene, source: Scene, gate: Gate | None) -> list[float]:
    """The rotations under which most of the walls run alike, best first; with a gate those within, and a few more."""
    ours, theirs = (voting.directions(side.angles_rad, side.lengths_m, side.faced, BINS) for side in (target, source))
    frequency = np.fft.rfftfreq(BINS, d=math.tau / BINS) * math.tau  # cycles per turn
    blur = np.exp(-((frequency * BLUR_RAD) ** 2))  # of both histograms
    alike = np.fft.irfft(np.fft.rfft(ours) * np.conj(np.fft.rfft(theirs)) * blur, BINS)
    kept: list[int] = []
    for k in np.argsort(-alike, kind="stable").tolist():
        if all(min((k - other) % BINS, (other - k) % BINS) > ROTATIONS_APART for other in kept):
            kept.append(k)
        if len(kept) == ROTATIONS:
            break
    yaws = [math.remainder((k + _vertex(alike, k)) * math.tau / BINS, math.tau) for k in kept]
    if gate is None:
        return yaws
    inside = [yaw for yaw in yaws if gate.admits_yaw(yaw)]
    steps = math.floor(gate.half_yaw_rad / GATE_STEP_RAD)
    if 2 * steps + 1 <= GATE_ROTATIONS:
        inside += [gate.yaw_rad + n * GATE_STEP_RAD for n in range(-steps, steps + 1)]
    return inside


def _vertex(values: NDArray[np.float64], k: int) -> float:
    """Where between its neighbours a parabola through three values of a circle has its top."""
    left, here, right = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = left - 2.0 * here + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0


def _shifts(target: Scene, source: Scene, yaw_rad: float, gate: Gate | None) -> NDArray[np.float64]:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    turned = source.ends.reshape(-1, 2) @ np.array([[c, s], [-s, c]])
    fixed = target.ends.reshape(-1, 2)
    low, high = fixed.min(axis=0) - turned.max(axis=0), fixed.max(axis=0) - turned.min(axis=0)
    if gate is not None:
        reach = np.sqrt(np.diag(gate.half)) + SHIFT_M
        place = gate.place_m - target.centre_m
        low, high = np.maximum(low, place - reach), np.minimum(high, place + reach)
        if (high < low).any():
            return np.empty((0, 2))
    cell_m = max(SHIFT_M, float((high - low).max()) / WIDEST)
    width, height = (math.ceil(span / cell_m) + 1 for span in (high - low).tolist())
    votes = np.zeros((height, width))
    voting.vote(
        target.ends[:VOTERS],
        target.faced[:VOTERS],
        source.ends[:VOTERS],
        source.faced[:VOTERS],
        *(c, s, ALIKE_COSINE, low, cell_m),
        votes,
    )
    if gate is not None:
        y, x = np.mgrid[:height, :width]
        places = np.column_stack((x.ravel(), y.ravel())) * cell_m + low + target.centre_m
        votes[~gate.admits_places(places).reshape(height, width)] = 0.0
    found = voting.peaks(votes, SHIFTS_APART, SHIFTS)
    shifts: NDArray[np.float64] = found[:, ::-1] * cell_m + low
    return shifts
