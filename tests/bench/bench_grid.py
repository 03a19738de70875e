"""What counting, viewing and reverting occupancy grids cost, as ratios measured in one run.

    python tests/bench/bench_grid.py [--rounds 9]

Takes the Intel log beside the checkout where it is there, else scans of a made-up building with the same 180 beams.
Everything is CPU time, best of several rounds in which the things compared take turns, so that a busy machine disturbs
them little and alike.
"""

from __future__ import annotations

import argparse
import gzip
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, GridMessage, Observation, Provenance, Scan, Transform
from mapgraft_grid.kernels import counting, rays
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.weights import TileWeights

INTEL = Path(__file__).parents[3] / "shared" / "data" / "carmen" / "intel-corrected.log.gz"
ANGLES = -math.pi / 2 + math.pi / 180 * np.arange(180)
DIRECTIONS = np.stack((np.cos(ANGLES), np.sin(ANGLES)), axis=1)
STILL = np.zeros((0, 3))  # no poses of single beams
SIDE = 1500  # cells of the map that is reverted

PART = 30  # scans that are timed together
DONE = object()

Action = Callable[[], object]
Run = Callable[[], Iterator[None]]


def observed(ranges: NDArray[np.float32], T: Transform, number: int) -> Observation:
    return Observation("robot", number, number, "laser", "scan", Scan(DIRECTIONS, ranges, ranges < 81.8), T, T)


def intel() -> list[Observation]:
    with gzip.open(INTEL, "rt") as lines:
        words = [line.split() for line in lines if line.startswith("FLASER")]
    return [
        observed(np.array(w[2:182], np.float32), Transform.planar(*map(float, w[182:185])), i)
        for i, w in enumerate(words)
    ]


def rooms(count: int = 900) -> list[Observation]:
    """A robot that walks through square rooms of 5 m: every beam ends on the nearest wall or in a door."""
    random = np.random.default_rng(1)
    out = []
    for number in range(count):
        x, y, yaw = 25 + 20 * math.sin(number / 90), 25 + 20 * math.sin(number / 130), number / 40
        a = ANGLES + yaw
        with np.errstate(divide="ignore"):
            to_x = np.where(np.cos(a) > 0, 5 - x % 5, x % 5) / abs(np.cos(a))
            to_y = np.where(np.sin(a) > 0, 5 - y % 5, y % 5) / abs(np.sin(a))
        ranges = np.minimum(to_x, to_y) + 5.0 * (random.random(180) < 0.2) + random.normal(0, 0.01, 180)
        out.append(observed(ranges.astype(np.float32), Transform.planar(x, y, yaw), number))
    return out


def best_of(rounds: int, actions: Sequence[Action]) -> list[float]:
    """CPU seconds of each action: the least of several rounds, in which they take turns."""
    least = [math.inf] * len(actions)
    for _ in range(rounds):
        for number, action in enumerate(actions):
            start = time.process_time()
            action()
            least[number] = min(least[number], time.process_time() - start)
    return least


def best_of_parts(rounds: int, runs: Sequence[Run]) -> list[float]:
    """CPU seconds of each run, which yields after every part: part by part the least of several rounds, in turns.

    The first part sets things up and does not count.
    """
    least: list[list[float]] = [[] for _ in runs]
    for _ in range(rounds):
        going = [run() for run in runs]
        for part in itertools.count():
            done = 0
            for number, run in enumerate(going):
                start = time.process_time()
                done += next(run, DONE) is DONE
                spent = time.process_time() - start
                if len(least[number]) == part:
                    least[number].append(spent)
                least[number][part] = min(least[number][part], spent)
            if done == len(going):
                break
    return [sum(parts[1:]) for parts in least]


@njit(cache=True)
def bare_writes(cells: NDArray[np.int64], counts: NDArray[np.uint16]) -> None:
    """Add one to cells whose places are known beforehand: what no way of counting can be faster than by much."""
    for i in range(cells.size):
        counts[cells[i]] += np.uint16(1)


class Counting:
    """All scans on one resolution: casting and counting them, and writing to the same cells known beforehand."""

    def __init__(self, scans: list[Observation], resolution_m: float) -> None:
        self._scans = scans
        self._lattice = (resolution_m, 0.0, 0.0)
        self._beams, self._kinds = np.empty((180, 4)), np.empty(180, np.uint8)
        results = [self._cast(scan) for scan in scans]
        tiles = np.unique(np.concatenate([keys for keys, _, _ in results]))
        self._slots = [np.searchsorted(tiles, keys).astype(np.int32) for keys, _, _ in results]
        self._hits, self._misses = np.zeros((2, tiles.size, 64, 64), np.uint16)
        self._looks = np.zeros(tiles.size, np.int32)
        self._cells = []
        for slots, (_, free, hit) in zip(self._slots, results, strict=True):
            places = np.flatnonzero(np.unpackbits((free | hit).view(np.uint8), bitorder="little"))
            self._cells.append(slots[places // 4096].astype(np.int64) * 4096 + places % 4096)
        self.updates = sum(map(len, self._cells))

    def _cast(self, observation: Observation) -> tuple[NDArray[np.int64], NDArray[np.uint64], NDArray[np.uint64]]:
        scan, T = observation.payload, observation.T_map_sensor.matrix
        assert isinstance(scan, Scan)
        _, _, keys, free, hit = rays.cast(
            scan.directions, scan.ranges_m, scan.hits, STILL, T, self._lattice, (30.0, 5.0), 0, self._beams, self._kinds
        )
        return keys, free, hit

    def ours(self) -> None:
        self._looks[:] = 0
        for observation, slots in zip(self._scans, self._slots, strict=True):
            _, free, hit = self._cast(observation)
            counting.count(0, slots, free, hit, self._hits, self._misses, self._looks)

    def bare(self) -> None:
        for cells in self._cells:
            bare_writes(cells, self._misses.reshape(-1))


def kernel_throughput(scans: list[Observation], rounds: int) -> None:
    print("\nray kernel (cast and count, called from Python), against writing to cells known beforehand")
    for resolution_m in (0.05, 0.07, 0.1):
        job = Counting(scans, resolution_m)
        ours, bare = best_of(rounds, (job.ours, job.bare))
        print(
            f"  {resolution_m:.2f} m: {job.updates / ours / 1e6:5.0f} M updates/s, "
            f"{job.updates / len(scans):5.0f} per scan, {ours / len(scans) * 1e6:5.1f} µs per scan, "
            f"{ours / bare:4.2f} x the bare writes"
        )


def built(grid: OccupancyGrid, scans: Sequence[Observation]) -> GridLayer:
    layer = grid.new_layer()
    for scan in scans:
        grid.integrate(layer, scan)
    return layer


def contribution(grid: OccupancyGrid, layer: GridLayer) -> Contribution:
    provenance, T = Provenance("donor", 0, 1), Transform.identity()
    return Contribution(provenance, layer, T, 1.0, grid.resampler(layer), TileWeights.plain(), None, grid.region(layer))


def donors(grid: OccupancyGrid, scans: list[Observation], count: int) -> tuple[Contribution, ...]:
    """Other robots of the same building, that see the half of it each, at another resolution."""
    other = OccupancyGrid(resolution_m=0.07)
    out = []
    for number in range(count):
        part = built(other, scans[number % 2 :: 2 + number])
        out.append(contribution(grid, grid.place(part, Transform.planar(0.01 * number, 0.0, 0.002 * number))))
    return tuple(out)


def updates(scans: list[Observation], rounds: int) -> None:
    print("\nupdate and view of the touched tiles, scan by scan, against a plain single grid (no donor)")
    grid = OccupancyGrid()
    eight = donors(grid, scans, 8)
    parts = [scans[first : first + PART] for first in range(0, len(scans), PART)]

    def ledger(contributions: tuple[Contribution, ...]) -> Run:
        robot = OccupancyGrid()  # by itself: it remembers what its contributions add

        def run() -> Iterator[None]:
            layer = robot.new_layer()
            seen = robot.view(layer, contributions)
            yield
            for part in parts:
                for scan in part:
                    seen = robot.view(layer, contributions, seen, robot.integrate(layer, scan))
                yield

        return run

    def only_count() -> Iterator[None]:
        layer = grid.new_layer()
        yield
        for part in parts:
            for scan in part:
                grid.integrate(layer, scan)
            yield

    def multi_map() -> Iterator[None]:
        own, merged = grid.new_layer(), grid.new_layer()
        grid.absorb(merged, eight[0])
        seen = grid.view(merged)
        yield
        for part in parts:
            for scan in part:
                grid.integrate(own, scan)
                seen = grid.view(merged, (), seen, grid.integrate(merged, scan))
            yield

    def single_map() -> Iterator[None]:
        merged = grid.new_layer()
        updated = grid.region(merged)
        grid.absorb(merged, eight[0])
        seen = grid.view(merged)
        yield
        for part in parts:
            for scan in part:
                touched = grid.integrate(merged, scan)
                updated = updated.union(touched)
                seen = grid.view(merged, (), seen, touched)
            yield

    names = ("plain", "1 donor", "3 donors", "8 donors", "multi_map, 1 donor", "single_map, 1 donor", "count only")
    runs = (ledger(()), ledger(eight[:1]), ledger(eight[:3]), ledger(eight), multi_map, single_map, only_count)
    times = best_of_parts(rounds, runs)
    for name, seconds in zip(names, times, strict=True):
        print(f"  {name:20s} {seconds / len(scans) * 1e6:6.1f} µs per scan, {seconds / times[0]:5.3f} x plain")


def reverting(rounds: int) -> None:
    print(f"\nwhole view of {SIDE} x {SIDE} cells after a revert (bar: 20 ms)")
    grid = OccupancyGrid()
    cells = np.zeros((SIDE, SIDE), np.int8)
    cells[::20] = cells[:, ::30] = 100
    T = Transform.identity()
    layers = []
    for number in range(4):
        layer = grid.new_layer()
        message = GridMessage(cells, 0.05, Transform.planar(0.05 * number, 0.0, 0.0))
        grid.integrate(layer, Observation("plan", 0, 0, "map", "grid_message", message, T, T))
        layers.append(layer)
    own, *others = layers
    three = tuple(contribution(grid, layer) for layer in others)
    merged = grid.view(own, three)

    def again(contributions: tuple[Contribution, ...]) -> Action:
        def run() -> None:
            grid.view(own, contributions, merged, three[2].region)

        return run

    def with_arrays() -> None:
        grid.view(own).dense()

    def afresh() -> None:  # forget the sum, as if a donor had just gone
        grid.view(own, three)
        grid.view(own, three[:2], merged, three[2].region)

    one, none, arrays, two, keep = best_of(rounds, (again(three[:1]), again(()), with_arrays, afresh, again(three)))
    print(f"  nothing left {none * 1e3:5.1f} ms, with arrays of the whole {arrays * 1e3:5.1f} ms")
    print(f"  one donor left {one * 1e3:5.1f} ms, three standing {keep * 1e3:5.1f} ms")
    print(f"  summing three anew, then two anew: {two * 1e3:5.1f} ms for both views")


def exchange(scans: list[Observation], rounds: int) -> None:
    print("\nwhat passes between robots")
    grid, coarse = OccupancyGrid(), OccupancyGrid(resolution_m=0.1)
    layer = built(grid, scans)
    data = grid.encode(layer)
    T = Transform.planar(1.0, 2.0, 0.3)
    times = best_of(
        max(3, rounds // 3),
        (
            lambda: grid.encode(layer),
            lambda: grid.decode(data),
            lambda: grid.place(layer, T),
            lambda: coarse.place(layer, T),
            lambda: grid.metadata(layer),
        ),
    )
    encode, decode, place, placed_coarse, metadata = (1e3 * seconds for seconds in times)
    size = f"{len(data) / 1000:.0f} kB for {len(layer.pool.index)} tiles"
    print(f"  {size}; encode {encode:.1f} ms, decode {decode:.1f} ms")
    print(f"  place {place:.1f} ms, on coarser cells {placed_coarse:.1f} ms; metadata {metadata:.1f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    scans = intel() if INTEL.exists() else rooms()
    print(f"{len(scans)} scans of 180 beams: {'Intel log' if INTEL.exists() else 'made-up rooms'}")
    kernel_throughput(scans, rounds)
    updates(scans, rounds)
    reverting(rounds)
    exchange(scans, rounds)


if __name__ == "__main__":
    main()
