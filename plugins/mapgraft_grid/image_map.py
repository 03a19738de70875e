"""Ready-made maps as bare images: grays as map savers write them, the size of the cells told beside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from mapgraft.contracts import ConfigError, GridMessage, MapError, Transform
from mapgraft_grid.images import Gray, read_gray
from mapgraft_grid.map_server import FREE_THRESH, OCCUPIED_THRESH, Cells, Warn

LARGEST: Final = 100_000_000  # pixels; 2 GB while it is read
_MOST_COLOURED: Final = 0.01  # share of the pixels; more is no map in grays
_FEW_FREE: Final = 0.001  # share of the pixels; less is probably a map whose grays mean something else


def read(
    path: str | Path,
    *,
    resolution_m: float | None = None,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    unknown_gray: int | None = None,
    negate: bool = False,
    warn: Warn | None = None,
    most_cells: int = LARGEST,
) -> GridMessage:
    """The map in an image: dark is occupied, light is free, what lies between (205, say) or is transparent is unknown.

    ``resolution_m`` is the side of a pixel and must be told. ``origin`` is x, y (m) and yaw (rad) of the image's
    lower-left corner in the map frame. Grays are read as map_server does in its mode ``trinary``, with occupied above
    0.65 and free below 0.196; ``negate`` turns dark and light around, and ``unknown_gray`` is the gray, as in the
    image, that means unknown whatever the thresholds say. ``warn`` is called with a sentence when hardly anything is
    free; an image of more than ``most_cells`` is not looked at. Raises ConfigError when an option is missing or
    impossible, MapError when the image cannot be used.
    """
    path = Path(path)
    side_m, pose = _resolution(path, resolution_m), _origin(path, origin)
    if unknown_gray is not None and (isinstance(unknown_gray, bool) or unknown_gray not in range(256)):
        raise ConfigError(f"unknown_gray must be a whole number in 0 … 255, found {unknown_gray!r}")
    gray = read_gray(path, min(most_cells, LARGEST))
    if gray.coloured > _MOST_COLOURED:
        raise MapError(
            f"the image {path.name} is in colour ({100 * gray.coloured:.0f} % of its pixels): a map must be in grays, "
            "dark where it is occupied and light where it is free; convert it first"
        )
    cells = _cells(gray, negate, unknown_gray)
    free = np.count_nonzero(cells == 0)
    if warn and free < _FEW_FREE * cells.size:
        warn(
            f"{path.name} shows hardly any free space ({free} of {cells.size} pixels are lighter than gray "
            f"{255 * (1 - FREE_THRESH):.0f}): are its grays those of a map, or turned around (negate)?"
        )
    return GridMessage(np.ascontiguousarray(cells[::-1]), side_m, pose)


def _cells(gray: Gray, negate: bool, unknown_gray: int | None) -> Cells:
    """The cells in the image's order."""
    occupancy = gray.levels / 255.0
    if not negate:
        np.subtract(1.0, occupancy, out=occupancy)
    cells = np.full(gray.raw.shape, -1, np.int8)
    cells[occupancy > OCCUPIED_THRESH] = 100
    cells[occupancy < FREE_THRESH] = 0
    cells[~gray.opaque] = -1
    if unknown_gray is not None:
        cells[gray.raw == unknown_gray] = -1
    return cells


def _resolution(path: Path, given: float | None) -> float:
    if given is None:
        beside = next((path.with_suffix(s) for s in (".yaml", ".yml") if path.with_suffix(s).is_file()), None)
        described = f", or name {beside.name}, which may describe it" if beside else ""
        raise ConfigError(
            f"{path.name} is an image, which does not say how large its cells are: tell it in a configuration, "
            f"robots: {{{path.stem}: {{options: {{resolution_m: 0.05}}}}}}{described}"
        )
    if isinstance(given, bool) or not isinstance(given, int | float) or not (math.isfinite(given) and given > 0):
        raise ConfigError(f"the resolution of {path.name} must be above 0 m per pixel, found {given!r}")
    return float(given)


def _origin(path: Path, given: Sequence[float]) -> Transform:
    try:
        x_m, y_m, yaw_rad = (float(value) for value in given)
    except (TypeError, ValueError):
        raise ConfigError(f"the origin of {path.name} must be three numbers, x, y, yaw, found {given!r}") from None
    return Transform.planar(x_m, y_m, yaw_rad)
