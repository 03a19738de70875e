"""What matching by correlation costs and what its search loses, as ratios measured in one run.

    python tests/bench/bench_match.py [--pairs 24] [--loss 50] [--seed 11]

Takes windows of 30 scans from the CARMEN logs beside the checkout where they are there, else from simulated missions.
Times are CPU times of one core with everything compiled and nothing kept from earlier attempts. Compared are

- the match of two windows, against 360 rotations × (2 forward + 1 inverse) real FFTs of single precision at the size
  that an exhaustive search on the same coarse cells needs without wrapping around;
- the same again with what is kept of both maps, and within a match's own covariance as prior;
- whole floors of up to 1000 × 1000 cells, with the exponent of the cost over the number of cells;
- the best hypothesis of pairs that overlap, against the best of an exhaustive search of 360 rotations on the
  finest level of the search, all refined alike: how often that one's log Bayes factor is higher, and how often it
  is right where ours is not.
"""

from __future__ import annotations

import argparse
import gzip
import math
import time
from collections.abc import Callable, Iterator
from itertools import count, islice, pairwise
from pathlib import Path

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from simulated_missions import map_of, missions

from mapgraft.contracts import GRID_MESSAGE, SCAN, GridMessage, Observation, Prior, Scan, Transform
from mapgraft_grid import correlation_search as searching
from mapgraft_grid.bayes import meet, meeting_table, occupancy_prior
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.grid_map import OCCUPIED, GridMap
from mapgraft_grid.kernels.correlating import peaks
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import Prepared, canonical_m, prepare, thinned
from mapgraft_grid.refinement import distance_field, placed, refined

LOGS = Path(__file__).parents[3] / "shared" / "data" / "carmen"
NO_RETURN_M = {"intel": 81.8, "aces": 49.9, "belgioioso": 81.8, "freiburg-101": 81.8}
SCANS, APART = 30, 40  # of a window; between two
RESOLUTIONS_M = ((0.07, 0.07), (0.07, 0.10), (0.10, 0.07))
RIGHT_M, RIGHT_RAD = 0.5, math.radians(5.0)
BINS = (0.1, 0.3, 0.5, 0.7, math.inf)  # of the true overlap
SIDES = (125, 250, 500, 1000)  # cells of 0.1 m of whole floors

Pair = tuple[GridMap, GridMap, Transform]


def recorded(name: str) -> list[Observation]:
    out = []
    with gzip.open(LOGS / f"{name}-corrected.log.gz", "rt") as lines:
        for number, words in enumerate(line.split() for line in lines if line.startswith("FLASER")):
            beams = int(words[1])
            angles = -math.pi / 2 + math.pi / (beams - beams % 2) * np.arange(beams)
            ranges = np.array(words[2 : 2 + beams], np.float32)
            directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
            T = Transform.planar(*map(float, words[2 + beams : 5 + beams]))
            scan = Scan(directions, ranges, ranges < NO_RETURN_M[name])
            out.append(Observation("r", number, number, "scan", SCAN, scan, T, T))
    return out


def logs() -> Iterator[list[Observation]]:
    if LOGS.is_dir():
        yield from map(recorded, NO_RETURN_M)
    else:
        for seed in range(4):
            yield missions(np.random.default_rng(seed), 1, 400)[0]


def pairs(per_log: int, seed: int = 1) -> Iterator[Pair]:
    """Pairs of windows of each log, whether they overlap or not."""
    for number, log in enumerate(logs()):
        yield from islice(windows(log, np.random.default_rng([seed, number])), per_log)


def windows(log: list[Observation], random: np.random.Generator) -> Iterator[Pair]:
    """Pairs of windows of one log without end, each in the frame of its first scan, turned, and ``T_first_second``."""
    for k in count():
        first, second = 0, 0
        while abs(first - second) < SCANS + APART:
            first, second = random.integers(0, len(log) - SCANS, 2).tolist()
        maps, frames = [], []
        for start, resolution_m in zip((first, second), RESOLUTIONS_M[k % 3], strict=True):
            turn = Transform.planar(0.0, 0.0, random.uniform(-math.pi, math.pi))
            T = turn @ log[start].T_map_sensor.inverse()
            maps.append(map_of([in_frame(T, o) for o in log[start : start + SCANS]], resolution_m)[2])
            frames.append(T)
        yield maps[0], maps[1], frames[0] @ frames[1].inverse()


def in_frame(T: Transform, o: Observation) -> Observation:
    pose = T @ o.T_map_sensor
    return Observation(o.robot, o.stamp_ns, o.recorded_ns, o.sensor, o.kind, o.payload, pose, pose)


def anew(map_: GridMap) -> GridMap:
    """The same map with nothing kept of it but its dense grid."""
    out = GridMap(map_.lattice, map_.thresholds, map_.tiles, map_.known())
    out.dense()
    return out


def cost(action: Callable[[], object]) -> float:
    start = time.process_time()
    action()
    return time.process_time() - start


def exhaustive_shape(target: Prepared, source: Prepared) -> tuple[int, int]:
    """The padded size without wrapping around, on the coarse cells of the search."""
    unit_m = searching.coarse_factor(target, source) * target.unit_m
    across = math.ceil(2.0 * source.radius_m / unit_m) + 1
    sides = (math.ceil(n * target.unit_m / unit_m) + across - 1 for n in target.classes.shape)
    height, width = (scipy.fft.next_fast_len(n, real=True) for n in sides)
    return height, width


def transforms(shape: tuple[int, int], rotations: int = 360) -> Callable[[], None]:
    grids = np.random.default_rng(0).random((2, *shape)).astype(np.float32)

    def run() -> None:
        for _ in range(rotations):
            spectra = scipy.fft.rfft2(grids)
            scipy.fft.irfft2(spectra[0], shape)

    return run


def times(per_log: int) -> None:
    matcher = Correlation()
    rows = []
    for number, (target, source, _) in enumerate(pairs(per_log)):
        one, other = anew(target), anew(source)
        if number == 0:
            matcher.match(anew(target), anew(source))
        fresh_s = cost(lambda: matcher.match(one, other))  # noqa: B023
        found = matcher.match(one, other)
        kept_s = cost(lambda: matcher.match(one, other))  # noqa: B023
        unit_m = canonical_m(one.resolution_m, other.resolution_m)
        shape = exhaustive_shape(prepare(one, unit_m), prepare(other, unit_m))
        fft_s = cost(transforms(shape))
        prior_s = math.nan
        if found[0].covariance is not None:
            prior = Prior(found[0].T_receiver_donor, found[0].covariance, "the match")
            prior_s = cost(lambda: matcher.match(one, other, prior))  # noqa: B023
        rows.append((fresh_s, kept_s, prior_s, fft_s, fresh_s / fft_s))
    columns = np.array(rows)
    print(f"two maps of {SCANS} scans, {len(rows)} pairs: median (95th percentile)")
    names = (
        "match, anew",
        "match, both maps known",
        "match, its own covariance as prior",
        "360 × 3 FFTs",
        "match / FFTs",
    )
    for name, column in zip(names, columns.T, strict=True):
        scale, unit = (1.0, "") if "/" in name else (1e3, " ms")
        print(f"  {name:36} {scale * np.nanmedian(column):8.2f} ({scale * np.nanquantile(column, 0.95):.2f}){unit}")


def floor(side: int, seed: int, turn: float) -> GridMap:
    """A floor of rooms of 4 to 8 m with doors, ``side`` cells of 0.1 m across, seen turned; unknown in some corners."""
    random = np.random.default_rng(seed)
    world = np.ones((side, side), np.uint8)
    for axis in range(2):
        at = 0
        while at < side:
            wall = world[at : at + 2] if axis == 0 else world[:, at : at + 2].T
            wall[:] = OCCUPIED
            for door in random.integers(0, side, side // 50):
                wall[:, door : door + 10] = 1
            at += int(random.integers(40, 80))
    for _ in range(side * side // 900):
        y, x = random.integers(0, side, 2)
        world[y : y + random.integers(2, 8), x : x + random.integers(2, 8)] = OCCUPIED
    grids = OccupancyGrid(resolution_m=0.1)
    layer = grids.new_layer()
    c, s, middle = math.cos(turn), math.sin(turn), side / 2.0
    y, x = np.mgrid[:side, :side] + 0.5 - middle
    u, v = np.floor(c * x + s * y + middle).astype(int), np.floor(c * y - s * x + middle).astype(int)
    inside = (u >= 0) & (u < side) & (v >= 0) & (v < side)
    cells = np.full((side, side), -1, np.int8)
    cells[inside] = np.where(world[v[inside], u[inside]] == OCCUPIED, 100, 0)
    T = Transform.identity()
    grids.integrate(layer, Observation("r", 0, 0, "map", GRID_MESSAGE, GridMessage(cells, 0.1, T), T, T))
    return grids.view(layer)


def curve() -> None:
    matcher = Correlation()
    seconds = []
    print("whole floors")
    for side in SIDES:
        one, other = floor(side, 1, 0.0), floor(side, 1, 2.0)
        one.dense(), other.dense()
        seconds.append(cost(lambda: matcher.match(one, other)))  # noqa: B023
        found = matcher.match(one, other)[0].T_receiver_donor
        off = abs(math.degrees(math.remainder(found.yaw_rad + 2.0, 2.0 * math.pi)))
        print(f"  {side:5} × {side:<5} cells {1e3 * seconds[-1]:8.1f} ms, off by {off:.2f}°")
    exponent = np.polyfit(np.log(np.array(SIDES) ** 2), np.log(seconds), 1)[0]
    print(f"  cost ~ cells^{exponent:.2f}")


def exhaustive(target: Prepared, source: Prepared) -> NDArray[np.float64]:
    """The best poses of 360 rotations and all shifts on the finest level; no sampling, no wrapping around."""
    fine = searching.level(target, occupancy_prior(target, source), searching.FINEST)
    sample = searching.sampled(source, searching.CLEAR_CELLS * fine.unit_m, (10**6, 10**6))
    reach = math.ceil(source.radius_m / fine.unit_m) + 1
    height, width = (scipy.fft.next_fast_len(n + 2 * reach, real=True) for n in fine.on_wall.shape)
    still = searching.spectra(fine, (height, width))
    found = [np.empty((0, 4))]
    for yaw in np.deg2rad(np.arange(180.0)).tolist():
        scores = searching.scored(still, sample, yaw, fine.unit_m)
        for half in range(2):
            places, values = peaks(scores, half, 20, 0.0)
            found.append(np.column_stack((places, np.full(values.size, yaw + half * math.pi), values)))
    periodic = np.concatenate(found)
    best = periodic[np.argsort(-periodic[:, 3], kind="stable")[:300]]
    return searching.unwrapped(best, fine, reach, (height, width))


def loss(per_log: int, seed: int) -> None:
    """Both searches on the first pairs of each log that overlap by a tenth or more."""
    matcher, rows = Correlation(), []
    for target, source, truth in overlapping(per_log, seed):
        best = matcher.match(target, source)[0]
        unit_m = canonical_m(target.resolution_m, source.resolution_m)
        ours, theirs = prepare(target, unit_m), prepare(source, unit_m)
        rough = [placed(pose, theirs.centre_m) for pose in exhaustive(ours, theirs)]
        moved = refined(distance_field(target), distance_field(source), theirs.centre_m, rough)
        factors = [meet(ours, theirs, T).log_bayes_factor for T in moved]
        other = moved[int(np.argmax(factors))]
        missed = max(factors) > best.score * 1.01
        found = (right(T, truth, theirs) for T in (best.T_receiver_donor, other))
        rows.append((overlap(ours, theirs, truth), missed, *found))
    columns = np.array(rows, dtype=np.float64)
    print(f"against an exhaustive search, {len(rows)} pairs that overlap, seed {seed}")
    print("  overlap    pairs  right: ours  exhaustive  only the exhaustive  only ours  higher L missed")
    for low, high in [*pairwise(BINS), (BINS[0], BINS[-1])]:
        told = columns[(columns[:, 0] >= low) & (columns[:, 0] < high), 1:].astype(bool)
        missed, here, there = told.T
        counts = here.sum(), there.sum(), (there & ~here).sum(), (here & ~there).sum(), missed.sum()
        print(f"  {low:.1f} to {min(high, 1.0):.1f} {len(told):5}" + "".join(f"{count:13}" for count in counts))


def overlapping(per_log: int, seed: int) -> Iterator[Pair]:
    """So many pairs of each log that overlap by a tenth or more."""
    for log in logs():
        taken = 0
        for target, source, truth in windows(log, np.random.default_rng([seed, len(log)])):
            unit_m = canonical_m(target.resolution_m, source.resolution_m)
            if overlap(prepare(target, unit_m), prepare(source, unit_m), truth) >= BINS[0]:
                yield target, source, truth
                taken += 1
            if taken == per_log:
                break


def overlap(target: Prepared, source: Prepared, truth: Transform) -> float:
    """Cells that both know over the known cells of the smaller map."""
    known = meeting_table(target, source, truth)[1:4, 1:4].sum()
    return float(known) / float(min(side.mark_counts[1:4].sum() for side in (target, source)))


def right(found: Transform, truth: Transform, source: Prepared) -> bool:
    spots = thinned(source.walls, 300)
    turn = abs(math.remainder(found.yaw_rad - truth.yaw_rad, 2.0 * math.pi))
    return bool(np.hypot(*(found.apply(spots) - truth.apply(spots)).T).mean() <= RIGHT_M and turn <= RIGHT_RAD)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--pairs", type=int, default=24, help="pairs per log that are timed")
    parser.add_argument("--loss", type=int, default=50, help="overlapping pairs per log that are searched exhaustively")
    parser.add_argument("--seed", type=int, default=11, help="of the pairs that are searched exhaustively")
    given = parser.parse_args()
    times(given.pairs)
    curve()
    if given.loss:
        loss(given.loss, given.seed)


if __name__ == "__main__":
    main()
