"""Maps of examples as small pictures whose palette holds what they say, in colours that the colour-blind tell apart."""

from __future__ import annotations

import io
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.outputs.report.paintings import near
from mapgraft.outputs.report.rasters import FREE, OCCUPIED, UNKNOWN, Canvas, Cells, Raster
from mapgraft.pages import png

LARGEST_PX: Final = 512  # of the longer side of a whole map

_UNKNOWN = (206, 209, 214, 0)  # transparent; grey for who cannot show that
_FREE = (255, 255, 255, 255)
_RECEIVER, _DONOR, _BOTH = (0, 98, 168, 255), (224, 108, 0, 255), (28, 31, 37, 255)  # walls
OWN: Final = np.array([_UNKNOWN, _FREE, _RECEIVER], np.uint8)
DONOR: Final = np.array([_UNKNOWN, _FREE, _DONOR], np.uint8)
OVERLAY: Final = np.array([(*_UNKNOWN[:3], 255), _FREE, _RECEIVER, _DONOR, _BOTH], np.uint8)

RECEIVER_ONLY, DONOR_ONLY, BOTH = 2, 3, 4  # walls in an overlay, after UNKNOWN and FREE


def reduced(raster: Raster, most_px: int = LARGEST_PX) -> Raster:
    """The same map with at most ``most_px`` cells along its longer side; where cells fall together, walls show."""
    times = math.ceil(max(raster.cells.shape) / most_px)
    if times <= 1:
        return raster
    rows, columns = (-(-side // times) for side in raster.cells.shape)
    canvas = Canvas(raster.x_m, raster.y_m, raster.cell_m * times, rows, columns)
    return Raster(canvas.cells_of(raster), raster.x_m, raster.y_m, canvas.cell_m)


def map_png(cells: Cells, palette: NDArray[np.uint8]) -> bytes:
    """A map as PNG, one pixel per cell, the greatest y at the top; equal cells give equal bytes."""
    return png(np.ascontiguousarray(cells[::-1]), palette)


def overlay_png(own: Cells, donor: Cells) -> bytes:
    """Two maps on each other as PNG; walls that lie within a cell of each other are walls of both."""
    mine, theirs = own == OCCUPIED, donor == OCCUPIED
    both = (mine & near(theirs)) | (theirs & near(mine))
    painted = np.where((own == FREE) | (donor == FREE), FREE, UNKNOWN).astype(np.uint8)
    painted[mine], painted[theirs] = RECEIVER_ONLY, DONOR_ONLY
    painted[both] = BOTH
    return map_png(painted, OVERLAY)


def cells_of(data: bytes) -> Cells:
    """What a picture of ours says, pixel by pixel, row 0 at the smallest y: indices into its palette."""
    from PIL import Image

    with Image.open(io.BytesIO(data)) as image:
        return np.ascontiguousarray(np.asarray(image, np.uint8)[::-1])
