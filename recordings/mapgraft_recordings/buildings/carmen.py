"""A drive as a CARMEN log: one ROBOTLASER1 line per scan, with the corrected pose of the laser and that of odometry."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mapgraft_recordings.buildings.driving import Drive
from mapgraft_recordings.simulator.estimation import OdometryError, odometry_poses

_LASER_TYPE, _ACCURACY_M, _REMISSION_MODE = 0, 0.01, 0
_HOST = "mapgraft"


def write_carmen(path: Path, made: Drive, seed: int) -> None:
    """Write a log, gzipped where the name ends in ``.gz``; the same drive and seed (of odometry) give the same bytes.

    A beam without return has the laser's longest range, a lost one 0. The file gets its name only when it is complete.
    """
    text = "".join(_lines(made, seed)).encode()
    partial = path.with_name(f".{path.name}.partial")
    partial.write_bytes(gzip.compress(text, mtime=0) if path.suffix == ".gz" else text)
    partial.replace(path)


def _lines(made: Drive, seed: int) -> Iterator[str]:
    yield "# CARMEN Logfile\n# simulated: a drive through a random building\n"
    sensor = made.sensor
    decimals = 3 if sensor.step_m < 0.01 else 2
    head = (
        f"ROBOTLASER1 {_LASER_TYPE} {-sensor.field_rad / 2:.9f} {sensor.field_rad:.9f} {sensor.increment_rad:.9f} "
        f"{sensor.max_m:.2f} {_ACCURACY_M} {_REMISSION_MODE} {sensor.beams}"
    )
    odometry = odometry_poses(made.poses, OdometryError(), np.random.default_rng(seed))
    rows = zip(made.sightings, made.believed.tolist(), odometry.tolist(), strict=True)
    for sighting, believed, rolled in rows:
        ranges = np.nan_to_num(sighting.ranges_m, nan=0.0, posinf=sensor.max_m)
        readings = " ".join(f"{reading:.{decimals}f}" for reading in ranges.tolist())
        stamp = f"{sighting.stamp_ns / 1e9:.6f}"
        yield f"{head} {readings} 0 {_pose(believed)} {_pose(rolled)} 0 0 0 0 0 {stamp} {_HOST} {stamp}\n"


def _pose(pose: list[float]) -> str:
    x, y, yaw = pose
    return f"{x:.6f} {y:.6f} {math.remainder(yaw, 2.0 * math.pi):.6f}"
