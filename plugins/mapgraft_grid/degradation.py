"""Making scans worse on purpose, to fit and to test what judges maps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mapgraft.contracts import MapError, Observation, Scan, Transform


@dataclass(frozen=True, slots=True)
class Degradation:
    """Independent Gaussian errors of every pose and of every range, and the share of beams that are lost."""

    pose_sigma_m: float = 0.0
    pose_sigma_rad: float = 0.0
    range_sigma_m: float = 0.0
    dropped: float = 0.0


def degrade(observations: Iterable[Observation], degradation: Degradation, seed: int) -> Iterator[Observation]:
    """The same scans, made worse; equal seeds give equal scans. Raises MapError on an observation without a scan."""
    rng = np.random.default_rng(seed)
    for observation in observations:
        if not isinstance(observation.payload, Scan):
            raise MapError(f"only scans can be degraded, found {observation.kind!r} of {observation.robot}")
        x, y, yaw = rng.normal(0.0, 1.0, 3)
        sigma = degradation.pose_sigma_m
        error = Transform.planar(sigma * x, sigma * y, degradation.pose_sigma_rad * yaw)
        yield dataclasses.replace(
            observation,
            payload=_worse(observation.payload, degradation, rng),
            T_map_sensor=observation.T_map_sensor @ error,
            T_map_base=observation.T_map_base @ error,
        )


def _worse(scan: Scan, degradation: Degradation, rng: np.random.Generator) -> Scan:
    noise = rng.normal(0.0, 1.0, scan.ranges_m.size)
    lost = rng.random(scan.ranges_m.size) < degradation.dropped
    moved = np.maximum(scan.ranges_m + degradation.range_sigma_m * noise, 0.0)
    ranges_m = np.where(scan.hits, moved, scan.ranges_m)
    ranges_m[lost] = np.nan
    return dataclasses.replace(scan, ranges_m=ranges_m.astype(np.float32))
