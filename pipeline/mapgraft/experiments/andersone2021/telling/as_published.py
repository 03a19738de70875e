"""Tables 1 to 4 of the paper with a third column, and what each way of keeping a merge costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Cost, Experiment, Kept, Merge
from mapgraft.experiments.andersone2021.settings import METRICS, SHORT, STRATEGIES, Combination
from mapgraft.experiments.andersone2021.telling.published import published
from mapgraft.experiments.andersone2021.telling.tables import Column, Number, Row, Table

KINDS: Final = {"right": True, "wrong": False}
MOMENTS: Final = ("initial", "end")
METRIC_NAMES: Final = {"similarity": "SM", "distance": "DM"}
BASE: Final[ReversalName] = "single_map"  # whose costs the others' are held against
COSTS: Final[dict[str, tuple[str, Callable[[Cost], float]]]] = {
    "update": ("update, with the robot's map", lambda cost: cost.mapped_s),
    "evidence": ("update, the evidence alone", lambda cost: cost.update_s),
    "compared": ("update, with the map that metrics look at as well", lambda cost: cost.mapped_s + cost.compared_s),
}

Sought = Callable[[Sequence[Merge], ReversalName], Number]  # a number of the merges that were kept in one way


def paper_tables(experiment: Experiment) -> list[Table]:
    """One table per combination of resolutions, as the paper's tables 1 to 3, and the ranges of its table 4."""
    combinations = experiment.settings.combinations
    averages = [_averages(experiment, c, number) for number, c in enumerate(combinations, start=1)]
    return [*averages, _ranges(experiment, len(averages) + 1)]


def costs_table(experiment: Experiment) -> Table:
    """What the further scans cost with a merge kept in each way, and how that goes into the cost of one map."""
    rows = []
    for combination in experiment.settings.combinations:
        groups = {kind: of(experiment, combination, right) for kind, right in KINDS.items()}
        for name, (label, cost) in COSTS.items():
            labels = (combination.name, label)
            rows.append(_row(f"{combination.name}_{name}_ms", (*labels, "ms"), groups, _milliseconds(cost), timed=True))
            rows.append(_row(f"{combination.name}_{name}_ratio", (*labels, "1M = 1"), groups, _ratio(cost), timed=True))
        times = _row(
            f"{combination.name}_revert_ms", (combination.name, "revert", "ms"), groups, _revert_ms, timed=True
        )
        rows.append(times)
    note = (
        "For the further scans together: times are means of the merges, ratios their medians. The robot's map is the "
        "one that it plans with: the merged map, of the ledger the fused view of what was touched. Metrics look at the "
        "merged map in 1M and at the robot's own map otherwise, which 2M and the ledger must make in addition."
    )
    title = "What the further scans cost, and a revert"
    return Table("costs", title, note, ("resolutions", "what", "unit"), columns(paper=False), rows)


def of(experiment: Experiment, combination: Combination | None = None, right: bool | None = None) -> list[Merge]:
    """The merges of a combination, of a kind, of both or of all."""
    return [
        merge
        for merge in experiment.merges
        if combination in (None, merge.combination) and right in (None, merge.right)
    ]


def reading(kept: Kept, metric: str, moment: str) -> float:
    """A metric at a moment; NaN where too little was shared."""
    return (kept.initial if moment == "initial" else kept.end)[metric]


def same_numbers(a: Kept, b: Kept) -> bool:
    """Whether two ways of keeping a merge told the same to the last bit, also where that is NaN."""
    return all(
        list(ours) == list(theirs) and np.array_equal(list(ours.values()), list(theirs.values()), equal_nan=True)
        for ours, theirs in ((a.initial, b.initial), (a.end, b.end))
    )


def ways_shown(experiment: Experiment) -> dict[ReversalName, str]:
    """Ways of keeping a merge that are drawn apart: the ledger with two maps where all of their numbers are equal."""
    if all(same_numbers(merge.by["ledger"], merge.by["multi_map"]) for merge in experiment.merges):
        return {"single_map": "1M", "multi_map": "2M and ledger"}
    return dict(SHORT)


def draws(merges: Sequence[Merge], right: bool | None = None) -> int:
    """Of how many different draws merges are: the same pair is merged at several resolutions."""
    return len({merge.number for merge in merges if right in (None, merge.right)})


def shared_draws(experiment: Experiment) -> str:
    """A sentence for numbers of all merges together."""
    right, wrong = (draws(experiment.merges, kind) for kind in KINDS.values())
    if right + wrong == len(experiment.merges):
        return "Every merge is of another draw."
    return (
        f"The {len(experiment.merges)} merges come from {right} different draws of right and {wrong} of wrong ones, "
        "because the same pairs are merged at several resolutions: they are not independent of each other."
    )


def ranged(values: Sequence[float]) -> Number:
    """The mean of the numbers there are, with the least and the greatest."""
    there = [value for value in values if not math.isnan(value)]
    return Number(float(np.mean(there)), min(there), max(there)) if there else Number(math.nan)


def mean(values: Sequence[float]) -> float:
    """The mean of the numbers there are; NaN where there are none."""
    return ranged(values).value


def seconds(merges: Sequence[Merge], strategy: ReversalName, cost: Callable[[Cost], float]) -> float:
    """The mean time of the further scans."""
    return mean([cost(merge.by[strategy].cost) for merge in merges])


def ratio(merges: Sequence[Merge], strategy: ReversalName, cost: Callable[[Cost], float]) -> float:
    """How often the time with one map goes into that of a strategy: the median of the merges.

    Each merge is held against itself, and a hiccup of the machine moves no median.
    """
    pairs = [(cost(merge.by[strategy].cost), cost(merge.by[BASE].cost)) for merge in merges]
    found = [ours / base for ours, base in pairs if base > 0.0]
    return float(np.median(found)) if found else math.nan


def columns(*, ends: bool = False, paper: bool = True) -> list[Column]:
    """Right and wrong merges, each kept in every way."""
    return [
        Column(f"{kind}_{SHORT[s]}", f"{kind}, {SHORT[s]}", 3, s, paper and s != "ledger", ends=ends)
        for kind in KINDS
        for s in STRATEGIES
    ]


def _averages(experiment: Experiment, combination: Combination, number: int) -> Table:
    groups = {kind: of(experiment, combination, right) for kind, right in KINDS.items()}
    note = (
        f"Averages of {len(groups['right'])} right and {len(groups['wrong'])} wrong merges, the paper's of 20 each. DM "
        "in cells of the receiver's grid. Update time in ms for the further scans together, with the map that the "
        "robot uses; the paper does not say its unit, so that only ratios compare: ours are medians of the merges, "
        "the paper's are of its averages."
        f"{_missing(of(experiment, combination))}"
    )
    cells = " and ".join(f"{size:g} m" for size in combination)
    title = f"Table {number}: SM, DM and update time; cells of {cells} (receiver, donor)"
    rows = [
        _row(quantity, (label,), groups, _average(metric, moment), combination)
        for quantity, label, metric, moment in quantities()
    ]
    cost = COSTS["update"][1]
    rows.append(_row("update_time", ("update time",), groups, _milliseconds(cost), combination, timed=True))
    rows.append(_row("update_ratio", ("update time, 1M = 1",), groups, _ratio(cost), combination, timed=True))
    return Table(f"table{number}", title, note, ("quantity",), columns(), rows)


def quantities(*moments: str) -> Iterator[tuple[str, str, str, str]]:
    """Name, label, metric and moment of what the paper averages, in its order."""
    for metric in METRICS:
        for moment in moments or MOMENTS:
            yield f"{moment}_{metric}", f"{moment} {METRIC_NAMES[metric]}", metric, moment


def _ranges(experiment: Experiment, number: int) -> Table:
    rows = []
    for combination in experiment.settings.combinations:
        groups = {kind: of(experiment, combination, right) for kind, right in KINDS.items()}
        for quantity, label, metric, moment in quantities("end"):
            name = f"{combination.name}_{quantity}"
            row = _row(name, (combination.name, label), groups, _range(metric, moment), combination)
            told = {key: found for key, found in row.paper.items() if not math.isnan(found.low)}
            rows.append(Row(row.name, row.labels, row.cells, told))
    note = (
        "Mean (least–greatest) after the further scans. The paper gives ranges for 0.07-0.07 alone; the means beside "
        f"them are those of its table 1.{_missing(experiment.merges)}"
    )
    title = f"Table {number}: ranges of SM and DM after the further scans"
    return Table(f"table{number}", title, note, ("resolutions", "quantity"), columns(ends=True), rows)


def _row(
    name: str,
    labels: Sequence[str],
    groups: dict[str, list[Merge]],
    sought: Sought,
    combination: Combination | None = None,
    *,
    timed: bool = False,
) -> Row:
    """A number of right and of wrong merges kept in every way; with the paper's where a combination is named."""
    ours, paper = {}, {}
    for kind, merges in groups.items():
        for strategy in STRATEGIES:
            key = f"{kind}_{SHORT[strategy]}"
            ours[key] = sought(merges, strategy)
            told = None if combination is None else _published(combination, kind, strategy, name)
            if told is not None:
                paper[key] = told
    return Row(name, labels, ours, paper, timed=timed)


def _published(combination: Combination, kind: str, strategy: ReversalName, name: str) -> Number | None:
    found, right, quantity = published(), KINDS[kind], name.removeprefix(f"{combination.name}_")
    if quantity != "update_ratio":
        number = found.number(combination, right, SHORT[strategy], quantity)
        return number if name != quantity or number is None else Number(number.value)
    base = found.number(combination, right, SHORT[BASE], "update_time")
    time = found.number(combination, right, SHORT[strategy], "update_time")
    return None if base is None or time is None else Number(time.value / base.value)


def _average(metric: str, moment: str) -> Sought:
    return lambda merges, s: Number(mean([reading(merge.by[s], metric, moment) for merge in merges]))


def _range(metric: str, moment: str) -> Sought:
    return lambda merges, s: ranged([reading(merge.by[s], metric, moment) for merge in merges])


def _milliseconds(cost: Callable[[Cost], float]) -> Sought:
    return lambda merges, s: Number(1e3 * seconds(merges, s, cost))


def _ratio(cost: Callable[[Cost], float]) -> Sought:
    return lambda merges, s: Number(ratio(merges, s, cost))


def _revert_ms(merges: Sequence[Merge], strategy: ReversalName) -> Number:
    return Number(1e3 * mean([merge.by[strategy].revert_s for merge in merges]))


def _missing(merges: Sequence[Merge]) -> str:
    """A sentence on merges of which a metric could not be told, empty where there is none."""
    told = []
    for metric in METRICS:
        count = sum(
            any(math.isnan(reading(kept, metric, moment)) for kept in merge.by.values() for moment in MOMENTS)
            for merge in merges
        )
        told += [f"{METRIC_NAMES[metric]} of {count}"] if count else []
    return f" Too little is shared to tell {' and '.join(told)} of them: they are left out there." if told else ""
