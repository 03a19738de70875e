"""What is claimed, by the paper or for the ledger, held against what was measured: sentences with numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, Literal

import numpy as np

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Experiment, Kept, Merge
from mapgraft.experiments.andersone2021.settings import METRICS, SHORT, STRATEGIES
from mapgraft.experiments.andersone2021.telling.as_published import (
    COSTS,
    KINDS,
    METRIC_NAMES,
    MOMENTS,
    mean,
    measured,
    of,
    ratio,
)
from mapgraft.experiments.andersone2021.telling.detection import Curve, verdicts
from mapgraft.experiments.andersone2021.telling.published import published

COST_MAX: Final = 1.1  # of one map's, what the ledger may cost
LITTLE: Final = 0.1  # share of the merges in the range of both kinds up to which ranges overlap little
MUCH: Final = 0.5  # and from which on they are very similar
TRACES: Final = 0.05  # share of the known cells up to which what a revert leaves is insignificant

TWO: Final[tuple[ReversalName, ReversalName]] = ("single_map", "multi_map")  # of which the paper tells

Source = Literal["ledger", "paper", "tables", "rules"]


@dataclass(frozen=True, slots=True)
class Statement:
    """A claim, who makes it, what was found, and whether it holds; None where that cannot be told.

    Sources: ``ledger`` is what this project promises, ``paper`` what the paper says, ``tables`` what its tables show,
    ``rules`` is about our own rules. ``timed`` statements depend on the clock.
    """

    name: str
    source: Source
    claim: str
    found: str
    holds: bool | None
    timed: bool = False


def statements(experiment: Experiment, curves: Sequence[Curve]) -> list[Statement]:
    """All claims, the ledger's first."""
    return [
        *_of_the_ledger(experiment),
        _ordering(experiment, "similarity"),
        _ordering(experiment, "distance"),
        _two_cost_more(experiment),
        *(_separates(experiment, curves, metric) for metric in METRICS),
        _similar_ranges(experiment, curves),
        _distance_is_better(experiment, curves),
        _never_without_errors(experiment, curves),
        _traces(experiment),
        _agree(experiment, right=True),
        _agree(experiment, right=False),
        _drifts(experiment),
        _verdicts(experiment),
    ]


def _of_the_ledger(experiment: Experiment) -> Iterator[Statement]:
    merges = experiment.merges
    equal = sum(_same_numbers(merge.by["ledger"], merge.by["multi_map"]) for merge in merges)
    numbers = len(merges[0].by["ledger"].initial) + len(merges[0].by["ledger"].end)
    yield Statement(
        "ledger_metrics",
        "ledger",
        "The ledger's metrics are those of two maps, bit for bit.",
        f"All {numbers} numbers, SM and DM with their details at the merge and at the end, are equal in {equal} of "
        f"{len(merges)} merges.",
        equal == len(merges),
    )
    same = {s: sum(merge.by[s].leftovers.identical for merge in merges) for s in STRATEGIES}
    yield Statement(
        "ledger_revert",
        "ledger",
        "After a revert the ledger's map has the same bytes as one that never merged.",
        f"It has in {same['ledger']} of {len(merges)} merges; that of two maps in {same['multi_map']}, that of one map "
        f"in {same['single_map']}.",
        same["ledger"] == len(merges),
    )
    yield _cost_of_the_ledger(experiment)
    yield _cost_with_metrics(experiment)


def _same_numbers(a: Kept, b: Kept) -> bool:
    """Whether two ways of keeping a merge told the same, also where that is NaN."""
    return all(
        list(ours) == list(theirs) and np.array_equal(list(ours.values()), list(theirs.values()), equal_nan=True)
        for ours, theirs in ((a.initial, b.initial), (a.end, b.end))
    )


def _cost_of_the_ledger(experiment: Experiment) -> Statement:
    ratios, evidence = (_ratios(experiment, "ledger", cost) for cost in ("update", "evidence"))
    return Statement(
        "ledger_cost",
        "ledger",
        f"An update costs at most {COST_MAX:g} of one with a single map, the fused view of what was touched included.",
        f"{_span(ratios)} times as much, by resolutions and kind of merge; the evidence alone {_span(evidence)} times.",
        max(ratios) <= COST_MAX if ratios else None,
        timed=True,
    )


def _cost_with_metrics(experiment: Experiment) -> Statement:
    ledger, two = (_ratios(experiment, strategy, "compared") for strategy in ("ledger", "multi_map"))
    holds = all(a < b for a, b in zip(ledger, two, strict=True)) if ledger else None
    return Statement(
        "ledger_cost_of_metrics",
        "ledger",
        "It still costs less than two maps when metrics are measured after every scan.",
        f"With the robot's own map, at which metrics look, the ledger costs {_span(ledger)} times as much as one map, "
        f"two maps {_span(two)} times. One map has no own map to show: its metrics see the donor in it.",
        holds,
        timed=True,
    )


def _ordering(experiment: Experiment, metric: str) -> Statement:
    """Means of one map against means of two, at both moments, of all groups."""
    word, sign = ("higher", 1.0) if metric == "similarity" else ("lower", -1.0)
    groups = [
        [mean([measured(merge.by[s], metric, moment) for merge in merges]) for s in TWO]
        for (_, merges), moment in product(_groups(experiment), MOMENTS)
    ]
    told = [pair for pair in groups if not any(map(math.isnan, pair))]
    held = sum(sign * (one - two) > 0.0 for one, two in told)
    by_merge = [
        sign * (measured(m.by["single_map"], metric, moment) - measured(m.by["multi_map"], metric, moment)) > 0.0
        for m, moment in product(experiment.merges, MOMENTS)
    ]
    return Statement(
        f"{metric}_in_one_map",
        "paper",
        f"{METRIC_NAMES[metric]} is {word} with one map than with two.",
        f"In {held} of {len(told)} averages (resolutions, right or wrong, at the merge or at the end), and of single "
        f"measurements in {sum(by_merge)} of {len(by_merge)}.",
        held == len(told) if told else None,
    )


def _two_cost_more(experiment: Experiment) -> Statement:
    ratios = _ratios(experiment, "multi_map", "update")
    return Statement(
        "two_cost_more",
        "paper",
        "An update of two maps takes longer than of one.",
        f"{_span(ratios)} times as long, in the paper {_span(_paper_ratios(experiment))} times.",
        min(ratios) > 1.0 if ratios else None,
        timed=True,
    )


def _separates(experiment: Experiment, curves: Sequence[Curve], metric: str) -> Statement:
    inside, of_all, text = _overlap(experiment, metric, "multi_map")
    area = _area(curves, metric, "multi_map", experiment.settings.combinations[0].name)
    return Statement(
        f"{metric}_with_two_maps",
        "paper",
        f"With two maps the ranges of {METRIC_NAMES[metric]} overlap little, so that it tells wrong merges.",
        f"{text} Area under the curve {area}.",
        inside <= LITTLE * of_all if of_all else None,
    )


def _similar_ranges(experiment: Experiment, curves: Sequence[Curve]) -> Statement:
    inside, of_all, text = _overlap(experiment, "similarity", "single_map")
    areas = ", ".join(_area(curves, "similarity", "single_map", c.name) for c in experiment.settings.combinations)
    return Statement(
        "similarity_with_one_map",
        "paper",
        "With one map the ranges of SM are very similar, so that it is not useful.",
        f"{text} Areas under the curve by resolutions: {areas}.",
        inside >= MUCH * of_all if of_all else None,
    )


def _distance_is_better(experiment: Experiment, curves: Sequence[Curve]) -> Statement:
    areas = {(c.group, c.number): c.area.value for c in curves if (c.moment, c.source) == ("end", "single_map")}
    names = [c.name for c in experiment.settings.combinations if (c.name, "distance") in areas]
    pairs = [(areas[name, "distance"], areas.get((name, "similarity"), math.nan)) for name in names]
    told = "; ".join(f"{name}: {dm:.3f} against {sm:.3f}" for name, (dm, sm) in zip(names, pairs, strict=True))
    return Statement(
        "distance_with_one_map",
        "paper",
        "With one map DM tells wrong merges better than SM does.",
        f"Areas under the curve of DM and SM by resolutions: {told}." if told else "There are too few merges to tell.",
        all(dm >= sm for dm, sm in pairs) and any(dm > sm for dm, sm in pairs) if pairs else None,
    )


def _never_without_errors(experiment: Experiment, curves: Sequence[Curve]) -> Statement:
    found = {
        c.group: c.threshold for c in curves if (c.number, c.moment, c.source) == ("distance", "end", "single_map")
    }
    best = [found[c.name] for c in experiment.settings.combinations if c.name in found]
    told = ", ".join(f"{t.false_positives} + {t.false_negatives} of {t.of}" for t in best)
    return Statement(
        "distance_errors_with_one_map",
        "paper",
        "With one map there are false positives or false negatives whatever the threshold of DM.",
        f"The best thresholds by resolutions, each chosen on the merges that it is counted on, leave {told}."
        if best
        else "There are too few merges to tell.",
        all(threshold.errors for threshold in best) if best else None,
    )


def _traces(experiment: Experiment) -> Statement:
    merges = of(experiment, right=False)
    left = [merge.by["single_map"] for merge in merges]
    known = sum(kept.leftovers.known for kept in left)
    counts = {
        "lost": sum(kept.leftovers.lost for kept in left),
        "of the other class": sum(kept.leftovers.changed for kept in left),
        "known that would not be": sum(kept.leftovers.alien for kept in left),
    }
    if not known:
        claim = "What a revert leaves of a wrong merge in a single map is insignificant."
        return Statement("traces", "paper", claim, "There is no wrong merge to tell it by.", None)
    told = ", ".join(f"{100.0 * count / known:.1f} {name}" for name, count in counts.items())
    contaminated = sum(kept.exactness.cells_contaminated for kept in left)
    return Statement(
        "traces",
        "paper",
        f"What a revert leaves of a wrong merge in a single map is insignificant: less than {100 * TRACES:g} % of the "
        "cells that would be known read otherwise.",
        f"{told}, all in per cent of the known ones; cells that still hold the donor's share are "
        f"{100.0 * contaminated / known:.0f} % of them. Two maps and the ledger leave nothing.",
        sum(counts.values()) < TRACES * known,
    )


def _agree(experiment: Experiment, *, right: bool) -> Statement:
    """Whether DM is constant in cells or in metres; the paper's tables: right 1.23-1.31 cells, wrong 1.00-1.05 m."""
    combinations = experiment.settings.combinations
    cells = [mean([m.by["multi_map"].initial["distance"] for m in of(experiment, c, right)]) for c in combinations]
    metres = [
        mean([m.by["multi_map"].initial["distance.metres"] for m in of(experiment, c, right)]) for c in combinations
    ]
    apart = {
        unit: max(values) / min(values) for unit, values in (("cells", cells), ("metres", metres)) if min(values) > 0
    }
    kind, unit, other = ("right", "cells", "metres") if right else ("wrong", "metres", "cells")
    claim = f"DM of {kind} merges is about the same in {unit} whatever the resolution."
    if len(apart) < 2 or any(map(math.isnan, (*cells, *metres))):
        return Statement(f"distance_of_{kind}", "tables", claim, "There are too few merges to tell.", None)
    shown = {"cells": [f"{v:.2f}" for v in cells], "metres": [f"{v:.3f}" for v in metres]}
    return Statement(
        f"distance_of_{kind}",
        "tables",
        claim,
        f"With two maps, at the merge: {', '.join(shown['cells'])} cells and {', '.join(shown['metres'])} m by "
        f"resolutions; the largest is {apart[unit]:.2f} times the smallest in {unit}, {apart[other]:.2f} times in "
        f"{other}.",
        apart[unit] < apart[other],
    )


def _drifts(experiment: Experiment) -> Statement:
    worse, told, lines = 0, 0, []
    for strategy, metric in product(TWO, METRICS):
        sign = -1.0 if metric == "similarity" else 1.0
        for _, merges in _groups(experiment):
            before, after = (mean([measured(m.by[strategy], metric, at) for m in merges]) for at in MOMENTS)
            if not math.isnan(after - before):
                worse, told = worse + (sign * (after - before) > 0.0), told + 1
                lines += [f"{METRIC_NAMES[metric]} in {SHORT[strategy]}"] if sign * (after - before) <= 0.0 else []
    better = ", ".join(f"{name} ({lines.count(name)})" for name in dict.fromkeys(lines))
    return Statement(
        "further_mapping",
        "tables",
        "Further mapping makes the averages of SM and DM worse (in 23 of the paper's 24).",
        f"In {worse} of {told}" + (f"; not {better}." if better else "."),
        worse >= told - 1 if told else None,
    )


def _verdicts(experiment: Experiment) -> Statement:
    right, wrong = (verdicts(experiment, None, kind) for kind in (True, False))
    looked = sum(right.values()) + sum(wrong.values()) - right["unseen"] - wrong["unseen"]
    return Statement(
        "verifier",
        "rules",
        "Our own rules revert wrong merges and no right ones.",
        f"Of {sum(wrong.values())} wrong merges {wrong['revert']} are reverted, {wrong['confirm']} confirmed and "
        f"{wrong['keep']} kept; of {sum(right.values())} right ones {right['revert']} are reverted, {right['confirm']} "
        f"confirmed and {right['keep']} kept.",
        right["revert"] == 0 and wrong["revert"] == sum(wrong.values()) if looked else None,
    )


def _groups(experiment: Experiment) -> Iterator[tuple[str, list[Merge]]]:
    for combination, (kind, right) in product(experiment.settings.combinations, KINDS.items()):
        merges = of(experiment, combination, right)
        if merges:
            yield f"{combination.name}, {kind}", merges


def _ratios(experiment: Experiment, strategy: ReversalName, cost: str) -> list[float]:
    return [ratio(merges, strategy, COSTS[cost][1]) for _, merges in _groups(experiment)]


def _paper_ratios(experiment: Experiment) -> list[float]:
    """How often an update of one map goes into one of two, by the paper's tables."""
    pairs = [
        [published().number(combination, right, short, "update_time") for short in ("1M", "2M")]
        for combination, right in product(experiment.settings.combinations, KINDS.values())
    ]
    return [two.value / one.value for one, two in pairs if one is not None and two is not None]


def _overlap(experiment: Experiment, metric: str, strategy: ReversalName) -> tuple[int, int, str]:
    """How many merges of the first combination lie in the range of both kinds, of how many, and a sentence."""
    combination = experiment.settings.combinations[0]
    ranges: Mapping[str, list[float]] = {
        kind: [
            v
            for m in of(experiment, combination, right)
            if not math.isnan(v := measured(m.by[strategy], metric, "end"))
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


def _area(curves: Sequence[Curve], number: str, source: str, group: str) -> str:
    for curve in curves:
        if (curve.number, curve.moment, curve.source, curve.group) == (number, "end", source, group):
            return f"{curve.area.value:.3f} ({curve.area.low:.3f}–{curve.area.high:.3f})"
    return "not told"


def _span(values: Sequence[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f}" if values else "not told"
