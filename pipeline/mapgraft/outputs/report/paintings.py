"""Pictures of maps and of two maps held against each other, in colours that also colour-blind eyes tell apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.outputs.report.rasters import FREE, OCCUPIED, UNKNOWN, Cells
from mapgraft.pages import Picture, picture

Mask = NDArray[np.bool_]
Painted = NDArray[np.uint8]  # (h, w) index into a palette, row 0 at the smallest y; where cells share a pixel the
# greatest index shows, so that palettes begin with what matters least

LARGEST_PX: Final = 620  # of a picture's longer side
_SMALLEST_PX: Final = 320
_FINE: Final = (
    300  # cells along the longer side: from so many on a cell is so small that contradictions are drawn wider
)

# The paper behind a picture shows where nothing is known.
MAP: Final = np.array([(0, 0, 0, 0), (255, 255, 255, 255), (28, 31, 37, 255)], np.uint8)
FUSED: Final = np.array(
    [
        (0, 0, 0, 0),  # unknown
        (255, 255, 255, 255),  # free in its own map
        (255, 226, 196, 255),  # free, from others
        (28, 31, 37, 255),  # wall in its own map
        (214, 98, 0, 255),  # wall, from others
    ],
    np.uint8,
)
OVERLAY: Final = np.array(
    [
        (0, 0, 0, 0),  # unknown
        (206, 227, 245, 255),  # free in the receiver's map only
        (255, 226, 196, 255),  # free in the donor's map only
        (255, 255, 255, 255),  # free in both
        (28, 31, 37, 255),  # walls of both
        (0, 98, 168, 255),  # walls of the receiver only
        (224, 108, 0, 255),  # walls of the donor only
    ],
    np.uint8,
)
DIFFERENCE: Final = np.array(
    [
        (0, 0, 0, 0),  # unknown
        (228, 230, 233, 255),  # known to one of them only
        (190, 226, 214, 255),  # both say free
        (240, 196, 120, 255),  # they differ at the edge of a wall that both have
        (28, 31, 37, 255),  # both say wall
        (126, 47, 142, 255),  # wall for the receiver, free for the donor
        (205, 38, 18, 255),  # free for the receiver, wall for the donor
    ],
    np.uint8,
)


@dataclass(frozen=True, slots=True)
class Agreement:
    """How two maps lie to each other, counted in cells of ``cell_m``: what both know, and what of it contradicts.

    ``edge`` are those of the contradicting cells next to which both have a wall: that is how a grid's cells fall, and
    hardly a contradiction.
    """

    joint: int
    free: int
    occupied: int
    against: int
    edge: int
    cell_m: float

    @property
    def joint_m2(self) -> float:
        return self.joint * self.cell_m**2

    def percent(self, n: int) -> str:
        return f"{100.0 * n / self.joint:.1f} %" if self.joint else "–"


def map_picture(cells: Cells, cell_m: float, alt: str) -> Picture:
    return _shown(cells, MAP, cell_m, alt)


def fused_picture(own: Cells, fused: Cells, cell_m: float, alt: str) -> Picture:
    """What the robot knows with its merges. From others came what its own map does not know, and walls of which it has
    none nearby."""
    painted = np.zeros(fused.shape, np.uint8)
    painted[fused == FREE] = 2
    painted[(fused == FREE) & (own != UNKNOWN)] = 1
    painted[fused == OCCUPIED] = 4
    painted[(fused == OCCUPIED) & near(own == OCCUPIED)] = 3
    return _shown(painted, FUSED, cell_m, alt)


def overlay_picture(own: Cells, donor: Cells, cell_m: float, alt: str) -> Picture:
    """Both maps on each other; walls that lie within a cell of each other are walls of both."""
    painted = np.zeros(own.shape, np.uint8)
    painted[own == FREE] = 1
    painted[donor == FREE] = 2
    painted[(own == FREE) & (donor == FREE)] = 3
    mine, theirs = own == OCCUPIED, donor == OCCUPIED
    painted[mine], painted[theirs] = 5, 6
    painted[(mine & near(theirs)) | (theirs & near(mine))] = 4
    return _shown(painted, OVERLAY, cell_m, alt)


def difference_picture(own: Cells, donor: Cells, cell_m: float, alt: str) -> tuple[Picture, Agreement]:
    """Where both know something: whether they agree. With the counts, which are of cells and not of what is drawn."""
    joint = (own != UNKNOWN) & (donor != UNKNOWN)
    free, occupied = joint & (own == FREE) & (donor == FREE), joint & (own == OCCUPIED) & (donor == OCCUPIED)
    against = joint & (own != donor)
    edge = against & near(own == OCCUPIED) & near(donor == OCCUPIED)
    painted = np.zeros(own.shape, np.uint8)
    painted[(own != UNKNOWN) != (donor != UNKNOWN)] = 1
    painted[free] = 2
    painted[occupied] = 4
    painted[edge] = 3
    clear = against & ~edge
    for kind, index in ((own, 5), (donor, 6)):
        cells = clear & (kind == OCCUPIED)
        painted[near(cells) & joint if max(own.shape) >= _FINE else cells] = index
    n_joint, n_free, n_occupied, n_against, n_edge = (
        int(np.count_nonzero(mask)) for mask in (joint, free, occupied, against, edge)
    )
    counted = Agreement(n_joint, n_free, n_occupied, n_against, n_edge, cell_m)
    return _shown(painted, DIFFERENCE, cell_m, alt), counted


def near(mask: Mask) -> Mask:
    """The cells of a mask and all that touch them, also at a corner."""
    wide = mask.copy()
    wide[:, 1:] |= mask[:, :-1]
    wide[:, :-1] |= mask[:, 1:]
    out = wide.copy()
    out[1:] |= wide[:-1]
    out[:-1] |= wide[1:]
    return out


def colour(palette: NDArray[np.uint8], index: int) -> str:
    """A colour of a palette as CSS has it."""
    r, g, b, a = palette[index].tolist()
    return f"#{r:02x}{g:02x}{b:02x}" if a else "var(--unknown)"


def _shown(painted: Painted, palette: NDArray[np.uint8], cell_m: float, alt: str) -> Picture:
    """Upright, in as many pixels as a page can show: large ones are reduced, small ones enlarged."""
    longest = max(painted.shape)
    less = math.ceil(longest / LARGEST_PX)
    if less > 1:
        painted = _reduced(painted, less)
    more = max(1, math.ceil(_SMALLEST_PX / max(painted.shape)))
    pixels = np.repeat(np.repeat(painted[::-1], more, axis=0), more, axis=1)
    return picture(pixels, alt, palette, pixel_m=cell_m * less / more)


def _reduced(painted: Painted, times: int) -> Painted:
    h, w = (-(-side // times) * times for side in painted.shape)
    padded = np.zeros((h, w), np.uint8)
    padded[: painted.shape[0], : painted.shape[1]] = painted
    out = padded[::times, ::times].copy()
    for row in range(times):
        for column in range(times):
            np.maximum(out, padded[row::times, column::times], out=out)
    return out
