"""Raster plans: images in grays with or without a known scale, and map_server's descriptions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from mapgraft_floorplan.plan import Plan
from mapgraft_floorplan.tracing import plan_of_grid
from mapgraft_grid import image_map, map_server

_DESCRIBED: Final = (".yaml", ".yml")


def read(
    path: str | Path,
    *,
    resolution_m: float | None = None,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    unknown_gray: int | None = None,
    negate: bool = False,
    warn: Callable[[str], None] | None = None,
    most_cells: int = image_map.LARGEST,
) -> Plan:
    """The plan in an image: dark pixels are walls. Or the one that a YAML file of map_server describes.

    ``resolution_m`` is the side of a pixel; where nobody tells it the scale is unknown. The other options are those of
    the format ``image``, and so is ``most_cells``. Raises ConfigError when an option is impossible, MapError when the
    file cannot be used or nothing in it is dark.
    """
    path = Path(path)
    if path.suffix.lower() in _DESCRIBED:
        described = map_server.read(path, unknown_gray=unknown_gray, warn=warn, most_cells=most_cells)
        return plan_of_grid(described, f"the plan {path.name}")
    known = resolution_m is not None
    image = image_map.read(
        path,
        resolution_m=resolution_m if known else 1.0,
        origin=origin,
        unknown_gray=unknown_gray,
        negate=negate,
        most_cells=most_cells,
    )
    return plan_of_grid(image, f"the plan {path.name}", scale_known=known)
