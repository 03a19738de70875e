"""Charts: histograms of SM and DM, how DM moves with the resolution, what an update costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.settings import METRICS, SHORT, STRATEGIES, Combination
from mapgraft.experiments.andersone2021.telling.as_published import COSTS, KINDS, METRIC_NAMES, of, ratio, ways_shown
from mapgraft.experiments.andersone2021.telling.detection import Curve, Values, metric_values
from mapgraft.experiments.andersone2021.telling.drawn import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    SKY,
    VERMILLION,
    Drawn,
    canvas,
    drawing,
    png_of,
)
from mapgraft.experiments.andersone2021.telling.published import published

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS: Final = 16
COLOURS: Final = {"right": BLUE, "wrong": VERMILLION}


def histograms(experiment: Experiment, curves: Sequence[Curve]) -> list[Drawn]:
    """Figure 6 for the first combination, with SM and with two maps beside it, and the same for all of them."""
    name, ways = experiment.settings.combinations[0].name, ways_shown(experiment)
    same = "" if "ledger" in ways else " With the ledger all numbers are those of two maps."
    both = (
        f"SM and DM after the further scans, right and wrong merges, {name}. The paper shows DM with one map (below, "
        f"left). Dashed: the best threshold. Where bars of both kinds lie on each other their "
        f"colours mix to brown.{same}"
    )
    everything = "The same for all resolutions, one row each. Scales differ from panel to panel."
    return [
        Drawn("figure6", f"Figure 6: SM and DM of right and wrong merges at {name}", both, _six(experiment, curves)),
        Drawn("figure6_all", "Figure 6 for all resolutions", everything, _all_six(experiment, curves)),
    ]


def _six(experiment: Experiment, curves: Sequence[Curve]) -> bytes:
    ways = ways_shown(experiment)
    with drawing():
        figure = canvas(4.5 * len(ways), 5.6)
        axes = figure.subplots(2, len(ways), squeeze=False)
        for row, metric in zip(axes, METRICS, strict=True):
            for ax, (strategy, title) in zip(row, ways.items(), strict=True):
                _histogram(ax, experiment, experiment.settings.combinations[0], metric, strategy, curves)
                ax.set_title(f"{METRIC_NAMES[metric]}, {title}")
                ax.set_xlabel("share of equal cells" if metric == "similarity" else "cells of the receiver's grid")
            row[0].set_ylabel("merges")
        axes[0][0].legend()
        return png_of(figure)


def _all_six(experiment: Experiment, curves: Sequence[Curve]) -> bytes:
    combinations, ways = experiment.settings.combinations, ways_shown(experiment)
    kinds = [(metric, strategy) for metric in METRICS for strategy in ways]
    with drawing():
        figure = canvas(2.9 * len(kinds), 2.3 * len(combinations) + 0.4)
        axes = figure.subplots(len(combinations), len(kinds), squeeze=False)
        for place, (row, combination) in enumerate(zip(axes, combinations, strict=True)):
            for ax, (metric, strategy) in zip(row, kinds, strict=True):
                _histogram(ax, experiment, combination, metric, strategy, curves)
                ax.set_title(f"{METRIC_NAMES[metric]}, {ways[strategy]}" if place == 0 else "")
            row[0].set_ylabel(f"{combination.name}\nmerges")
        axes[0][0].legend()
        return png_of(figure)


def _histogram(
    ax: Axes,
    experiment: Experiment,
    combination: Combination,
    metric: str,
    strategy: ReversalName,
    curves: Sequence[Curve],
) -> None:
    from matplotlib.ticker import MaxNLocator

    values = {kind: _there(experiment, combination, right, metric, strategy) for kind, right in KINDS.items()}
    together = np.concatenate(list(values.values()))
    if not together.size:
        ax.text(0.5, 0.5, "no merges", ha="center", transform=ax.transAxes, color=MUTED)
        return
    low, high = (0.0 if metric == "distance" else float(together.min())), float(together.max())
    bins: list[float] = np.linspace(low, high if high > low else low + 1.0, BINS + 1).tolist()
    for kind, hatch in (("right", ""), ("wrong", "////")):
        label = f"{kind} ({values[kind].size})"
        ax.hist(
            values[kind],
            bins=bins,
            color=COLOURS[kind],
            alpha=0.62,
            hatch=hatch,
            edgecolor="white",
            label=label,
            lw=0.5,
        )
    ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    for curve in curves:
        if (curve.number, curve.moment, curve.source, curve.group) == (metric, "end", strategy, combination.name):
            ax.axvline(curve.threshold.value, color=INK, linestyle="--", linewidth=1.0)


def _there(
    experiment: Experiment, combination: Combination, right: bool, metric: str, strategy: ReversalName
) -> Values:
    values = metric_values(of(experiment, combination, right), metric, "end", strategy)
    return values[~np.isnan(values)]


def resolution_figure(experiment: Experiment, curves: Sequence[Curve]) -> Drawn:
    """DM with two maps by resolutions, in cells and in metres, with the best threshold of each."""
    combinations = experiment.settings.combinations
    with drawing():
        figure = canvas(9.5, 4.0)
        axes = figure.subplots(1, 2)
        for ax, unit in zip(axes, ("cells of the receiver's grid", "metres"), strict=True):
            for place, combination in enumerate(combinations):
                factor = 1.0 if ax is axes[0] else combination.own_m
                _strip(ax, experiment, combination, place, factor)
                for curve in curves:
                    key = (curve.number, curve.moment, curve.source, curve.group)
                    if key == ("distance", "end", "multi_map", combination.name):
                        level = curve.threshold.value * factor
                        ax.hlines(level, place - 0.38, place + 0.38, color=INK, linestyle="--", linewidth=1.2)
            _logarithmic(ax)
            ax.set_title(f"DM in {unit}")
            ax.set_xticks(range(len(combinations)), [combination.name for combination in combinations])
            ax.set_xlabel("resolutions (receiver-donor), m")
            ax.grid(axis="x", visible=False)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
        caption = (
            f"DM after the further scans, {ways_shown(experiment)['multi_map']}; every dot is a merge, bars are means, "
            "dashed lines the best threshold at each resolution."
        )
        return Drawn("resolution", "How DM moves with the resolution", caption, png_of(figure))


def _logarithmic(ax: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _strip(ax: Axes, experiment: Experiment, combination: Combination, place: int, factor: float) -> None:
    for (kind, right), mark, shift in zip(KINDS.items(), ("o", "x"), (-0.18, 0.18), strict=True):
        values = factor * _there(experiment, combination, right, "distance", "multi_map")
        values = values[values > 0.0]
        if not values.size:
            continue
        spread = place + shift + np.linspace(-0.12, 0.12, values.size)
        ax.plot(spread, values, mark, color=COLOURS[kind], markersize=4.5, label=kind if place == 0 else None)
        ax.hlines(values.mean(), place + shift - 0.16, place + shift + 0.16, color=COLOURS[kind], linewidth=2.2)


def costs_figure(experiment: Experiment) -> Drawn:
    """What an update costs in each way, one map being 1, with the paper's two maps."""
    names = {"evidence": "evidence alone", "update": "with the robot's map", "compared": "and the map for metrics"}
    colours = dict(zip(STRATEGIES, (MUTED, SKY, GREEN), strict=True))
    groups = [
        (c, kind, of(experiment, c, right)) for c in experiment.settings.combinations for kind, right in KINDS.items()
    ]
    groups = [group for group in groups if group[2]]
    with drawing():
        figure = canvas(11.5, 3.8)
        axes = figure.subplots(1, 3, sharey=True)
        for ax, (cost, title) in zip(axes, names.items(), strict=True):
            for place, (combination, kind, merges) in enumerate(groups):
                for shift, strategy in zip((-0.27, 0.0, 0.27), STRATEGIES, strict=True):
                    value = ratio(merges, strategy, COSTS[cost][1])
                    label = SHORT[strategy] if place == 0 else None
                    ax.bar(place + shift, value, 0.25, color=colours[strategy], label=label)
                theirs = _paper_ratio(combination, KINDS[kind])
                if not math.isnan(theirs):
                    ax.plot(
                        place, theirs, "D", color=VERMILLION, markersize=5, label="paper, 2M" if place == 0 else None
                    )
            ax.axhline(1.1, color=INK, linestyle="--", linewidth=0.9)
            ax.set_title(title)
            labels = [f"{combination.name}\n{kind}" for combination, kind, _ in groups]
            ax.set_xticks(range(len(groups)), labels, fontsize=7)
            ax.grid(axis="x", visible=False)
        axes[0].set_ylabel("cost of an update, 1M = 1")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=4)
        caption = (
            "Time of the further scans, one map being 1. Dashed: 1.1. One map's metrics look at the merged map, which "
            "is there already; the others' look at the robot's own map, which must be made as well."
        )
        return Drawn("costs", "What an update costs", caption, png_of(figure), timed=True)


def _paper_ratio(combination: Combination, right: bool) -> float:
    one, two = (published().number(combination, right, short, "update_time") for short in ("1M", "2M"))
    return math.nan if one is None or two is None else two.value / one.value
