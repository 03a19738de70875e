"""What is claimed, by the paper or for the ledger, held against what was measured: sentences with numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Literal

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Experiment, Merge
from mapgraft.experiments.andersone2021.settings import METRICS, SHORT, STRATEGIES
from mapgraft.experiments.andersone2021.telling.as_published import (
    KINDS,
    METRIC_NAMES,
    MOMENTS,
    draws,
    mean,
    of,
    reading,
    same_numbers,
)
from mapgraft.experiments.andersone2021.telling.detection import Curve, verdicts
from mapgraft.experiments.andersone2021.telling.grounds import (
    ENOUGH,
    LITTLE,
    MUCH,
    TRACES,
    area_of,
    area_text,
    groups_of,
    overlap,
    paper_ratios,
    ratios_of,
    sizes,
    span,
)

COST_MAX: Final = 1.1  # of one map's, what the ledger may cost

OF_THE_PAPER: Final[tuple[ReversalName, ReversalName]] = ("single_map", "multi_map")

Source = Literal["ledger", "paper", "tables", "rules"]


@dataclass(frozen=True, slots=True)
class Statement:
    """A claim, who makes it, what was found, and whether it holds; None where that cannot be told.

    It cannot where there are too few merges. What is equal to the last bit, or is not, can be told of any number.

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
        *(_ordering(experiment, metric) for metric in METRICS),
        _weighed(_two_cost_more(experiment), sizes(experiment)),
        *(_separates(experiment, curves, metric) for metric in METRICS),
        _weighed(_similar_ranges(experiment, curves), sizes(experiment)),
        _weighed(_distance_is_better(experiment, curves), sizes(experiment)),
        _weighed(_never_without_errors(experiment, curves), sizes(experiment)),
        _weighed(_traces(experiment), [draws(experiment.merges, right=False)]),
        _agree(experiment, right=True),
        _agree(experiment, right=False),
        _weighed(_drifts(experiment), sizes(experiment)),
        _weighed(_verdicts(experiment), [draws(experiment.merges, right) for right in KINDS.values()]),
    ]


def _weighed(said: Statement, counts: Sequence[int]) -> Statement:
    """The same without a verdict where some of the groups that it rests on are too small.

    Of a group of all resolutions together only different draws count.
    """
    if said.holds is None or (counts and min(counts) >= ENOUGH):
        return said
    few = f" With fewer than {ENOUGH} merges of a kind and group this is not judged."
    return replace(said, found=said.found + few, holds=None)


def _of_the_ledger(experiment: Experiment) -> Iterator[Statement]:
    merges = experiment.merges
    equal = sum(same_numbers(merge.by["ledger"], merge.by["multi_map"]) for merge in merges)
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
    yield _weighed(_cost_of_the_ledger(experiment), sizes(experiment))
    yield _weighed(_cost_with_metrics(experiment), sizes(experiment))


def _cost_of_the_ledger(experiment: Experiment) -> Statement:
    ratios, evidence = (ratios_of(experiment, "ledger", cost) for cost in ("update", "evidence"))
    return Statement(
        "ledger_cost",
        "ledger",
        f"An update costs at most {COST_MAX:g} of one with a single map, the fused view of what was touched included.",
        f"{span(ratios)} times as much, by resolutions and kind of merge; the evidence alone "
        f"{span(evidence)} times as much.",
        max(ratios) <= COST_MAX if ratios else None,
        timed=True,
    )


def _cost_with_metrics(experiment: Experiment) -> Statement:
    ledger, two = (ratios_of(experiment, strategy, "compared") for strategy in ("ledger", "multi_map"))
    holds = all(a < b for a, b in zip(ledger, two, strict=True)) if ledger else None
    return Statement(
        "ledger_cost_of_metrics",
        "ledger",
        "It still costs less than two maps when metrics are measured after every scan.",
        f"With the robot's own map, at which metrics look, the ledger costs {span(ledger)} times as much as one map, "
        f"two maps {span(two)} times. One map has no own map to show: its metrics see the donor in it.",
        holds,
        timed=True,
    )


def _ordering(experiment: Experiment, metric: str) -> Statement:
    """Means of one map against means of two, at both moments, of all groups; what cannot be measured is left out."""
    word, sign = ("higher", 1.0) if metric == "similarity" else ("lower", -1.0)
    groups = [_both(merges, metric, moment) for (_, merges), moment in product(groups_of(experiment), MOMENTS)]
    groups = [pairs for pairs in groups if pairs]
    held = sum(sign * (mean([one for one, _ in pairs]) - mean([two for _, two in pairs])) > 0.0 for pairs in groups)
    single = [sign * (one - two) > 0.0 for pairs in groups for one, two in pairs]
    said = Statement(
        f"{metric}_in_one_map",
        "paper",
        f"{METRIC_NAMES[metric]} is {word} with one map than with two.",
        f"In {held} of {len(groups)} averages (resolutions, right or wrong, at the merge or at the end), and of single "
        f"measurements in {sum(single)} of {len(single)}.",
        held == len(groups) if groups else None,
    )
    return _weighed(said, [len(pairs) for pairs in groups] if all(sizes(experiment)) else [])


def _both(merges: Sequence[Merge], metric: str, moment: str) -> list[tuple[float, float]]:
    """What was measured with one map and with two, of merges that have both."""
    one, two = ([reading(merge.by[way], metric, moment) for merge in merges] for way in OF_THE_PAPER)
    return [pair for pair in zip(one, two, strict=True) if not math.isnan(sum(pair))]


def _two_cost_more(experiment: Experiment) -> Statement:
    ratios = ratios_of(experiment, "multi_map", "update")
    return Statement(
        "two_cost_more",
        "paper",
        "An update of two maps takes longer than of one.",
        f"{span(ratios)} times as long, in the paper {span(paper_ratios(experiment))} times.",
        min(ratios) > 1.0 if ratios else None,
        timed=True,
    )


def _separates(experiment: Experiment, curves: Sequence[Curve], metric: str) -> Statement:
    first = experiment.settings.combinations[0]
    inside, of_all, text = overlap(experiment, metric, "multi_map", first)
    curve = area_of(curves, metric, "multi_map", first.name)
    said = Statement(
        f"{metric}_with_two_maps",
        "paper",
        f"With two maps the ranges of {METRIC_NAMES[metric]} overlap little, so that it tells wrong merges (our "
        f"measure: at most {100 * LITTLE:g} % of the merges lie in the range of both kinds).",
        f"{text} Area under the curve {area_text(curve)}.",
        inside <= LITTLE * of_all if of_all and curve is not None else None,
    )
    return _weighed(said, sizes(experiment, [first]))


def _similar_ranges(experiment: Experiment, curves: Sequence[Curve]) -> Statement:
    combinations = experiment.settings.combinations
    found = [overlap(experiment, "similarity", "single_map", combination) for combination in combinations]
    areas = [area_of(curves, "similarity", "single_map", combination.name) for combination in combinations]
    inside, of_all = sum(some for some, _, _ in found), sum(every for _, every, _ in found)
    return Statement(
        "similarity_with_one_map",
        "paper",
        "With one map the ranges of SM are very similar, so that it is not useful (our measure: at least "
        f"{100 * MUCH:g} % of all merges lie in the range of both kinds of their resolutions).",
        f"{' '.join(text for _, _, text in found)} Areas under the curve by resolutions: "
        f"{', '.join(map(area_text, areas))}.",
        inside >= MUCH * of_all if all(count for _, count, _ in found) and all(areas) else None,
    )


def _distance_is_better(experiment: Experiment, curves: Sequence[Curve]) -> Statement:
    names = [combination.name for combination in experiment.settings.combinations]
    found = [[area_of(curves, metric, "single_map", name) for metric in ("distance", "similarity")] for name in names]
    pairs = [(dm.area.value, sm.area.value) for dm, sm in found if dm is not None and sm is not None]
    told = "; ".join(
        f"{name}: {' against '.join('not told' if one is None else f'{one.area.value:.3f}' for one in both)}"
        for name, both in zip(names, found, strict=True)
    )
    return Statement(
        "distance_with_one_map",
        "paper",
        "With one map DM tells wrong merges better than SM does.",
        f"Areas under the curve of DM and SM by resolutions: {told}.",
        all(dm >= sm for dm, sm in pairs) and any(dm > sm for dm, sm in pairs) if len(pairs) == len(names) else None,
    )


def _never_without_errors(experiment: Experiment, curves: Sequence[Curve]) -> Statement:
    names = [combination.name for combination in experiment.settings.combinations]
    found = [area_of(curves, "distance", "single_map", name) for name in names]
    best = [curve.threshold for curve in found if curve is not None]
    told = ", ".join(f"{t.false_positives} + {t.false_negatives} of {t.of}" for t in best)
    return Statement(
        "distance_errors_with_one_map",
        "paper",
        "With one map there are false positives or false negatives whatever the threshold of DM.",
        f"The best thresholds by resolutions, each chosen on the merges that it is counted on, leave {told}."
        if best
        else "There are too few merges to tell.",
        all(threshold.errors for threshold in best) if len(best) == len(names) else None,
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
    touched = sum(kept.leftovers.touched for kept in left)
    return Statement(
        "traces",
        "paper",
        "What a revert leaves of a wrong merge in a single map is insignificant (our measure: less than "
        f"{100 * TRACES:g} % of the cells that would be known read otherwise).",
        f"{told}, all in per cent of the known ones; cells that still hold the donor's share are "
        f"{100.0 * contaminated / known:.0f} % of them, and {100.0 * touched / known:.0f} % show another probability. "
        f"{_cleaner(merges)}",
        sum(counts.values()) < TRACES * known,
    )


def _cleaner(merges: Sequence[Merge]) -> str:
    """What the other ways of keeping a merge leave, in a sentence."""
    rest = [strategy for strategy in STRATEGIES if strategy != "single_map"]
    counts = {
        SHORT[way]: sum(not (m.by[way].leftovers.identical and m.by[way].exactness.exact) for m in merges)
        for way in rest
    }
    if not any(counts.values()):
        return f"{' and '.join(counts)} leave nothing."
    left = ", ".join(f"{name} in {count}" for name, count in counts.items())
    return f"Of {len(merges)} merges something is left by {left}."


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
    claim = (
        f"DM of {kind} merges is about the same in {unit} whatever the resolution (our measure: closer together than "
        f"in {other})."
    )
    if len(apart) < 2 or any(map(math.isnan, (*cells, *metres))):
        return Statement(f"distance_of_{kind}", "tables", claim, "There are too few merges to tell.", None)
    shown = {"cells": [f"{v:.2f}" for v in cells], "metres": [f"{v:.3f}" for v in metres]}
    said = Statement(
        f"distance_of_{kind}",
        "tables",
        claim,
        f"With two maps, at the merge: {', '.join(shown['cells'])} cells and {', '.join(shown['metres'])} m by "
        f"resolutions; the largest is {apart[unit]:.2f} times the smallest in {unit}, {apart[other]:.2f} times in "
        f"{other}.",
        apart[unit] < apart[other],
    )
    return _weighed(said, [_with_distance(of(experiment, c, right)) for c in combinations])


def _with_distance(merges: Sequence[Merge]) -> int:
    """How many of the merges have a DM at the merge."""
    return sum(not math.isnan(reading(merge.by["multi_map"], "distance", "initial")) for merge in merges)


_WITH: Final[Mapping[ReversalName, str]] = {"single_map": "with one map", "multi_map": "with two maps"}


def _drifts(experiment: Experiment) -> Statement:
    worse, told, lines = 0, 0, []
    for strategy, metric in product(OF_THE_PAPER, METRICS):
        sign = -1.0 if metric == "similarity" else 1.0
        for _, merges in groups_of(experiment):
            before, after = (mean([reading(m.by[strategy], metric, at) for m in merges]) for at in MOMENTS)
            if not math.isnan(after - before):
                worse, told = worse + (sign * (after - before) > 0.0), told + 1
                lines += [f"{METRIC_NAMES[metric]} {_WITH[strategy]}"] if sign * (after - before) <= 0.0 else []
    better = ", ".join(f"{name} became better in {lines.count(name)}" for name in dict.fromkeys(lines))
    return Statement(
        "further_mapping",
        "tables",
        "Further mapping makes the averages of SM and DM worse (in 23 of the paper's 24; our measure: in all but one).",
        f"In {worse} of {told}" + (f"; {better}." if better else "."),
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
