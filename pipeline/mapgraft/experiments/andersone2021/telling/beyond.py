"""Tables of what the paper does not tabulate: what a revert leaves, what was drawn, and how wrong merges are told."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from mapgraft.config import ReversalName
from mapgraft.experiments.andersone2021.outcome import Experiment, Kept, Merge
from mapgraft.experiments.andersone2021.settings import METRICS, SHORT, STRATEGIES
from mapgraft.experiments.andersone2021.telling.as_published import (
    COSTS,
    KINDS,
    METRIC_NAMES,
    draws,
    mean,
    of,
    ranged,
    ratio,
    shared_draws,
)
from mapgraft.experiments.andersone2021.telling.detection import (
    POOLED,
    WATCHED,
    Curve,
    Threshold,
    Transfer,
    groups,
    metric_values,
    shipped_limits,
    verdicts,
)
from mapgraft.experiments.andersone2021.telling.tables import Column, Number, Row, Table

KEPT_IN: Final[dict[str, str]] = {strategy: SHORT[strategy] for strategy in STRATEGIES} | {WATCHED: "our rules"}
IN_VIEW: Final = (
    "The coefficients of mapgraft's rules are fitted on simulated buildings alone. But the logs of Intel, ACES, "
    "Belgioioso and Freiburg 101 were in view when the rules were built, and some thresholds were looked at on them "
    "(docs/matching.md says which): on those four this is no held-out test."
)
_LEFT: Final[dict[str, tuple[str, Callable[[Kept], float]]]] = {
    "known": ("cells known", lambda kept: kept.leftovers.known),
    "lost": ("lost", lambda kept: kept.leftovers.lost),
    "contaminated": ("left contaminated", lambda kept: kept.exactness.cells_contaminated),
    "touched": ("another probability", lambda kept: kept.leftovers.touched),
    "alien": ("known, would not be", lambda kept: kept.leftovers.alien),
    "changed": ("other class", lambda kept: kept.leftovers.changed),
}


def ways_table(experiment: Experiment, curves: Sequence[Curve]) -> Table:
    """The three ways of keeping a merge in one look."""
    rows = []
    for strategy in STRATEGIES:
        kept = [merge.by[strategy] for merge in experiment.merges]
        costs = {name: ratio(experiment.merges, strategy, COSTS[name][1]) for name in ("update", "compared")}
        cells = {name: Number(value) for name, value in costs.items()}
        cells |= {name: Number(mean([_LEFT[name][1](one) for one in kept])) for name in ("lost", "contaminated")}
        cells |= {
            curve.number: Number(curve.area.value, curve.area.low, curve.area.high)
            for curve in curves
            if (curve.source, curve.moment, curve.group) == (strategy, "end", POOLED)
        }
        cells["identical"] = Number(sum(one.leftovers.identical for one in kept))
        rows.append(Row(strategy, (SHORT[strategy],), cells, {}))
    note = (
        f"Of all {len(experiment.merges)} merges, right and wrong. Cost of an update with the robot's map, and with "
        "the map that metrics look at as well; how well SM and DM tell wrong merges in the end (area under the curve); "
        "and what a revert leaves: cells per merge that are lost, and that still hold the donor's share, and how many "
        "maps have the same bytes as if nothing had ever been merged. In brackets: 95 % intervals. "
        f"{shared_draws(experiment)}"
    )
    columns = [
        Column("update", "update, 1M = 1", 2, timed=True),
        Column("compared", "with metrics", 2, timed=True),
        Column("similarity", "SM, area", ends=True),
        Column("distance", "DM, area", ends=True),
        Column("lost", "cells lost", 0),
        Column("contaminated", "contaminated", 0),
        Column("identical", "same bytes", 0),
    ]
    return Table("ways", "The three ways in one look", note, ("kept in",), columns, rows)


def reversal_table(experiment: Experiment) -> Table:
    """What is left of a merge after its revert, against the map of a robot that never merged."""
    rows = []
    for combination in experiment.settings.combinations:
        for kind, right in KINDS.items():
            merges = of(experiment, combination, right)
            rows += [_reversal_row(combination.name, kind, strategy, merges) for strategy in STRATEGIES if merges]
    note = (
        "Means per merge, in cells of the receiver's map, held against the map of a robot that made the same scans and "
        "never merged. Lost: known there and unknown after the revert. Left contaminated: cells that still hold the "
        "donor's share, as the reversal itself states it. Same bytes: merges after which the encoded map is equal, "
        "byte for byte."
    )
    counts = [Column(name, title, 0) for name, (title, _) in _LEFT.items()]
    columns = [Column("merges", "merges", 0), *counts, Column("identical", "same bytes", 0)]
    title = "After the revert: what is lost and what is left"
    return Table("reversal", title, note, ("resolutions", "merge", "kept in"), columns, rows)


def searches_table(experiment: Experiment) -> Table:
    """How many pairs were drawn, and what became of them."""
    rows = []
    for search in experiment.searches:
        accepted, name = search.right + search.wrong, search.combination.name
        counts = {name: getattr(search, name) for name in ("drawn", "unmatched", "refused", "right", "wrong")}
        share = 100.0 * search.wrong / accepted if accepted else math.nan
        row = Row.plain(name, (name,), **counts, wrong_share=share)
        rows.append(replace(row, cells={**row.cells, **_places(of(experiment, search.combination))}))
    rows.append(Row(POOLED, (POOLED,), _places(experiment.merges), {}))
    note = (
        f"Pairs of partial maps that were drawn until there were enough, matched by {experiment.matcher} and accepted "
        f"at SM ≥ {experiment.similarity_min:g}. Merges beyond what was asked for are counted here and not used. Also "
        "pairs that share nothing are drawn. Overlap: cells that both maps know, by the true poses, over those of the "
        "smaller map, mean (least–greatest) of the merges that are used; and of how many different draws these are."
    )
    names = {"drawn": "drawn", "unmatched": "no hypothesis", "refused": "refused", "right": "right", "wrong": "wrong"}
    columns = [Column(name, title, 0) for name, title in names.items()]
    columns.append(Column("wrong_share", "wrong, % of the accepted", 0))
    columns += [Column(f"{kind}_overlap", f"overlap of {kind} ones", 2, ends=True) for kind in KINDS]
    columns += [Column(f"{kind}_draws", f"draws of {kind} ones", 0) for kind in KINDS]
    return Table("searches", "What was drawn", note, ("resolutions",), columns, rows)


def _places(merges: Sequence[Merge]) -> dict[str, Number]:
    """How much the maps of merges share in truth, and of how many different draws they are, by kind."""
    overlaps = {
        f"{kind}_overlap": ranged([merge.overlap for merge in merges if merge.right == right])
        for kind, right in KINDS.items()
    }
    return overlaps | {f"{kind}_draws": Number(draws(merges, right)) for kind, right in KINDS.items()}


def detection_table(experiment: Experiment, curves: Sequence[Curve]) -> Table:
    """Areas and best thresholds of SM and DM, however a merge is kept, of all merges and by resolutions."""
    rows = [
        _curve_row(curve, (curve.group, f"{curve.moment} {METRIC_NAMES[curve.number]}", KEPT_IN[curve.source]))
        for curve in curves
        if curve.number in METRICS and curve.source != WATCHED
    ]
    note = (
        "Area under the receiver operating characteristic, right against wrong merges, with a 95 % interval (bootstrap "
        "over stretches of the recording; where nothing overlaps, that of Clopper and Pearson for so many pairs). A "
        "merge is called wrong when its SM is below the threshold, its DM above. The best threshold has fewest errors: "
        "false positives (right merges that would be reverted) and false negatives (wrong ones that would be kept). It "
        "is chosen on the very merges that it is counted on; the next table has thresholds that are not. All merges "
        f"passed SM ≥ {experiment.similarity_min:g} at first, which takes away from what SM can tell. "
        f"{shared_draws(experiment)}"
    )
    title = "How well SM and DM tell wrong merges"
    return Table("detection", title, note, ("resolutions", "number", "kept in"), _curve_columns(), rows)


def evidence_table(experiment: Experiment, curves: Sequence[Curve]) -> Table:
    """The same of everything that our own rules look at, of all merges together; details are left out."""
    found = [
        curve
        for curve in curves
        if curve.source == WATCHED and curve.group == POOLED and ("." not in curve.number or _is_verifiers(curve))
    ]
    found.sort(key=lambda curve: (curve.moment == "end", -curve.area.value, curve.number))
    rows = [
        _curve_row(curve, (curve.moment, curve.number + ("" if curve.area.told else " *"), _direction(curve)))
        for curve in found
    ]
    rules = ", ".join(sorted({merge.watched.rule for merge in experiment.merges if merge.watched.rule}))
    note = (
        f"All merges together, watched by {rules or 'no rule'}: at the merge, and at the end or when they were "
        "reverted. * It was not known beforehand which way the number should go; the better one is told. "
        f"{shared_draws(experiment)} {IN_VIEW}"
    )
    title = "How well the evidence of our own rules tells wrong merges"
    return Table("evidence", title, note, ("moment", "number", "right ones are"), _curve_columns(), rows)


def resolution_table(experiment: Experiment, curves: Sequence[Curve]) -> Table:
    """How DM and its threshold move with the resolution, in cells and in metres."""
    rows = []
    for combination in experiment.settings.combinations:
        for strategy in STRATEGIES:
            cells: dict[str, Number] = {}
            for kind, right in KINDS.items():
                values = metric_values(of(experiment, combination, right), "distance", "end", strategy)
                cells[f"{kind}_cells"] = ranged(values.tolist())
                cells[f"{kind}_m"] = ranged((values * combination.own_m).tolist())
            for curve in curves:
                if (curve.number, curve.moment, curve.source) == ("distance", "end", strategy) and (
                    curve.group == combination.name
                ):
                    cells["threshold_cells"] = Number(curve.threshold.value)
                    cells["threshold_m"] = Number(curve.threshold.value * combination.own_m)
            name = f"{combination.name}_{SHORT[strategy]}"
            rows.append(Row(name, (combination.name, SHORT[strategy]), cells, {}))
    note = (
        "DM after the further scans, mean (least–greatest), in cells of the receiver's grid and in metres, and the "
        "best threshold of each combination. What stays the same from one resolution to another in cells does not in "
        "metres, and the reverse."
    )
    columns = [
        Column("right_cells", "right, cells", 2, ends=True),
        Column("wrong_cells", "wrong, cells", 2, ends=True),
        Column("threshold_cells", "threshold, cells", 2),
        Column("right_m", "right, m", 3, ends=True),
        Column("wrong_m", "wrong, m", 3, ends=True),
        Column("threshold_m", "threshold, m", 3),
    ]
    title = "How DM moves with the resolution"
    return Table("resolution", title, note, ("resolutions", "kept in"), columns, rows)


def thresholds_table(experiment: Experiment, transfers: Sequence[Transfer]) -> Table:
    """Errors of thresholds on merges that had no part in choosing them."""
    rows = []
    for metric in METRICS:
        for strategy in STRATEGIES:
            found = shipped_limits(experiment.merges, metric, strategy)
            labels = (METRIC_NAMES[metric], SHORT[strategy], "everything: the metric's own limit")
            rows.append(_errors_row(f"{metric}_{strategy}_shipped", labels, found))
    for transfer in transfers:
        labels = (transfer.rule.title, SHORT[transfer.strategy], transfer.held_out)
        limits = list(transfer.thresholds.values())
        name = f"{transfer.rule.name}_{transfer.strategy}_{transfer.held_out.replace(' ', '_')}"
        row = _errors_row(name, labels, transfer)
        threshold = {"threshold": Number(mean(limits), min(limits), max(limits))}
        rows.append(Row(name, labels, {**threshold, **row.cells}, {}))
    note = (
        "Best thresholds after the further scans, chosen on a part of the merges and counted on the part held out, "
        "each part in turn. Half of the draws: a pair of windows is in one half with all its resolutions. One "
        "combination: for resolutions that were not seen. The metrics' own limits rest on the averages that the paper "
        "prints, and on no merge of ours. √m: DM in cells times the root of the size of a cell, the geometric mean of "
        "cells and metres."
    )
    columns = [
        Column("threshold", "threshold", 3, ends=True),
        Column("false_positives", "false positives", 0),
        Column("false_negatives", "false negatives", 0),
        Column("of", "of merges", 0),
    ]
    title = "Thresholds that were chosen elsewhere"
    return Table("thresholds", title, note, ("number", "kept in", "held out"), columns, rows)


def verdicts_table(experiment: Experiment) -> Table:
    """What our own rules' verifier did with the merges that the paper's rules had accepted."""
    rows = []
    for group in groups(experiment):
        combination = next((c for c in experiment.settings.combinations if c.name == group), None)
        for kind, right in KINDS.items():
            counts = verdicts(experiment, combination, right)
            merges = len(of(experiment, combination, right))
            mistaken = counts["revert" if right else "confirm"]
            rows.append(Row.plain(f"{group}_{kind}", (group, kind), merges=merges, **counts, mistaken=mistaken))
    note = (
        "Verdicts after the further scans, or before where a merge was reverted. Kept: not enough was seen to say "
        "either. Mistaken: right merges that were reverted, and wrong ones that were confirmed. "
        f"{shared_draws(experiment)} {IN_VIEW}"
    )
    names = {"merges": "merges", "revert": "reverted", "confirm": "confirmed", "keep": "kept", "unseen": "no rule"}
    names["mistaken"] = "mistaken"
    columns = [Column(name, title, 0) for name, title in names.items()]
    title = "What our own rules made of the merges"
    return Table("verdicts", title, note, ("resolutions", "merge"), columns, rows)


def _reversal_row(combination: str, kind: str, strategy: ReversalName, merges: Sequence[Merge]) -> Row:
    kept = [merge.by[strategy] for merge in merges]
    cells = {name: Number(mean([count(one) for one in kept])) for name, (_, count) in _LEFT.items()}
    counts = {"merges": Number(len(kept)), "identical": Number(sum(one.leftovers.identical for one in kept))}
    name, labels = f"{combination}_{kind}_{SHORT[strategy]}", (combination, kind, SHORT[strategy])
    return Row(name, labels, {**counts, **cells}, {})


def _curve_row(curve: Curve, labels: Sequence[str]) -> Row:
    found, best = curve.area, curve.threshold
    cells = {
        "area": Number(found.value, found.low, found.high),
        "threshold": Number(best.value),
        "false_positives": Number(best.false_positives),
        "false_negatives": Number(best.false_negatives),
        "right": Number(found.right),
        "wrong": Number(found.wrong),
    }
    return Row("_".join((curve.group, curve.moment, curve.number, curve.source)), labels, cells, {})


def _curve_columns() -> list[Column]:
    return [
        Column("area", "area under the curve", 3, ends=True),
        Column("threshold", "best threshold", 3),
        Column("false_positives", "false positives", 0),
        Column("false_negatives", "false negatives", 0),
        Column("right", "right merges", 0),
        Column("wrong", "wrong merges", 0),
    ]


def _errors_row(name: str, labels: Sequence[str], found: Threshold | Transfer) -> Row:
    counts = {"false_positives": found.false_positives, "false_negatives": found.false_negatives, "of": found.of}
    return Row.plain(name, labels, **counts)


def _is_verifiers(curve: Curve) -> bool:
    return curve.number.startswith("verifier.")


def _direction(curve: Curve) -> str:
    return "higher" if curve.area.better == "higher" else "lower"


def further_tables(experiment: Experiment, curves: Sequence[Curve], transfers: Sequence[Transfer]) -> Iterator[Table]:
    """All tables of this module, in the order in which they tell the story."""
    yield ways_table(experiment, curves)
    yield reversal_table(experiment)
    yield detection_table(experiment, curves)
    yield thresholds_table(experiment, transfers)
    yield resolution_table(experiment, curves)
    yield evidence_table(experiment, curves)
    yield verdicts_table(experiment)
    yield searches_table(experiment)
