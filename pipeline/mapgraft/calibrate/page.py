"""The page that shows a calibration: what is promised, where nothing is, and the curves behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from mapgraft import __version__
from mapgraft.calibrate.charts import charts
from mapgraft.calibrate.fitting import Calibration, Fit, RuleFit, choice
from mapgraft.calibrate.others import Trial
from mapgraft.calibrate.plots import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.rules import written
from mapgraft.calibrate.table import told
from mapgraft.calibrate.transfer import SAID_OF, Transfer
from mapgraft.calibrate.watching import Limit
from mapgraft.pages import render

_VERDICTS = {
    "guaranteed": ("good", "holds for further buildings"),
    "not refuted": ("wait", "elsewhere on an assumption"),
    "none": ("bad", "no guarantee elsewhere"),
}


def page_of(calibration: Calibration) -> str:
    """The page as HTML that loads nothing."""
    asked, labels = calibration.asked, calibration.labels
    return render(
        "calibration.html",
        version=__version__,
        folders=", ".join(labels.folders),
        tiles=[
            ("labelled examples", f"{len(labels.labelled)}", f"of {len(labels.examples)}"),
            ("buildings", f"{len(labels.buildings)}", ""),
            ("wrong merged, asked for", f"≤ {100 * asked.false_accept:g} %", ""),
            ("wrong confirmed", f"≤ {100 * asked.false_confirm:g} %", ""),
            ("right reverted", f"≤ {100 * asked.false_revert:g} %", ""),
        ],
        rules=[_rule(calibration, rule_fit, number) for number, rule_fit in enumerate(calibration.rules)],
        remarks=calibration.remarks,
        facts=_facts(calibration),
        others=[(one.rule.name, one.why) for one in calibration.others],
        size=(WIDTH, HEIGHT),
        box=(LEFT, RIGHT, TOP, BOTTOM),
    )


def _rule(calibration: Calibration, rule_fit: RuleFit, number: int) -> dict[str, Any]:
    rule, transfer = rule_fit.rule, rule_fit.transfer
    examples = [e for e in calibration.labels.labelled if e.group.rule == rule.name]
    _, setting = choice(examples, rule, calibration.asked)
    score = rule_fit.score
    return {
        "name": rule.name,
        "anchor": f"rule-{number}",
        "score": score.name,
        "terms": [(t.number, f"{t.weight:g}", "logarithm" if t.log else "") for t in score.terms]
        if score.fitted_on
        else [],
        "fitted_on": ", ".join(score.fitted_on),
        "counts": f"{rule_fit.setting} of {rule_fit.examples} labelled examples set the thresholds",
        "rows": [_row(fit) for fit in written(rule_fit)],
        "said": [(fit.group.name, told(fit, rule_fit)) for fit in written(rule_fit)],
        "cells": _cells(rule_fit),
        "elsewhere": [
            (SAID_OF[kind], *_VERDICTS[said.verdict], said.reason[:1].upper() + said.reason[1:])
            for kind, said in transfer.told
        ],
        "tested": _tested(transfer),
        "targets": _targets(transfer),
        "charts": charts(rule_fit, setting),
    }


def _row(fit: Fit) -> dict[str, str]:
    accept = fit.accept
    takes = math.isfinite(accept.value)
    return {
        "group": fit.group.name,
        "accept": f"above {accept.value:.3f}" if takes else f"nothing: {accept.refusal}",
        "tone": "" if takes else "bad",
        "wrong": _share(fit.wrong) if takes else "–",
        "right": _share(fit.right) if takes else "–",
        "revert": _limit(fit.revert, takes, "from"),
        "confirm": _limit(fit.confirm, takes, "down to"),
        "by": "own labels" if accept.own else accept.set_by.name if accept.set_by else "–",
    }


def _limit(limit: Limit | None, takes: bool, word: str) -> str:
    if limit is None:
        return "as it was" if takes else "–"
    if limit.value is None:
        return f"{limit.missing} labels missing" if limit.missing else "not promised"
    return f"{word} {limit.value:.2f}"


def _share(rate: Rate) -> str:
    return rate.text if rate.of else "–"


def _cells(rule_fit: RuleFit) -> list[tuple[str, str, int, str]]:
    """What single environments would set, group by group."""
    return [
        (fit.group.name, cell.environment, cell.wrong, "too few" if cell.value is None else f"{cell.value:.3f}")
        for fit in written(rule_fit)
        if fit.group.resolutions
        for cell in fit.accept.cells
    ]


def _tested(transfer: Transfer) -> list[Sequence[str]]:
    return [
        (
            one.building,
            "too few labels of the others" if one.threshold is None else f"{one.threshold:.3f}",
            _tried(one.wrong),
            _share(one.right),
            _tried(one.confirmed),
            _tried(one.reverted),
            "–" if math.isnan(one.unlike) else f"{one.unlike:.2f}",
        )
        for one in transfer.left_out
    ]


def _tried(trial: Trial | None) -> str:
    """How many went beyond, and how probable so many are."""
    if trial is None or not trial.beyond.of:
        return "–"
    return f"{trial.beyond.count}/{trial.beyond.of}, chance {trial.doubt:.2g}"


def _targets(transfer: Transfer) -> list[Sequence[str]]:
    return [
        (
            one.environment,
            f"{one.examples}",
            _share(one.accepted),
            "–" if math.isnan(one.unlike) else f"{one.unlike:.2f}",
            f"{one.expected:.2f}",
            "refuted" if one.refuted else "not refuted",
        )
        for one in transfer.target
    ]


def _facts(calibration: Calibration) -> list[tuple[str, str]]:
    labels = calibration.labels
    facts = [("folders", ", ".join(labels.folders)), ("buildings", ", ".join(labels.buildings))]
    facts += [(what, f"{count}") for what, count in sorted(labels.counts.items())]
    facts += [(f"labels of {name}", f"{count}") for name, count in sorted(labels.annotators.items())]
    return facts
