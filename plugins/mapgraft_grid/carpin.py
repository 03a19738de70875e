"""Matching by Hough spectra: fast, deterministic, good indoors (Carpin 2008)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, EmptyMapError, Map, MapError, Match, Points, Prior, Transform
from mapgraft_grid.certainty import Lattice, certainty
from mapgraft_grid.grid_map import OCCUPIED, UNKNOWN, DenseGrid, GridMap
from mapgraft_grid.kernels.agreement import coincidences, meet
from mapgraft_grid.kernels.coarsen import coarsen
from mapgraft_grid.kernels.hough import axis_spectra, hough_spectrum

OTHER_YAW_RAD = math.radians(10.0)  # two hypotheses nearer than this in both are one
OTHER_SHIFT_M = 2.5
RIVAL_SHARE = 0.5  # of the coinciding occupied cells of the best: less is no rival
PEAK_SEPARATION = 3  # cells between two peaks of an axis correlation
SEARCH_WALLS = 4_000  # occupied cells of the source that choose among all shifts
KEPT_SHIFTS = 25  # of each rotation, to be looked at more closely
SEARCH_FREE = 5_000  # free cells of the source that measure the overlap there; the final tables count all
SEARCH_CELLS = 0.3  # sd of a found shift per axis, in cells, and of a found yaw: the search is no finer
SEARCH_RAD = math.radians(0.3)
SAME_RESOLUTION = 0.01  # relative difference up to which nothing is resampled


class _Side(NamedTuple):
    """One map at the working resolution; points in metres in the map's own frame."""

    classes: NDArray[np.uint8]
    unit_m: float
    origin_m: NDArray[np.float64]  # lower-left corner
    occupied: Points
    centre: NDArray[np.float64]  # mean of the occupied points


class _Pose(NamedTuple):
    """One placement of the source on the target."""

    T: Transform
    hough_peak: float  # correlation of the Hough spectra there, 1 for the best rotation
    coincident: int  # occupied cells of the source on occupied cells of the target


class Carpin:
    """Carpin's matcher for two occupancy grids: rotations from Hough spectra, translations from X- and Y-spectra.

    The two maps may differ in resolution: the finer one is viewed at the coarser one's before matching (occupied if any
    fine cell is, free if at least half are). The ``hypotheses`` best rotations are found on whole degrees, interpolated
    between them and, with ``robust``, tried one degree to either side too. For each, the ``peaks`` best shifts of both
    axes are combined, and the combinations with most coinciding occupied cells looked at; ``peaks=1`` is the original
    method. Poses where fewer than ``overlap_min`` of the smaller map's known cells are jointly known are left out.

    Poses that are the same place (within 10° and 2.5 m) are one hypothesis, represented by the one with most coinciding
    occupied cells. Its score is the acceptance indicator ``ai`` = equal / (equal + different) over the jointly known
    cells. At most ``returned`` come back, best first; those with less than half the coinciding occupied cells of the
    best come after the others and are no rivals in the margin. Never a reflection; a prior is not used.

    The method itself tells no covariance; it comes from the walls that lie on each other (``certainty``), holds if the
    hypothesis is the right one, and is None where these are less than 2 m. Along a corridor it is about the extent of
    the target map.

    Evidence: ``agreement``, ``disagreement``, ``overlap_cells``, ``occupied_agreement`` (cells of the working
    resolution ``resolution_m``) and ``hough_peak``; with a covariance also ``sigma_max_m``, the greatest standard
    deviation of where the common walls lie, and ``degenerate_dir_rad``, its direction in the target's frame in [0, π).

    Source: S. Carpin, Fast and accurate map merging for multi-robot systems, Autonomous Robots 25 (2008).
    """

    def __init__(
        self,
        *,
        hypotheses: int = 4,
        robust: bool = True,
        peaks: int = 40,
        overlap_min: float = 0.1,
        returned: int = 4,
    ) -> None:
        if hypotheses < 1 or peaks < 1 or returned < 2:
            raise ConfigError(
                "carpin needs hypotheses >= 1, peaks >= 1 and returned >= 2, found "
                f"hypotheses={hypotheses}, peaks={peaks}, returned={returned}"
            )
        if not 0.0 <= overlap_min <= 1.0:
            raise ConfigError(f"carpin needs overlap_min between 0 and 1 (a share), found {overlap_min}")
        self.rotations = (hypotheses + 1) // 2  # the spectra repeat after 180°, so that each peak stands for two
        self.hypotheses = hypotheses
        self.offsets_deg = (0.0, -1.0, 1.0) if robust else (0.0,)
        self.peaks = peaks
        self.overlap_min = overlap_min
        self.returned = returned

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """Hypotheses of ``T_target_source``, best first; EmptyMapError when a map has no occupied cell."""
        a, b = _sides(target, source)
        poses = self._poses(a, b)
        rivals, weaker = _distinct(poses, b)
        known = _known(b)
        ranked = sorted((_scored(a, *known, pose) for pose in rivals), key=_by_score)
        ranked += sorted((_scored(a, *known, pose) for pose in weaker), key=_by_score)
        return [_completed(match, ranked, len(rivals), a, b) for match in ranked[: self.returned]]

    def _poses(self, a: _Side, b: _Side) -> list[_Pose]:
        unit_m = a.unit_m
        centred = (a.occupied - a.centre) / unit_m, (b.occupied - b.centre) / unit_m
        reach = math.ceil(max(np.hypot(*points.T).max() for points in centred)) + 1
        axis_rad, rotations = _rotations(*centred, reach, self.rotations)
        still = _fourier(axis_spectra(centred[0], math.cos(-axis_rad), math.sin(-axis_rad), reach))
        sample = _Sample.of(a, b)
        turned = [(yaw_rad + half_turn, peak) for yaw_rad, peak in rotations for half_turn in (0.0, math.pi)]
        poses = []
        for yaw_rad, hough_peak in turned[: self.hypotheses]:
            for offset_deg in self.offsets_deg:
                yaw = yaw_rad + math.radians(offset_deg)
                moving = axis_spectra(centred[1], math.cos(yaw - axis_rad), math.sin(yaw - axis_rad), reach)
                shifts = _combined(_shifts(still, _fourier(moving), self.peaks), axis_rad)
                for shift in _most_coincident(a, centred[1], yaw, shifts) * unit_m:
                    T = _compose(a.centre + shift, b.centre, yaw)
                    overlap, coincident = sample.meet(a, T)
                    if coincident and overlap >= self.overlap_min * sample.smaller:
                        poses.append(_Pose(T, hough_peak, coincident))
        return poses


class _Sample(NamedTuple):
    """The source's occupied cells, and so many of its free ones as the search can afford."""

    points: Points
    classes: NDArray[np.uint8]
    free_weight: int
    smaller: int  # known cells of the smaller of the two maps

    @classmethod
    def of(cls, target: _Side, source: _Side) -> _Sample:
        points, classes = _known(source)
        smaller = min(int(np.count_nonzero(target.classes)), classes.size)
        occupied = classes == OCCUPIED
        weight = max(1, (classes.size - int(occupied.sum())) // SEARCH_FREE)
        kept = np.concatenate((np.flatnonzero(occupied), np.flatnonzero(~occupied)[::weight]))
        return cls(np.ascontiguousarray(points[kept]), classes[kept], weight, smaller)

    def meet(self, target: _Side, T: Transform) -> tuple[int, int]:
        """(jointly known cells, about; occupied on occupied, exactly)."""
        table = _meet(target, T, self.points, self.classes)
        overlap = int(table[1:, 1].sum()) * self.free_weight + int(table[1:, OCCUPIED].sum())
        return overlap, int(table[OCCUPIED, OCCUPIED])


def _sides(target: Map, source: Map) -> tuple[_Side, _Side]:
    grids = []
    for name, map_ in (("target", target), ("source", source)):
        if not isinstance(map_, GridMap):
            raise MapError(f"carpin matches occupancy grids, the {name} is a map of type {map_.map_type!r}")
        grids.append(map_.dense())
    coarser_m = max(grid.resolution_m for grid in grids)
    return _side("target", grids[0], coarser_m), _side("source", grids[1], coarser_m)


def _side(name: str, grid: DenseGrid, working_m: float) -> _Side:
    ratio = working_m / grid.resolution_m
    resample = ratio > 1.0 + SAME_RESOLUTION
    classes = coarsen(grid.classes, ratio) if resample else grid.classes
    unit_m = working_m if resample else grid.resolution_m
    rows, columns = np.nonzero(classes == OCCUPIED)
    if rows.size == 0:
        raise EmptyMapError(f"the {name} map has no occupied cell, so there is nothing to match: map more of it first")
    origin_m = np.asarray(grid.origin_m, dtype=np.float64)
    occupied = _centres(rows, columns, unit_m, origin_m)
    return _Side(classes, unit_m, origin_m, occupied, occupied.mean(axis=0))


def _centres(rows: NDArray[np.intp], columns: NDArray[np.intp], unit_m: float, origin_m: NDArray[np.float64]) -> Points:
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * unit_m + origin_m


def _known(side: _Side) -> tuple[Points, NDArray[np.uint8]]:
    rows, columns = np.nonzero(side.classes != UNKNOWN)
    return _centres(rows, columns, side.unit_m, side.origin_m), side.classes[rows, columns]


def _meet(target: _Side, T: Transform, points: Points, classes: NDArray[np.uint8]) -> NDArray[np.int64]:
    per_m = 1.0 / target.unit_m
    cosine, sine = math.cos(T.yaw_rad) * per_m, math.sin(T.yaw_rad) * per_m
    shift = ((T.x_m - target.origin_m[0]) * per_m, (T.y_m - target.origin_m[1]) * per_m)
    table: NDArray[np.int64] = meet(target.classes, points, classes, cosine, sine, *shift)
    return table


def _rotations(
    target: NDArray[np.float64], source: NDArray[np.float64], reach: int, count: int
) -> tuple[float, list[tuple[float, float]]]:
    """The target's dominant wall normal, and the best rotations in [0, π) with their correlation, 1 for the best."""
    angles = np.deg2rad(np.arange(180.0))
    fixed, turning = (hough_spectrum(points, angles, reach) for points in (target, source))
    axis_rad = float(angles[np.argmax(fixed)])
    correlation = np.fft.irfft(np.fft.rfft(fixed) * np.conj(np.fft.rfft(turning)), angles.size)
    correlation /= correlation.max()
    before, after = np.roll(correlation, 1), np.roll(correlation, -1)
    peaks = np.flatnonzero((correlation > before) & (correlation >= after))
    best = peaks[np.argsort(-correlation[peaks], kind="stable")][:count]
    return axis_rad, [
        (math.radians(k + _vertex(before[k], correlation[k], after[k])), float(correlation[k])) for k in best.tolist()
    ]


def _vertex(before: float, peak: float, after: float) -> float:
    """Where between -½ and ½ the parabola through three equidistant values has its vertex."""
    bend = before - 2.0 * peak + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def _fourier(spectra: NDArray[np.float64]) -> NDArray[np.complex128]:
    length = 1 << (2 * spectra.shape[1] - 1).bit_length()  # room for every shift: no wrapping around
    return np.fft.rfft(spectra, length)


def _shifts(still: NDArray[np.complex128], moving: NDArray[np.complex128], count: int) -> list[list[float]]:
    """The best shifts in cells along both axes: highest local maxima of the full correlations, interpolated."""
    correlations = np.fft.fftshift(np.fft.irfft(still * np.conj(moving)), axes=1)
    middle = correlations.shape[1] // 2
    out = []
    for c in correlations:
        inner = c[1:-1]
        tops = np.flatnonzero((inner >= c[:-2]) & (inner > c[2:]) & (inner > 0)) + 1
        chosen: list[int] = []
        for top in tops[np.argsort(-c[tops], kind="stable")].tolist():
            if all(abs(top - other) > PEAK_SEPARATION for other in chosen):
                chosen.append(top)
            if len(chosen) == count:
                break
        out.append([top - middle + _vertex(c[top - 1], c[top], c[top + 1]) for top in chosen])
    return out


def _combined(shifts: list[list[float]], axis_rad: float) -> NDArray[np.float64]:
    """Every shift along the target's walls with every one across them, (k, 2) in cells along the target's axes."""
    along, across = (mesh.ravel() for mesh in np.meshgrid(*shifts, indexing="ij"))
    c, s = math.cos(axis_rad), math.sin(axis_rad)
    return np.stack((c * along - s * across, s * along + c * across), axis=1)


def _most_coincident(
    target: _Side, source: NDArray[np.float64], yaw_rad: float, shifts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Those of the shifts (k, 2) that bring most occupied cells of the source, turned, onto such of the target."""
    some = source[:: 1 + len(source) // SEARCH_WALLS]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    turned = some @ np.array([[c, s], [-s, c]]) + (target.centre - target.origin_m) / target.unit_m
    counts = coincidences(target.classes, OCCUPIED, turned, shifts)
    best: NDArray[np.float64] = shifts[np.argsort(-counts, kind="stable")[:KEPT_SHIFTS]]
    return best


def _compose(target_m: NDArray[np.float64], source_m: NDArray[np.float64], yaw_rad: float) -> Transform:
    """The transform that turns, and brings the one point to the other."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    x = target_m[0] - (c * source_m[0] - s * source_m[1])
    y = target_m[1] - (s * source_m[0] + c * source_m[1])
    return Transform.planar(float(x), float(y), yaw_rad)


def _distinct(poses: list[_Pose], source: _Side) -> tuple[list[_Pose], list[_Pose]]:
    """One pose per place, most coinciding occupied cells first, parted into rivals and weaker ones."""
    kept: list[tuple[_Pose, Points]] = []
    for pose in sorted(poses, key=lambda pose: -pose.coincident):
        spot = pose.T.apply(source.centre[None])
        if not any(_same_place(pose, spot, other, other_spot) for other, other_spot in kept):
            kept.append((pose, spot))
    needed = RIVAL_SHARE * kept[0][0].coincident if kept else 0.0
    distinct = [pose for pose, _ in kept]
    return [p for p in distinct if p.coincident >= needed], [p for p in distinct if p.coincident < needed]


def _same_place(a: _Pose, a_spot: Points, b: _Pose, b_spot: Points) -> bool:
    turn = abs(math.remainder(a.T.yaw_rad - b.T.yaw_rad, 2.0 * math.pi))
    return turn <= OTHER_YAW_RAD and bool(np.hypot(*(a_spot - b_spot)[0]) <= OTHER_SHIFT_M)


def _scored(target: _Side, points: Points, classes: NDArray[np.uint8], pose: _Pose) -> Match:
    table = _meet(target, pose.T, points, classes)
    agreement = int(table[1, 1] + table[2, 2])
    disagreement = int(table[1, 2] + table[2, 1])
    overlap = agreement + disagreement
    evidence = {
        "agreement": float(agreement),
        "disagreement": float(disagreement),
        "overlap_cells": float(overlap),
        "occupied_agreement": float(table[OCCUPIED, OCCUPIED]),
        "hough_peak": pose.hough_peak,
        "resolution_m": target.unit_m,
    }
    return Match(pose.T, score=agreement / overlap, margin=math.inf, evidence=evidence)


def _by_score(match: Match) -> tuple[float, float]:
    return -match.score, -match.evidence["occupied_agreement"]


def _completed(match: Match, ranked: list[Match], rivals: int, target: _Side, source: _Side) -> Match:
    """The match with its margin over the rivals, and with how certain it is where the walls tell."""
    others = [other.score for other in ranked[:rivals] if other is not match]
    margin = match.score - max(others) if others else math.inf
    T = match.T_receiver_donor
    known = certainty(_lattice(target), _lattice(source), T, SEARCH_CELLS * target.unit_m, SEARCH_RAD)
    if known is None:
        return Match(T, match.score, margin, evidence=match.evidence)
    evidence = {
        **match.evidence,
        "sigma_max_m": known.sigma_max_m,
        "degenerate_dir_rad": known.degenerate_dir_rad,
    }
    return Match(T, match.score, margin, covariance=known.covariance, evidence=evidence)


def _lattice(side: _Side) -> Lattice:
    return Lattice(side.classes, side.unit_m, side.origin_m)
