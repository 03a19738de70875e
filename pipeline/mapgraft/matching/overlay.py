"""A picture of two maps on each other, in colours that also colour-blind eyes tell apart."""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points
from mapgraft.matching.placing import Sketch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = NDArray[np.uint8]  # (h, w) index into COLOURS, row 0 at the smallest y

UNKNOWN, FREE, OURS, THEIRS, BOTH = range(5)
COLOURS: Final = np.array(  # walls: blue and orange of Okabe and Ito's palette, which differ for every kind of eye
    [(0.80, 0.80, 0.80), (1.0, 1.0, 1.0), (0.0, 0.45, 0.70), (0.90, 0.45, 0.0), (0.0, 0.0, 0.0)]
)
SMALLEST_PX: Final = 900  # of the longer side; small maps are shown with several pixels per cell
LARGEST_PX: Final = 2600  # large ones with several cells per pixel, in which a wall always shows
_DPI: Final = 100
_EDGE: Final = 0.03  # of the longer side: so much unknown space around the maps, so that no wall lies on the frame
_MARGIN_PX: Final = (70, 105, 20, 45)  # left, bottom, right, top: axes in metres, legend, title
_LEAST_PX: Final = 560  # of the shorter side, so that the legend has room
_LONGEST_NAME: Final = 32
_NEAR_CELLS: Final = 1.0  # walls as near as this, in the coarser map's cells, agree


@dataclass(frozen=True, slots=True)
class Canvas:
    """Where a picture lies in the receiver's frame: its lower-left corner, the side of a cell, rows and columns."""

    x_m: float
    y_m: float
    side_m: float
    rows: int
    columns: int

    def cells(self, points_m: Points) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column of each point; all must lie on the canvas."""
        columns = np.floor((points_m[:, 0] - self.x_m) / self.side_m).astype(np.intp)
        rows = np.floor((points_m[:, 1] - self.y_m) / self.side_m).astype(np.intp)
        return np.clip(rows, 0, self.rows - 1), np.clip(columns, 0, self.columns - 1)


def paint(ours: Sketch, theirs: Sketch) -> tuple[Picture, Canvas]:
    """Free space, walls of one and of both; walls that lie within a cell of the coarser map agree."""
    from scipy.ndimage import binary_dilation

    canvas = canvas_of(ours, theirs)
    shape = (canvas.rows, canvas.columns)
    free, wall = np.zeros(shape, np.bool_), [np.zeros(shape, np.bool_) for _ in range(2)]
    for points in (ours.free_m, theirs.free_m):
        free[canvas.cells(points)] = True
    for mask, points in zip(wall, (ours.walls_m, theirs.walls_m), strict=True):
        mask[canvas.cells(points)] = True
    coarser_m = max(side for side in (ours.cell_m, theirs.cell_m, canvas.side_m) if side is not None)
    reach = max(1, round(_NEAR_CELLS * coarser_m / canvas.side_m))
    near = [binary_dilation(mask, np.ones((2 * reach + 1,) * 2)) for mask in wall]
    picture = np.where(free, FREE, UNKNOWN).astype(np.uint8)
    picture[wall[0]], picture[wall[1]] = OURS, THEIRS
    picture[(wall[0] & near[1]) | (wall[1] & near[0])] = BOTH
    return picture, canvas


def canvas_of(ours: Sketch, theirs: Sketch) -> Canvas:
    """The rectangle around both maps, with the receiver's cells or as many of them to a cell as it takes."""
    points = np.concatenate((ours.walls_m, ours.free_m, theirs.walls_m, theirs.free_m))
    low, high = points.min(axis=0), points.max(axis=0)
    extent_m = float((high - low).max())
    side_m = ours.cell_m or max(extent_m, 1.0) / SMALLEST_PX
    side_m *= max(1, math.ceil(extent_m / side_m / LARGEST_PX))
    first = ours.walls_m if ours.cell_m is None else np.concatenate((ours.walls_m, ours.free_m))
    half = (ours.cell_m or side_m) / 2.0
    corner = first.min(axis=0) - half  # a corner of the receiver's cells
    x_m, y_m = (corner - np.ceil((corner - (low - side_m)) / side_m) * side_m).tolist()
    columns, rows = (np.floor((high - (x_m, y_m)) / side_m).astype(int) + 2).tolist()
    return Canvas(x_m, y_m, side_m, rows, columns)


def png(picture: Picture, canvas: Canvas, title: str, names: tuple[str, str]) -> bytes:
    """The picture with axes in metres, a title and a legend, as PNG: equal pictures give equal bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    picture, canvas = _framed(picture, canvas)
    times = max(1, math.ceil(SMALLEST_PX / max(picture.shape)))
    wide, high = (max(_LEAST_PX, side * times) for side in (canvas.columns, canvas.rows))
    left, bottom, right, top = _MARGIN_PX
    width, height = left + wide + right, bottom + high + top
    figure = Figure((width / _DPI, height / _DPI), dpi=_DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((left / width, bottom / height, wide / width, high / height))
    x1, y1 = canvas.x_m + canvas.columns * canvas.side_m, canvas.y_m + canvas.rows * canvas.side_m
    axes.imshow(COLOURS[picture], origin="lower", interpolation="nearest", extent=(canvas.x_m, x1, canvas.y_m, y1))
    axes.set_facecolor(COLOURS[UNKNOWN])
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(title, loc="left", fontsize=10, parse_math=False)
    axes.tick_params(color="0.5")
    axes.spines[:].set_color("0.5")
    _legend(figure, names)
    with warnings.catch_warnings(), io.BytesIO() as stream:
        warnings.simplefilter("ignore")  # of letters in a file's name that the font does not have
        figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
        return stream.getvalue()


def _framed(picture: Picture, canvas: Canvas) -> tuple[Picture, Canvas]:
    """The same with unknown space around."""
    cells = math.ceil(_EDGE * max(picture.shape))
    edge_m = cells * canvas.side_m
    rows, columns = canvas.rows + 2 * cells, canvas.columns + 2 * cells
    framed = Canvas(canvas.x_m - edge_m, canvas.y_m - edge_m, canvas.side_m, rows, columns)
    return np.pad(picture, cells, constant_values=UNKNOWN), framed


def _legend(figure: Figure, names: tuple[str, str]) -> None:
    from matplotlib.patches import Patch

    ours, theirs = (name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…" for name in names)
    said = {  # column by column: walls above, space below
        OURS: f"walls of {ours} only",
        FREE: "free",
        THEIRS: f"walls of {theirs} only",
        UNKNOWN: "unknown",
        BOTH: "walls of both",
    }
    patches = [
        Patch(facecolor=COLOURS[kind], edgecolor="0.4", linewidth=0.5, label=text) for kind, text in said.items()
    ]
    legend = figure.legend(handles=patches, loc="lower center", ncols=3, frameon=False, fontsize=9)
    for text in legend.get_texts():
        text.set_parse_math(False)
