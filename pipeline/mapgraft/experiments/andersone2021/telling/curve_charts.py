"""Charts of how well numbers tell wrong merges: curves, together and by resolutions, and the areas under them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.settings import METRICS
from mapgraft.experiments.andersone2021.telling.as_published import METRIC_NAMES, MOMENTS, shared_draws, ways_shown
from mapgraft.experiments.andersone2021.telling.detection import OURS, POOLED, WATCHED, Curve, groups
from mapgraft.experiments.andersone2021.telling.drawn import (
    BLUE,
    GREEN,
    MUTED,
    PURPLE,
    VERMILLION,
    Drawn,
    canvas,
    drawing,
    png_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FEW: Final = "There are too few merges for a curve: ask for more."
_LINES: Final = {"similarity": (BLUE, "-"), "distance": (VERMILLION, "--")} | dict(
    zip(OURS, ((BLUE, "-"), (GREEN, "--"), (PURPLE, "-.")), strict=True)
)
_WAY: Final = (
    "A perfect number goes through the upper left corner. In brackets: area under the curve. Our rules: what their "
    "verifier judges by, up to where it stopped."
)


def curves_figures(experiment: Experiment, curves: Sequence[Curve]) -> list[Drawn]:
    """The receiver operating characteristic of SM and DM and of our rules' evidence: together, and by resolutions."""
    in_the_end = [curve for curve in curves if curve.moment == "end"]
    names = [name for name in groups(experiment) if name != POOLED]
    together = f"After the further scans, all resolutions together. {_WAY} {shared_draws(experiment)}"
    apart = f"The same, one row for each combination of resolutions. {_WAY}"
    return [
        _curves("roc", "Which numbers tell wrong merges", together, experiment, in_the_end, [POOLED]),
        _curves("roc_by_resolution", "The same curves by resolutions", apart, experiment, in_the_end, names),
    ]


def _curves(
    name: str, title: str, caption: str, experiment: Experiment, curves: Sequence[Curve], rows: Sequence[str]
) -> Drawn:
    if not any(curve.group in rows for curve in curves):
        return Drawn(name, title, _FEW, None)
    panels = [*ways_shown(experiment).items(), (WATCHED, "our rules")]
    with drawing():
        figure = canvas(3.9 * len(panels), (3.8 if len(rows) == 1 else 3.0) * len(rows) + 0.3)
        axes = figure.subplots(len(rows), len(panels), sharex=True, sharey=True, squeeze=False)
        for line, group in zip(axes, rows, strict=True):
            for ax, (source, way) in zip(line, panels, strict=True):
                _panel(ax, [curve for curve in curves if (curve.group, curve.source) == (group, source)])
                ax.set_title(way if group == POOLED else f"{group}, {way}")
            line[0].set_ylabel("wrong merges found, %")
        for ax in axes[-1]:
            ax.set_xlabel("right merges called wrong, %")
        return Drawn(name, title, caption, png_of(figure))


def _panel(ax: Axes, curves: Sequence[Curve]) -> None:
    ax.plot((0.0, 100.0), (0.0, 100.0), color=MUTED, linewidth=0.7, linestyle=":")
    wanted = [number for curve in curves for number in (OURS if curve.source == WATCHED else METRICS)]
    drawn = [curve for number in dict.fromkeys(wanted) for curve in curves if curve.number == number]
    for place, curve in enumerate(drawn):
        colour, dashes = _LINES[curve.number]
        label = f"{_spoken(curve.number)} ({curve.area.value:.3f})"
        ax.plot(*(100.0 * curve.points.T), color=colour, linestyle=dashes, linewidth=3.4 - place, label=label)
    if drawn:
        ax.legend(loc="lower right")
    else:
        ax.text(0.5, 0.5, "too few merges have a number", ha="center", transform=ax.transAxes, color=MUTED)
    ax.set_xlim(-2.0, 102.0)
    ax.set_ylim(-2.0, 102.0)


def areas_figure(experiment: Experiment, curves: Sequence[Curve]) -> Drawn:
    """Areas under the curve with their intervals: SM and DM as merges are kept, and what our own rules look at."""
    title, ways = "How well each number tells wrong merges", ways_shown(experiment)
    found = {(c.number, c.source, c.moment): c for c in curves if c.group == POOLED and _is_shown(c, ways)}
    if not found:
        return Drawn("areas", title, _FEW, None)
    names = list(dict.fromkeys((number, source) for number, source, _ in found))
    ours = [name for name in names if name[1] == WATCHED]
    ours.sort(key=lambda name: -max(found[*name, at].area.value for at in MOMENTS if (*name, at) in found))
    rows = [name for name in names if name[1] != WATCHED] + ours
    with drawing():
        figure = canvas(8.6, 0.27 * len(rows) + 1.1)
        ax = figure.subplots()
        for place, name in enumerate(rows):
            for moment, colour, mark, shift in (("initial", MUTED, "o", -0.16), ("end", BLUE, "D", 0.16)):
                if (curve := found.get((*name, moment))) is not None:
                    ends = (curve.area.low, curve.area.high)
                    sure = ":" if curve.area.value in (0.0, 1.0) else "-"
                    ax.plot(ends, (place + shift,) * 2, color=colour, linewidth=1.6, linestyle=sure)
                    ax.plot(curve.area.value, place + shift, mark, color=colour, markersize=4.5)
        ax.axvline(0.5, color=MUTED, linewidth=0.7, linestyle=":")
        ax.set_yticks(range(len(rows)), [_row_name(*name, ways) for name in rows])
        ax.set_ylim(len(rows) - 0.5, -0.5)
        ax.set_xlabel("area under the curve (grey circle: at the merge, blue diamond: in the end)")
        caption = (
            "All resolutions together, with 95 % intervals. Above SM and DM, below the numbers that our own rules look "
            "at. One half is chance. Dotted: right and wrong do not overlap, so that only a cautious bound can be told."
            f" {shared_draws(experiment)}"
        )
        return Drawn("areas", title, caption, png_of(figure))


def _is_shown(curve: Curve, ways: Mapping[ReversalName, str]) -> bool:
    """Metrics as merges are kept, and numbers of our rules that are neither those again nor details."""
    if curve.source != WATCHED:
        return curve.source in ways
    return curve.number not in METRICS and ("." not in curve.number or curve.number.startswith("verifier."))


def _row_name(number: str, source: str, ways: Mapping[ReversalName, str]) -> str:
    for strategy, name in ways.items():
        if strategy == source:
            return f"{METRIC_NAMES[number]}, {name}"
    return _spoken(number)


def _spoken(number: str) -> str:
    return METRIC_NAMES.get(number) or number.replace("_", " ").replace(".", ": ")
