"""Figures of maps: a right merge, a wrong one, what is maintained, and what is left after the revert."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.experiments.andersone2021.outcome import Experiment, Kept, Leftovers
from mapgraft.experiments.andersone2021.protocol import Laboratory
from mapgraft.experiments.andersone2021.raster import OCCUPIED, Raster, left_masks, raster_of
from mapgraft.experiments.andersone2021.settings import SHORT, STRATEGIES
from mapgraft.experiments.andersone2021.telling.drawn import (
    BLUE,
    INK,
    ORANGE,
    PURPLE,
    VERMILLION,
    Drawn,
    canvas,
    drawing,
    png_of,
)
from mapgraft.experiments.andersone2021.telling.examples import Remade, remake, right_example, wrong_example
from mapgraft.pages import bar_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.transforms import Affine2D

Shades = NDArray[np.float64]  # (h, w, 4) RGBA in [0, 1], row 0 has the smallest y

UNKNOWN_SHADE: Final = 0.80
PAD_M: Final = 0.6  # around what is shown
SHAPES: Final = (0.5, 1.15)  # least and greatest height of a window over its width
BAR: Final = 0.3  # of the width: a scale bar is no longer
_NONE: Final = "There is no such merge in this experiment: ask for more merges, or take a longer recording."
LEFT: Final = {  # what a revert leaves: colour, and what it is called
    "lost": (VERMILLION, "lost: unknown now"),
    "alien": (BLUE, "known, would not be"),
    "changed": (PURPLE, "other class"),
    "touched": (ORANGE, "other probability only"),
}


def map_figures(experiment: Experiment, laboratory: Laboratory) -> list[Drawn]:
    """Figures 5, 7, 8 and 9; each says why where there is nothing to show."""
    right, wrong = right_example(experiment), wrong_example(experiment)
    figures = []
    title = "Figure 5: a right merge"
    if right is None:
        figures.append(Drawn("figure5", title, _NONE, None))
    else:
        figures.append(Drawn("figure5", title, right.why + _ORIGINALS, _originals(remake(laboratory, right))))
    titles = {
        "figure7": "Figure 7: a wrong merge that was accepted",
        "figure8": "Figure 8: the maps that are maintained",
        "figure9": "Figure 9: after the revert",
    }
    if wrong is None:
        return [*figures, *(Drawn(name, said, _NONE, None) for name, said in titles.items())]
    remade = remake(laboratory, wrong)
    figures.append(Drawn("figure7", titles["figure7"], wrong.why + _ORIGINALS, _originals(remade)))
    figures.append(Drawn("figure8", titles["figure8"], _MAINTAINED + _own_maps(remade), _maintained(remade)))
    figures.append(Drawn("figure9", titles["figure9"], _left_caption(remade), _reverted(remade)))
    return figures


_ORIGINALS: Final = (
    " Above the two original maps, below the merged map and the walls of both, where the merge puts them. White is "
    "free, black occupied, grey unknown."
)
_MAINTAINED: Final = (
    "The wrong merge of figure 7 after the further scans. Two maps keep the robot's own and the merged one; one map "
    "only the merged one, from which nobody can tell the donor's share any more. The ledger keeps every source apart: "
    "both maps are views of it. "
)


def _own_maps(remade: Remade) -> str:
    """Whether the robot's own map is the same in the ledger and in two maps, byte for byte."""
    own = [remade.map_type.encode(remade.mapped_on(way).compared_layer()) for way in ("multi_map", "ledger")]
    return f"The own maps of both have {'the same' if own[0] == own[1] else 'other'} bytes."


def _left_caption(remade: Remade) -> str:
    by = remade.example.merge.by
    one = by["single_map"]
    same = " and ".join(SHORT[s] for s in STRATEGIES if by[s].leftovers.identical)
    return (
        f"The same merge taken out again, beside the map of a robot that never merged ({one.leftovers.known:,} known "
        f"cells). One map: {one.leftovers.lost:,} cells lost, {one.exactness.cells_contaminated:,} left contaminated "
        f"by its own statement; {one.leftovers.touched:,} cells show something else than they would. The same bytes as "
        f"if it had never merged: {same or 'none'}."
    )


def _originals(remade: Remade) -> bytes:
    pair = remade.graft.pair
    own = raster_of(remade.map_type, pair.receiver.map)
    donor = raster_of(remade.donor_type, pair.donor.map)
    merged = raster_of(remade.map_type, remade.graft.merged("ledger").fused())
    placed = raster_of(remade.map_type, remade.map_type.view(remade.graft.contribution.layer))
    ours, theirs, all_of_it = own.joined(placed, merged)
    with drawing():
        figure = canvas(9.0, 9.0)
        (a, b), (c, d) = figure.subplots(2, 2)
        panels = [
            _show(a, own, shades(own), remade.yaw_rad, f"map 1, the receiver's: cells of {own.resolution_m:g} m"),
            _show(b, donor, shades(donor), remade.donor_yaw_rad, f"map 2, the donor's: {donor.resolution_m:g} m"),
            _show(c, merged, shades(merged), remade.yaw_rad, "merged"),
            _show(d, all_of_it, _walls(ours, theirs), remade.yaw_rad, "walls: map 1 blue, map 2 orange, both black"),
        ]
        shape = _same_scale(panels)
        figure.set_size_inches(9.0, 9.0 * shape + 0.5)
        return png_of(figure)


def _maintained(remade: Remade) -> bytes:
    """One map beside the others' two, which stand above each other."""
    with drawing():
        figure = canvas(11.5, 8.0)
        cells = figure.add_gridspec(4, 3)
        panels = []
        for column, strategy in enumerate(STRATEGIES):
            reversal, name = remade.mapped_on(strategy), SHORT[strategy]
            merged = raster_of(remade.map_type, reversal.fused())
            alone = strategy == "single_map"
            ax = figure.add_subplot(cells[1:3, column] if alone else cells[2:, column])
            title = f"{name}: merged map, no own one" if alone else f"{name}: merged map"
            panels.append(_show(ax, merged, shades(merged), remade.yaw_rad, title))
            if not alone:
                own = raster_of(remade.map_type, reversal.own())
                above = figure.add_subplot(cells[:2, column])
                panels.append(_show(above, own, shades(own), remade.yaw_rad, f"{name}: own map"))
        shape = _same_scale(panels)
        figure.set_size_inches(11.5, 11.5 * 2.0 / 3.0 * shape + 0.5)
        return png_of(figure)


def _reverted(remade: Remade) -> bytes:
    never = raster_of(remade.map_type, remade.graft.never_merged().fused())
    by = remade.example.merge.by
    with drawing():
        figure = canvas(11.5, 8.0)
        (a, b, c), (d, e, f) = figure.subplots(2, 3)
        panels = [_show(a, never, shades(never), remade.yaw_rad, "never merged")]
        for ax, strategy in zip((d, c, b), STRATEGIES, strict=True):
            after, before = raster_of(remade.map_type, remade.reverted(strategy)).joined(never)
            title = f"{SHORT[strategy]}, reverted: {_counted(by[strategy])}"
            panels.append(_show(ax, after, _marked(after, before), remade.yaw_rad, title))
            if strategy == "single_map":
                near = _show(e, after, _marked(after, before), remade.yaw_rad, "the same, nearer")
                near = near.around(left_anything(after, before))
        shape = _same_scale(panels)
        _same_scale([near], shape)
        _legend(f, by["single_map"].leftovers)
        figure.set_size_inches(11.5, 11.5 * 2.0 / 3.0 * shape + 0.5)
        return png_of(figure)


def _counted(kept: Kept) -> str:
    if kept.leftovers.identical:
        return "same bytes"
    return f"{kept.leftovers.lost:,} cells lost, {kept.exactness.cells_contaminated:,} contaminated"


def shades(raster: Raster) -> Shades:
    """The map in shades of grey: white is free, black occupied; the less is known the nearer to the unknown's grey."""
    odds = np.where(raster.percent < 0, 0.5, raster.percent / 100.0)
    free, occupied = 2.0 * np.clip(0.5 - odds, 0.0, 0.5), 2.0 * np.clip(odds - 0.5, 0.0, 0.5)
    grey = UNKNOWN_SHADE + (1.0 - UNKNOWN_SHADE) * free - UNKNOWN_SHADE * occupied
    return np.dstack([grey, grey, grey, np.ones_like(grey)])


def _walls(own: Raster, donor: Raster) -> Shades:
    """What either knows in light grey, the walls of each in its colour, and those of both in black."""
    out = np.ones((*own.percent.shape, 4))
    out[..., :3] = np.where(((own.percent < 0) & (donor.percent < 0))[..., None], UNKNOWN_SHADE, 0.97)
    ours, theirs = own.classes == OCCUPIED, donor.classes == OCCUPIED
    for where, colour in ((ours, BLUE), (theirs, ORANGE), (ours & theirs, INK)):
        out[where, :3] = _rgb(colour)
    return out


def left_anything(after: Raster, before: Raster) -> NDArray[np.bool_]:
    """The cells (h, w) that a revert left other than they would be."""
    found: NDArray[np.bool_] = np.any(list(left_masks(after, before).values()), axis=0)
    return found


def _marked(after: Raster, before: Raster) -> Shades:
    """A map after a revert, paler where it is as it would be, with what is left of the merge in colour."""
    out = shades(after)
    if not left_anything(after, before).any():
        return out
    known = after.percent >= 0
    out[known, :3] = 0.35 + 0.65 * out[known, :3]
    for name, mask in left_masks(after, before).items():
        strength = 0.6 if name == "touched" else 1.0
        out[mask, :3] = (1.0 - strength) * out[mask, :3] + strength * np.array(_rgb(LEFT[name][0]))
    return out


def _legend(ax: Axes, left: Leftovers) -> None:
    from matplotlib.patches import Patch

    rest = left.touched - left.lost - left.alien - left.changed
    counts = {"lost": left.lost, "alien": left.alien, "changed": left.changed, "touched": rest}
    handles = [Patch(color=LEFT[name][0], label=f"{LEFT[name][1]}: {count:,}") for name, count in counts.items()]
    ax.legend(handles=handles, loc="center left", title="1M after the revert, cells", alignment="left", fontsize=10)
    ax.axis("off")


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    return red, green, blue


@dataclass(frozen=True, slots=True, eq=False)
class _Panel:
    """A map on its axes, and the box around what is to be seen of it: (x0, y0), (x1, y1) in metres, turned."""

    ax: Axes
    raster: Raster
    turn: Affine2D
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    def around(self, cells: NDArray[np.bool_]) -> _Panel:
        """The same with the box around some cells (h, w), and around everything that is known if there are none."""
        y, x = np.nonzero(cells if cells.any() else self.raster.percent >= 0)
        left, _, bottom, _ = self.raster.extent_m
        size_m = self.raster.resolution_m
        places = self.turn.transform(np.stack((left + (x + 0.5) * size_m, bottom + (y + 0.5) * size_m), axis=1))
        return replace(self, low=places.min(axis=0), high=places.max(axis=0))


def _show(ax: Axes, raster: Raster, pixels: Shades, yaw_rad: float, title: str) -> _Panel:
    """Draw a map turned by an angle; its box is around what is known."""
    from matplotlib.transforms import Affine2D

    turn = Affine2D().rotate(yaw_rad)
    image = ax.imshow(pixels, origin="lower", extent=raster.extent_m, interpolation="nearest")
    image.set_transform(turn + ax.transData)
    ax.set_facecolor(str(UNKNOWN_SHADE))
    ax.set_title(title)
    ax.set_xticks([])
    ax.set_yticks([])
    ax.grid(visible=False)
    ax.spines[:].set_visible(True)
    nowhere = np.zeros(2)
    return _Panel(ax, raster, turn, nowhere, nowhere).around(raster.percent >= 0)


def _same_scale(panels: Sequence[_Panel], shape: float | None = None) -> float:
    """Give all maps windows of one size in metres, each around its own, and a scale bar.

    ``shape`` is the height of the windows over their width, by default as the maps need it, and returned.
    """
    width, height = np.max([panel.high - panel.low for panel in panels], axis=0) + 2.0 * PAD_M
    shape = float(np.clip(height / width, *SHAPES)) if shape is None else shape
    width, height = max(width, height / shape), max(height, width * shape)
    for panel in panels:
        x, y = (panel.low + panel.high) / 2.0 - np.array((width, height)) / 2.0
        panel.ax.set_xlim(x, x + width)
        panel.ax.set_ylim(y, y + height)
        panel.ax.set_aspect("equal")
        _bar(panel.ax, x, y, width, height)
    return shape


def _bar(ax: Axes, left: float, bottom: float, width: float, height: float) -> None:
    length = bar_m(BAR * width)
    x, y = left + 0.03 * width, bottom + 0.035 * height
    ax.plot((x, x + length), (y, y), color=INK, linewidth=2.5, solid_capstyle="butt")
    behind = {"facecolor": str(UNKNOWN_SHADE), "edgecolor": "none", "pad": 1.0, "alpha": 0.75}
    ax.text(x, y + 0.02 * height, f"{length:g} m", fontsize=8, va="bottom", color=INK, bbox=behind)
