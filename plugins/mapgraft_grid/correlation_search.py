"""The search of the correlation matcher: all rotations and shifts on coarse cells, then the best on ever finer ones."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from mapgraft.contracts import Points
from mapgraft_grid.bayes import log_bayes_factors, occupancy_prior
from mapgraft_grid.gate import Gate
from mapgraft_grid.grid_map import OCCUPIED
from mapgraft_grid.kernels.correlating import climb, fields, keep, multiply, peaks, splat
from mapgraft_grid.prepared import Prepared, thinned

FINEST: Final = 2  # canonical cells across the last level's: on finer ones maps that are a little bent do not fit
COARSE_M: Final = 0.3  # finest cells on which everything is searched
CELLS_ACROSS: Final = 180  # cells across what the search covers: larger maps are searched on larger cells
LARGE_M: Final = 90.0  # beyond this the cells grow with the root of the extent: walls do not get larger
STEP_CELLS: Final = 3.5  # coarse cells by which one step of rotation moves the source's farthest wall
RING: Final = 0.3  # what a wall beside a wall tells on coarse cells, as a share of one upon it
CLEAR_CELLS: Final = 0.75  # free cells this near a wall tell nothing on coarse cells: they may fall on it
PER_YAW: Final = 10  # local maxima that are kept of each rotation
KEPT: Final = 300  # of all rotations
KEPT_FINER: Final = (150, 120, 120)  # on the levels below
MOST_FOUND: Final = 40  # that are refined
MOST_WITHIN: Final = 8  # within a narrow prior
ONE_M: Final = 0.4  # poses this near each other end in one when they are refined
ONE_RAD: Final = math.radians(3.0)
COARSE_POINTS: Final = (4_000, 3_000)  # walls and free cells of the source that are looked at, at most
FINE_POINTS: Final = (600, 1_500)
DIRECT: Final = 4_000  # poses within a prior that are tried one by one

# (k, 4): where the source's centre comes to lie (x, y in metres in the target's frame), yaw, score; best first
Poses = NDArray[np.float64]


class Level(NamedTuple):
    """What walls and free cells of a source tell on the target, on cells of one size."""

    prior: float
    unit_m: float
    origin_m: NDArray[np.float64]
    on_wall: NDArray[np.float32]
    on_free: NDArray[np.float32]


class Sample(NamedTuple):
    """Some walls and free cells of a source (m, from its centre), and how many cells each of them stands for."""

    walls: Points
    free: Points
    weights: tuple[float, float]


def search(target: Prepared, source: Prepared, gate: Gate | None = None) -> Poses:
    """The poses with the highest scores on cells of twice the canonical size, some dozens; only those within the gate.

    The score is the log Bayes factor of walls and free cells of the source, sampled. Without a gate, or with a wide
    one, every rotation and shift is looked at by FFT on coarse cells; within a narrow one all poses are tried.

    What this loses: of 400 pairs of maps of 30 scans from four real logs that overlap by a tenth or more, and were not
    looked at before, the best hypothesis is right for 374, and for 370 with 360 rotations and every shift on cells of
    0.2 m without sampling. For 5 it is right only there; one of these is among the 234 that overlap by 0.3 or more.
    """
    if gate is not None and (tried := _within(target, source, gate)) is not None:
        return _best(tried, ONE_M, ONE_RAD, MOST_WITHIN)
    factor = coarse_factor(target, source)
    poses, step_rad = _everywhere(target, source, factor, gate)
    kept = iter(KEPT_FINER)
    while factor > FINEST:
        factor, step_rad = max(FINEST, factor // 2), step_rad / 2.0
        fine = level(target, occupancy_prior(target, source), factor)
        sample = sampled(source, CLEAR_CELLS * fine.unit_m, FINE_POINTS)
        poses = _best(_climbed(fine, sample, poses, step_rad, 1), fine.unit_m, step_rad, next(kept, MOST_FOUND))
    return _best(poses, ONE_M, ONE_RAD, MOST_FOUND)


def level(target: Prepared, prior: float, factor: int) -> Level:
    """The target's fields on cells ``factor`` times the canonical ones; the last of each factor is kept."""
    key = ("level", factor)
    kept = target.kept.get(key)
    if not isinstance(kept, Level) or kept.prior != prior:
        factors = log_bayes_factors(prior)
        wall, free = factors[:, OCCUPIED].copy(), factors[:, 1].copy()
        on_wall, on_free = fields(target.marks, factor, wall, free, RING)
        kept = Level(prior, factor * target.unit_m, target.origin_m, on_wall, on_free)
        target.kept[key] = kept
    return kept


def coarse_factor(target: Prepared, source: Prepared) -> int:
    """How many canonical cells the cells of the coarse level are wide: as the maps' extents say."""
    across_m = float(max(target.classes.shape)) * target.unit_m + source.radius_m
    wanted_m = across_m / CELLS_ACROSS if across_m <= LARGE_M else math.sqrt(across_m * LARGE_M) / CELLS_ACROSS
    return max(FINEST + 1, round(max(COARSE_M, wanted_m) / target.unit_m))


def sampled(source: Prepared, clear_m: float, most: tuple[int, int]) -> Sample:
    """Evenly chosen walls and free cells; free ones only ``clear_m`` from walls, and no farther out than walls are."""
    key = ("sample", clear_m, most)
    if key not in source.kept:
        free = source.free_clear_of_walls(round(clear_m / source.unit_m)) - source.centre_m
        free = free[np.einsum("ij,ij->i", free, free) <= source.radius_m**2]
        some = thinned(source.walls - source.centre_m, most[0]), thinned(free, most[1])
        counts = len(source.walls), len(free)
        weights = tuple(count / max(1, len(part)) for count, part in zip(counts, some, strict=True))
        source.kept[key] = Sample(*some, (weights[0], weights[1]))
    found = source.kept[key]
    assert isinstance(found, Sample)
    return found


def _everywhere(target: Prepared, source: Prepared, factor: int, gate: Gate | None) -> tuple[Poses, float]:
    """The best local maxima over all rotations and shifts, and the step of rotation."""
    coarse = level(target, occupancy_prior(target, source), factor)
    unit_m, reach = coarse.unit_m, math.ceil(source.radius_m / coarse.unit_m) + 1
    # a source far outside wraps around, onto where little of it meets the target: both places are then tried
    height, width = (scipy.fft.next_fast_len(max(n + reach, 2 * reach + 1), real=True) for n in coarse.on_wall.shape)
    shape = (height, width)
    half_turn = max(8, math.ceil(math.pi * source.radius_m / (STEP_CELLS * unit_m)))
    step_rad = math.pi / half_turn
    within = None if gate is None else shifts_within(gate, coarse, reach, shape)
    sample = sampled(source, CLEAR_CELLS * unit_m, COARSE_POINTS)
    still = spectra(coarse, shape)
    best, n = np.empty((KEPT, 4)), 0
    for yaw in (step_rad * np.arange(half_turn)).tolist():
        halves = [half for half in range(2) if gate is None or gate.admits_yaw(yaw + half * math.pi, step_rad)]
        if not halves:
            continue
        scores = scored(still, sample, yaw, unit_m)
        if within is not None:
            scores *= within[..., None]  # what scores nothing is no peak, and hides none
        for half in halves:
            places, values = peaks(scores, half, PER_YAW, float(best[-1, 3]) if n == KEPT else 0.0)
            n = keep(best, n, places, yaw + half * math.pi, values)
    return unwrapped(best[:n], coarse, reach, shape, gate), step_rad


def shifts_within(gate: Gate, coarse: Level, reach: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which shifts of a period bring the source's centre within the gate, or a cell beside it, and to the target."""
    out = np.zeros(shape, np.bool_)
    height, width = coarse.on_wall.shape
    around = np.meshgrid(np.arange(-reach, height + reach), np.arange(-reach, width + reach), indexing="ij")
    rows, columns = (part.ravel() for part in around)
    places = (np.column_stack((columns, rows)) + 0.5) * coarse.unit_m + coarse.origin_m
    near = gate.admits_places(places, coarse.unit_m)
    out[rows[near] % shape[0], columns[near] % shape[1]] = True
    return out


def spectra(on: Level, shape: tuple[int, int]) -> NDArray[np.float32]:
    """The two spectra (2, h, w, 2) of a target, periodic in ``shape``, that ``kernels.correlating.multiply`` takes."""
    import cv2

    told = np.zeros((*shape, 2), np.float32)
    height, width = on.on_wall.shape
    told[:height, :width, 0], told[:height, :width, 1] = on.on_wall, on.on_free
    half = cv2.dft(told) * np.float32(0.5 / math.prod(shape))  # the inverse transform does not divide
    opposite = np.roll(half[::-1, ::-1], 1, (0, 1))[..., ::-1]
    return np.stack((half, opposite))


def scored(still: NDArray[np.float32], sample: Sample, yaw_rad: float, unit_m: float) -> NDArray[np.float32]:
    """The scores (h, w, 2) of all shifts, of the source turned by the yaw and by half a turn more.

    One complex transform forth and one back serve two real grids and two rotations. OpenCV's are twice as fast as
    SciPy's.
    """
    import cv2

    grid = np.zeros(still.shape[1:], np.float32)
    splat(sample.walls, sample.weights[0], yaw_rad, unit_m, 0, grid)
    splat(sample.free, sample.weights[1], yaw_rad, unit_m, 1, grid)
    multiply(still, np.asarray(cv2.dft(grid), np.float32), grid)
    return np.asarray(cv2.dft(grid, flags=cv2.DFT_INVERSE), np.float32)


def unwrapped(
    periodic: NDArray[np.float64], coarse: Level, reach: int, shape: tuple[int, ...], gate: Gate | None = None
) -> Poses:
    """The poses that periodic ones (k, 4) of row, column, yaw and score can mean: where source and target can meet,
    and no more than a cell outside the gate."""
    out = []
    for turns in np.ndindex(3, 3):
        cells = periodic[:, :2] + (np.array(turns) - 1) * np.array(shape)
        meets = ((cells >= -reach) & (cells < np.array(coarse.on_wall.shape) + reach)).all(axis=1)
        places = (cells[meets, ::-1] + 0.5) * coarse.unit_m + coarse.origin_m
        poses = np.hstack((places, periodic[meets, 2:]))
        out.append(poses if gate is None else poses[gate.admits_places(places, coarse.unit_m)])
    return _best(np.concatenate(out), 0.0, 0.0, KEPT)


def _within(target: Prepared, source: Prepared, gate: Gate) -> Poses | None:
    """The scores of all poses within the gate, on the finest level; None when they are too many."""
    fine = level(target, occupancy_prior(target, source), FINEST)
    poses = gate.lattice(fine.unit_m, fine.unit_m / max(source.radius_m, fine.unit_m), DIRECT)
    if poses is None:
        return None
    sample = sampled(source, CLEAR_CELLS * fine.unit_m, FINE_POINTS)
    return _best(_climbed(fine, sample, poses, 0.0, 0), 0.0, 0.0, KEPT)


def _climbed(fine: Level, sample: Sample, poses: Poses, step_rad: float, around: int) -> Poses:
    """The best pose around each, ``around`` cells and steps of rotation to either side."""
    here = poses[:, :3].copy()
    here[:, :2] = (here[:, :2] - fine.origin_m) / fine.unit_m
    walls, free = sample.walls / fine.unit_m, sample.free / fine.unit_m
    out = climb(fine.on_wall, fine.on_free, walls, free, sample.weights, here, step_rad, around)
    out[:, :2] = out[:, :2] * fine.unit_m + fine.origin_m
    return out


def _best(poses: Poses, apart_m: float, apart_rad: float, count: int) -> Poses:
    """The best ``count`` poses, of those in one small cell of x, y and yaw only the best."""
    poses = poses[np.argsort(-poses[:, 3], kind="stable")]
    if apart_m > 0.0:
        cells = np.round(poses[:, :3] / np.array([apart_m, apart_m, apart_rad])).astype(np.int64)
        poses = poses[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    return poses[:count]
