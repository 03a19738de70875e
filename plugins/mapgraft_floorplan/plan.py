"""A floor plan as a file tells it: pieces of wall, and whether their unit is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Transform

NAME: Final = "floor_plan"  # of the map type
PLAN: Final = "floor_plan"  # payload kind
MOST_SEGMENTS: Final = 1_000_000
NOMINAL_M: Final = 40.0  # how far across a plan of unknown scale is taken to be, until a match tells better
_FARTHEST_M: Final = 1e6
_HERE: Final = Transform.identity()

Segments = NDArray[np.float64]  # (n, 4) x0, y0, x1, y1

NO_WALLS: Final[Segments] = np.empty((0, 4))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Walls as straight pieces: ``segments_m`` (n, 4) x0, y0, x1, y1 in metres in the plan's frame, y upwards.

    Where ``scale_known`` is False the metres are nominal: the walls reach ``NOMINAL_M`` across, whatever they measure.
    Of a plan that was read from an image ``shape_px`` is its height and width, ``resolution_m`` the side of a pixel in
    these metres and ``T_map_origin`` where its lower-left corner lies.
    """

    segments_m: Segments
    scale_known: bool = True
    shape_px: tuple[int, int] | None = None
    resolution_m: float = 0.0
    T_map_origin: Transform = _HERE


def plan_of(segments: Segments, unit_m: float | None, what: str) -> Plan:
    """The plan of pieces of wall in units of ``unit_m`` metres, None where nobody knows how long a unit is.

    Pieces without length are left out. Raises MapError, naming ``what``, when there are none, too many, or they are not
    finite or out of any building's proportion.
    """
    pieces = np.ascontiguousarray(segments, np.float64).reshape(-1, 4)
    require_few(len(pieces), what)
    if not np.isfinite(pieces).all():
        raise MapError(f"{what} has walls at places that are no finite numbers: export it again")
    pieces = pieces[(pieces[:, :2] != pieces[:, 2:]).any(axis=1)]
    if not len(pieces):
        raise MapError(f"{what} has no walls: it needs lines, outlines or dark pixels where walls are")
    low, high = pieces.reshape(-1, 2).min(axis=0), pieces.reshape(-1, 2).max(axis=0)
    if unit_m is None:
        unit_m, known = NOMINAL_M / float((high - low).max()), False
        pieces = pieces - np.tile(low, 2)
    else:
        known = True
    pieces = pieces * unit_m
    farthest_m = float(np.abs(pieces).max())
    if farthest_m > _FARTHEST_M:
        raise MapError(
            f"{what} has walls {farthest_m:.3g} m from its origin, at most {_FARTHEST_M:g} m can be used: "
            "check its unit, or move it nearer to the origin"
        )
    return Plan(pieces, known)


def require_few(count: int, what: str) -> None:
    """Raises MapError when these are more pieces of wall than a plan may have."""
    if count > MOST_SEGMENTS:
        raise MapError(
            f"{what} has more than {MOST_SEGMENTS} pieces of wall (at least {count}): select the layers that hold walls"
        )
