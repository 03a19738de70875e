"""Matplotlib figures as parts of a page: text stays text, and colours follow the page into the dark."""

from __future__ import annotations

import hashlib
import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

# What a figure draws in these colours is drawn in the page's own, light or dark.
INK, MUTED, LINE, PAPER = "#1c1f25", "#5c6470", "#dfe2e6", "#fefefd"
SERIES: Final = ("#0062a8", "#c75b00", "#00795a", "#a33d7c", "#7a6a00", "#4b4fb8")  # for lines, in this order
_VARIABLES: Final = {
    INK: "var(--ink)",
    MUTED: "var(--muted)",
    LINE: "var(--line)",
    PAPER: "var(--paper)",
    **{colour: f"var(--series-{n})" for n, colour in enumerate(SERIES, start=1)},
}
_ID = re.compile(r'\sid="([^"]+)"')
_REFERENCE = re.compile(r'(url\(#|xlink:href="#|href="#)([^")]+)')


@contextmanager
def drawing() -> Iterator[None]:
    """Inside, matplotlib draws in the style of the pages. Build the whole figure inside."""
    import matplotlib as mpl
    from cycler import cycler

    style: dict[Any, Any] = {
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "axes.prop_cycle": cycler(color=SERIES),
        "axes.edgecolor": MUTED,
        "axes.labelcolor": INK,
        "axes.titlecolor": INK,
        "axes.titlesize": 10,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "grid.color": LINE,
        "grid.linewidth": 0.8,
        "text.color": INK,
        "text.parse_math": False,
        "xtick.color": MUTED,
        "ytick.color": MUTED,
        "legend.frameon": False,
        "legend.fontsize": 9,
        "font.size": 9,
        "font.family": "sans-serif",
        "lines.linewidth": 1.6,
        "svg.fonttype": "none",
        "svg.hashsalt": "mapgraft",
    }
    with mpl.rc_context(style):
        yield


def svg(figure: Figure) -> Markup:
    """The figure as an ``<svg>`` element to put into a page; equal figures give equal bytes.

    It takes the width that it gets and keeps its proportions. Say in a caption beside it what it shows.
    """
    from markupsafe import Markup

    stream = io.StringIO()
    with drawing(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of letters in names that the font does not have: the page has its own font
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r'^<svg[^>]*?(viewBox="[^"]+")[^>]*>', r'<svg class="chart" role="img" \1>', text)
    text = re.sub(r"<style[^>]*>.*?</style>\s*", "", text, flags=re.DOTALL)  # it would hold for the whole page
    text = re.sub(r"font: ([^;'\"]*?)'[^;\"]*", r"font: \1var(--sans)", text)
    text = re.sub(r"font-family: '[^;\"]*", "font-family: var(--sans)", text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, variable)
    return Markup(_own_ids(text))


def _own_ids(text: str) -> str:
    """Only ids that something refers to, under names that no other figure of the page has."""
    prefix = "c" + hashlib.blake2b(text.encode(), digest_size=6).hexdigest()
    wanted = {name for _, name in _REFERENCE.findall(text)}
    text = _ID.sub(lambda m: f' id="{prefix}-{m[1]}"' if m[1] in wanted else "", text)
    return _REFERENCE.sub(lambda m: f"{m[1]}{prefix}-{m[2]}", text)
