"""Figures as PNG files: one style, the same bytes from the same values."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

# M. Okabe and K. Ito, Color universal design: told apart by people who see fewer colours.
BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY, YELLOW = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#F0E442",
)
INK, MUTED, LINE = "#1c1f25", "#5c6470", "#dfe2e6"
DPI: Final = 150


@dataclass(frozen=True, slots=True)
class Drawn:
    """A figure: its name in files, its title and caption, and the PNG, None where there is nothing to show.

    The caption then says why. ``timed`` figures depend on the clock.
    """

    name: str
    title: str
    caption: str
    png: bytes | None
    timed: bool = False


@contextmanager
def drawing() -> Iterator[None]:
    """Inside, matplotlib draws in the style of these figures."""
    import matplotlib as mpl

    style: dict[Any, Any] = {
        "figure.facecolor": "white",
        "savefig.facecolor": "white",
        "axes.facecolor": "white",
        "axes.edgecolor": MUTED,
        "axes.labelcolor": INK,
        "axes.titlecolor": INK,
        "axes.titlesize": 10,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": LINE,
        "grid.linewidth": 0.7,
        "text.color": INK,
        "text.parse_math": False,
        "xtick.color": MUTED,
        "ytick.color": MUTED,
        "legend.frameon": False,
        "legend.fontsize": 8.5,
        "font.size": 9,
        "font.family": "DejaVu Sans",  # it comes with matplotlib: the same letters everywhere
        "hatch.linewidth": 0.6,
    }
    with mpl.rc_context(style):
        yield


def canvas(width_in: float, height_in: float) -> Canvas:
    """An empty figure that lays its parts out by itself."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def png_of(figure: Canvas) -> bytes:
    """The figure as a file, without date and software."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()
