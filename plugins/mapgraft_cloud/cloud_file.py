"""Ready-made point-cloud maps from files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from mapgraft.contracts import Cloud, ConfigError, MapError
from mapgraft_cloud.columns import Columns, cloud_of
from mapgraft_cloud.pcd import SeenFrom, read_pcd
from mapgraft_cloud.ply import read_ply

Warn = Callable[[str], None]
_LARGE_M: Final = 5_000.0  # a building in millimetres is larger


def read(
    path: str | Path,
    *,
    viewpoint: Sequence[float] | None = None,
    unit_m: float = 1.0,
    warn: Warn | None = None,
) -> Cloud:
    """The cloud in a PCD or PLY file.

    ``viewpoint`` (x, y, z in metres) is where the cloud was seen from when it is a single sweep: what lies between is
    free then. ``unit_m`` is the length of the file's unit (0.001 for millimetres). ``warn`` is called with a sentence
    where points are left out or the unit is probably another one. Raises ConfigError when an option is impossible,
    MapError when the file cannot be read or has no points.
    """
    path = Path(path)
    origin, unit = _viewpoint(path, viewpoint), _unit(path, unit_m)
    columns, seen_from = (read_ply(path), None) if path.name.lower().endswith(".ply") else read_pcd(path)
    if missing := [axis for axis in "xyz" if axis not in columns]:
        known = ", ".join(columns) or "none"
        raise MapError(f"{path.name} has no {' and no '.join(missing)}: its fields are {known}")
    cloud = cloud_of(_scaled(columns, unit), origin)
    if not len(cloud.points_m):
        lost = f": none of its {cloud.dropped} points is finite and away from the sensor" if cloud.dropped else ""
        raise MapError(f"{path.name} has no points{lost}")
    if warn:
        _warn(path, cloud, None if origin is not None else seen_from, warn)
    return cloud


def _warn(path: Path, cloud: Cloud, seen_from: SeenFrom, warn: Warn) -> None:
    if seen_from is not None:
        place = ", ".join(f"{value:g}" for value in seen_from[:3])
        warn(
            f"{path.name} says that it was seen from ({place}) and its points are taken as they stand: if it is a "
            f"single sweep and they are in one frame with that place, give viewpoint: [{place}], so that free space is "
            "known"
        )
    if cloud.dropped:
        warn(f"{path.name}: {cloud.dropped} points are left out, which are not finite or where the sensor is")
    across = float(np.ptp(cloud.points_m, axis=0).max())
    if across > _LARGE_M:
        warn(f"{path.name} is {across:.0f} m across: are its numbers metres (unit_m)?")


def _scaled(columns: Columns, unit_m: float) -> Columns:
    if unit_m == 1.0:
        return columns
    return {**columns, **{axis: np.asarray(columns[axis]).astype(np.float64) * unit_m for axis in "xyz"}}


def _viewpoint(path: Path, given: Sequence[float] | None) -> tuple[float, float, float] | None:
    if given is None:
        return None
    try:
        x, y, z = (float(value) for value in given)
    except (TypeError, ValueError):
        raise ConfigError(f"the viewpoint of {path.name} must be three numbers, x, y, z, found {given!r}") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise ConfigError(f"the viewpoint of {path.name} must be finite, found {given!r}")
    return x, y, z


def _unit(path: Path, given: float) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not (math.isfinite(given) and given > 0):
        raise ConfigError(f"unit_m of {path.name} must be above 0 m, found {given!r}")
    return float(given)
