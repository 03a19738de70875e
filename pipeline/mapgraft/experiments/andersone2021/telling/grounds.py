"""What statements rest on: groups of merges, ranges and areas in words, and the criteria where the paper has none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Final

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Experiment, Merge
from mapgraft.experiments.andersone2021.settings import Combination
from mapgraft.experiments.andersone2021.telling.as_published import COSTS, KINDS, of, ratio, reading
from mapgraft.experiments.andersone2021.telling.detection import Curve
from mapgraft.experiments.andersone2021.telling.published import published

ENOUGH: Final = 5  # merges of each kind in a group; with fewer nothing is judged
LITTLE: Final = 0.1  # share of the merges in the range of both kinds up to which ranges overlap little
MUCH: Final = 0.5  # and from which on they are very similar
TRACES: Final = 0.05  # share of the known cells up to which what a revert leaves is insignificant


def groups_of(experiment: Experiment) -> Iterator[tuple[str, list[Merge]]]:
    """The merges of one kind at one combination of resolutions, where there are any, under a name."""
    for combination, (kind, right) in product(experiment.settings.combinations, KINDS.items()):
        merges = of(experiment, combination, right)
        if merges:
            yield f"{combination.name}, {kind}", merges


def ratios_of(experiment: Experiment, strategy: ReversalName, cost: str) -> list[float]:
    """How often the time with one map goes into that of a strategy, of every group."""
    return [ratio(merges, strategy, COSTS[cost][1]) for _, merges in groups_of(experiment)]


def paper_ratios(experiment: Experiment) -> list[float]:
    """How often an update of one map goes into one of two, by the paper's tables."""
    pairs = [
        [published().number(combination, right, short, "update_time") for short in ("1M", "2M")]
        for combination, right in product(experiment.settings.combinations, KINDS.values())
    ]
    return [two.value / one.value for one, two in pairs if one is not None and two is not None]


def sizes(experiment: Experiment, combinations: Sequence[Combination] | None = None) -> list[int]:
    """How many merges of each kind there are, combination by combination."""
    chosen = experiment.settings.combinations if combinations is None else combinations
    return [len(of(experiment, combination, right)) for combination in chosen for right in KINDS.values()]


def overlap(
    experiment: Experiment, metric: str, strategy: ReversalName, combination: Combination
) -> tuple[int, int, str]:
    """How many merges of a combination lie in the range of both kinds, of how many, and a sentence; at the end."""
    ranges: Mapping[str, list[float]] = {
        kind: [
            value
            for merge in of(experiment, combination, right)
            if not math.isnan(value := reading(merge.by[strategy], metric, "end"))
        ]
        for kind, right in KINDS.items()
    }
    if not all(ranges.values()):
        return 0, 0, f"There are no merges to compare at {combination.name}."
    low, high = max(map(min, ranges.values())), min(map(max, ranges.values()))
    everything = [value for values in ranges.values() for value in values]
    inside = sum(low <= value <= high for value in everything)
    told = ", ".join(f"{kind} {min(values):.3f} to {max(values):.3f}" for kind, values in ranges.items())
    count = f"{inside} of {len(everything)} merges lie in the range of both kinds"
    return inside, len(everything), f"At {combination.name} in the end: {told}; {count}."


def area_of(curves: Sequence[Curve], number: str, source: str, group: str) -> Curve | None:
    """The curve of a number in the end, None where it is not told."""
    for curve in curves:
        if (curve.number, curve.moment, curve.source, curve.group) == (number, "end", source, group):
            return curve
    return None


def area_text(curve: Curve | None) -> str:
    """The area under a curve with its interval."""
    if curve is None:
        return "not told"
    return f"{curve.area.value:.3f} ({curve.area.low:.3f}–{curve.area.high:.3f})"


def span(values: Sequence[float]) -> str:
    """The least and the greatest."""
    return f"{min(values):.2f} to {max(values):.2f}" if values else "not told"
