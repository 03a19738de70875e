"""Where right and wrong matches of point clouds part: ``python tests/bench/choose_cloud_limits.py [-n N] [--first K]``.

The limits of the default rules were chosen on the buildings from ``CHOSEN_ON`` on, what they come to is told of those
from ``JUDGED_ON`` on, on which nothing was chosen.

Two drives with a spinning lidar through each of the simulated buildings are matched from no prior, as are drives
through different buildings, each once with free space and once as ready-made clouds without any. Every hypothesis of
the matcher is right (within 0.5 m and 5 degrees of the truth) or wrong; the table tells for both what the metrics say.
Of right best hypotheses the errors and their squares in units of the stated covariance (``squares``) are told, too,
and how many pairs the default rules take.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mapgraft.contracts import CLOUD_MAP, Acceptor, Candidate, Cloud, Match, Measurement, Observation, Transform
from mapgraft.decision import build_table
from mapgraft.errors import MapgraftError
from mapgraft.plugins import load_plugins
from mapgraft.procedures import Workshop
from mapgraft_cloud.agreement import Agreement, agreement
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.kiss import Kiss
from mapgraft_cloud.map_type import PointCloud
from mapgraft_recordings.buildings import building
from mapgraft_recordings.buildings.spatial import record_spatial, spatial_observations

CHOSEN_ON, JUDGED_ON = 500, 900  # seeds of buildings
RULES = {True: "clouds that know what is free", False: "clouds of which one has no free space"}
SWEEPS = (30, 60, 120)
COMMON_M2 = 15.0  # of walls that two drives must both have seen


@dataclass(frozen=True)
class Row:
    """One hypothesis."""

    building: int
    kind: str
    free_space: bool
    related: bool
    rank: int
    right: bool
    error_m: float
    error_deg: float
    score: float
    margin: float
    shared_m2: float
    overlap: float
    contradiction: float
    squares: float  # of the error in x, y, z, yaw in units of the covariance
    taken: bool  # by the default rules
    common_m2: float  # what is shared under the true transform; 0 without one


def maps_of(seed: int, drive: int, sweeps: int, T: Transform) -> tuple[CloudMap, CloudMap]:
    """The map of a drive, moved by a transform, with free space and as a ready-made cloud."""
    kind = PointCloud()
    layer = kind.new_layer()
    for observation in spatial_observations(record_spatial(building(seed), drive, sweeps)):
        kind.integrate(layer, observation)
    placed = kind.view(kind.place(layer, T))
    ready, still = kind.new_layer(), Transform.identity()
    cloud = Cloud(placed.points_m.astype(np.float32), origin_m=None)
    kind.integrate(ready, Observation("ready", 0, 0, "file", CLOUD_MAP, cloud, still, still))
    return placed, kind.view(ready)


def acceptors() -> dict[bool, Acceptor]:
    """What the default rules accept by, for maps that know free space and for others."""
    plugins = load_plugins()
    rules = {record.rule.name: record.rule for record in build_table(plugins).records}
    return {free: Workshop(plugins).tools(rules[name]).acceptor for free, name in RULES.items()}


def rows_of(
    seed: int, own: CloudMap, donor: CloudMap, truth: Transform | None, free_space: bool, acceptor: Acceptor
) -> Iterator[Row]:
    matches = Kiss().match(own, donor)
    agreed = [agreement(own, donor, match.T_receiver_donor, walls_only=True) for match in matches]
    common_m2 = 0.0 if truth is None else agreement(own, donor, truth, walls_only=True).shared_m2
    decision = acceptor.accept([candidate(*pair) for pair in zip(matches, agreed, strict=True)])
    for rank, (match, found) in enumerate(zip(matches, agreed, strict=True)):
        error_m, error_deg, squares = math.inf, math.inf, math.inf
        if truth is not None:
            error_m, error_deg, squares = errors(donor, match, truth)
        yield Row(
            seed,
            building(seed).kind,
            free_space,
            truth is not None,
            rank,
            error_m < 0.5 and error_deg < 5.0,
            error_m,
            error_deg,
            match.score,
            match.margin,
            found.shared_m2,
            *shares(found),
            squares,
            rank == decision.chosen,
            common_m2,
        )


def shares(found: Agreement) -> tuple[float, float]:
    """The overlap and the contradiction."""
    contradicted = found.through_m2 / max(found.through_m2 + found.shared_m2, 1e-9)
    return found.shared_m2 / max(found.covered_m2, 1e-9), contradicted


def candidate(match: Match, found: Agreement) -> Candidate:
    """A match with what the metrics of the default rules say of it."""
    overlap, contradiction = shares(found)
    told = {
        "cloud_overlap": Measurement("cloud_overlap", overlap, "1", 100, "higher"),
        "cloud_contradiction": Measurement("cloud_contradiction", contradiction, "1", 100, "lower"),
    }
    return Candidate(match, told)


def errors(donor: CloudMap, match: Match, truth: Transform) -> tuple[float, float, float]:
    """Metres in the middle of the donor's map, degrees, and the squared error in units of the covariance."""
    middle = donor.points_m.mean(axis=0)[None]
    apart = match.T_receiver_donor.apply(middle) - truth.apply(middle)
    yaw = math.remainder(match.T_receiver_donor.yaw_rad - truth.yaw_rad, 2.0 * math.pi)
    off = np.append(match.T_receiver_donor.matrix[:3, 3] - truth.matrix[:3, 3], yaw)
    assert match.covariance is not None
    spread = match.covariance[np.ix_([0, 1, 2, 5], [0, 1, 2, 5])]
    return float(np.linalg.norm(apart)), abs(math.degrees(yaw)), float(off @ np.linalg.solve(spread, off))


def measure(first: int, buildings: int) -> Iterator[Row]:
    rng, accept = np.random.default_rng(0), acceptors()
    before: tuple[CloudMap, CloudMap] | None = None
    for seed in range(first, first + buildings):
        sweeps = SWEEPS[seed % len(SWEEPS)]
        x, y, yaw = (*rng.uniform(-20.0, 20.0, 2).tolist(), float(rng.uniform(-math.pi, math.pi)))
        T = Transform.planar(x, y, yaw).snapped()
        try:
            own, donor = maps_of(seed, 0, sweeps, Transform.identity()), maps_of(seed, 1, sweeps, T)
        except MapgraftError as error:
            sys.stderr.write(f"{seed}: {error}\n")
            continue
        for free in (True, False):
            k = 0 if free else 1
            yield from rows_of(seed, own[k], donor[k], T.inverse(), free, accept[free])
            if before is not None:
                yield from rows_of(seed, own[k], before[k], None, free, accept[free])
        before = donor


def told(rows: list[Row]) -> Iterator[str]:
    for free in (True, False):
        some = [row for row in rows if row.free_space == free]
        yield f"{'with' if free else 'without'} free space:"
        for right in (True, False):
            these = [row for row in some if row.right == right]
            if not these:
                continue
            yield f"  {'right' if right else 'wrong'}: {len(these)} hypotheses"
            for name in ("shared_m2", "overlap", "contradiction", "margin"):
                values = np.array([getattr(row, name) for row in these])
                marks = np.percentile(values[np.isfinite(values)], (0, 1, 10, 50, 90, 99, 100))
                yield f"    {name:14s}" + " ".join(f"{mark:9.3f}" for mark in marks)
        yield from told_of_decisions(some)


def told_of_decisions(rows: list[Row]) -> Iterator[str]:
    """Which hypotheses come first, which of them are taken, and how far these are off."""
    best = [row for row in rows if row.related and row.rank == 0]
    others = [row for row in rows if not row.related and row.rank == 0]
    right = [row for row in best if row.right]
    taken = [row for row in rows if row.taken]
    common = sum(row.common_m2 >= COMMON_M2 for row in best)
    yield f"  best hypothesis right: {len(right)} of {len(best)} pairs"
    yield f"    {common} of these pairs have {COMMON_M2:g} m² of wall in common"
    yield f"  taken: {sum(row.right for row in taken)} right, {sum(not row.right for row in taken)} wrong"
    yield f"    of {len(best)} pairs of one building and {len(others)} of different ones"
    for what, these in (("best right", right), ("taken right", [row for row in taken if row.right])):
        for name in ("error_m", "error_deg", "squares") if these else ():
            values = np.array([getattr(row, name) for row in these])
            marks = " ".join(f"{mark:9.3f}" for mark in np.percentile(values, (0, 50, 90, 100)))
            yield f"    {what:12s} {name:10s} {marks}"
    near = [row for row in rows if not row.right and row.shared_m2 >= 15 and row.overlap >= 0.3]
    if near:
        least = min(row.contradiction for row in near)
        yield f"  wrong with 15 m² and an overlap of 0.3: contradiction from {least:.3f} on"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", "--buildings", type=int, default=9)
    parser.add_argument("--first", type=int, default=JUDGED_ON, help="seed of the first building")
    parser.add_argument("-o", "--output", type=Path, help="JSON file for all hypotheses")
    given = parser.parse_args()
    rows: list[Row] = []
    for row in measure(given.first, given.buildings):
        rows.append(row)
        if given.output is not None:
            given.output.write_text(json.dumps([asdict(row) for row in rows]), encoding="utf-8")
    print("\n".join(told(rows)))


if __name__ == "__main__":
    main()
