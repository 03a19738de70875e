"""The rules that a calibration makes of one: the same procedure for each group of maps, with limits that labels set."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

from mapgraft.calibrate.acceptance import Threshold
from mapgraft.calibrate.conditions import together
from mapgraft.calibrate.fitting import Fit, RuleFit
from mapgraft.calibrate.given import CALIBRATED
from mapgraft.calibrate.scoring import Score
from mapgraft.calibrate.verifier import HARDLY, confirm_at, never_confirming
from mapgraft.decision import Condition, Measuring, Rule, Verification

_LOWEST: Final = -1e6  # a score below which nobody asks whether a hypothesis is ambiguous
_OWN_NUMBERS: Final = ("score", "margin", "evidence")  # what a match tells of itself; all others are metrics
_OWN_LIMIT: Final = {"support_min": 0}  # a veto by the limit that a metric names itself; {} only measures it


def written(rule_fit: RuleFit) -> list[Fit]:
    """The groups that get a rule of their own, in the order in which they are looked at; the last takes all others.

    A group of which no maps meet the rule's conditions gets none: its labels are of a rule that had others.
    """
    own = (fit for fit in rule_fit.fits if fit.accept.own or not fit.group.resolutions)
    return [fit for fit in own if _when(rule_fit, fit) is not None]


def rules_of(rule_fit: RuleFit) -> Iterator[tuple[Fit, Rule]]:
    """The rules that take the place of one, each with what labels say of it.

    None applies where the rule did not, and together they apply wherever it did.
    """
    for fit in written(rule_fit):
        before = rule_fit.given.rule_for(fit.group)
        accept = _accept(rule_fit, before.procedure.accept, fit.accept)
        rule = before.model_copy(
            update={
                "name": fit.group.rule_name(rule_fit.rule.name),
                "when": _when(rule_fit, fit),
                "accept": Measuring.model_validate(accept),
                "verify": Verification.model_validate(_verify(before.procedure.verify, fit)),
                "reverse": rule_fit.rule.reverse,
                "priority": rule_fit.rule.priority,
                "candidates": before.candidates if "limits" in accept else 1,  # limits compare it with others
            }
        )
        yield fit, rule


def plain(rule: Rule) -> dict[str, Any]:
    """A rule as a mapping, without what is as it is by default."""
    given: dict[str, Any] = rule.model_dump(exclude_defaults=True)
    if "reverse" in given:
        given["reverse"] = {"allow": list(rule.reverse.allow)}
    return given


def parameters(score: Score) -> dict[str, Any]:
    """A score as the acceptor takes it."""
    return {term.number: term.parameters for term in score.terms}


def has_vetoes(rule: Rule) -> bool:
    """Whether something beside the score can keep a hypothesis from being merged that labels would let through."""
    accept = rule.procedure.accept
    return "limits" in _limits(accept) or bool(_vetoes(accept))


def _when(rule_fit: RuleFit, fit: Fit) -> dict[str, Condition] | None:
    if not fit.group.receiver_type:
        return dict(rule_fit.rule.when)  # all that the rule is for, even where that is nothing
    return together(rule_fit.rule.when, rule_fit.given.rule_for(fit.group).when, fit.group.conditions)


def _accept(rule_fit: RuleFit, before: Measuring, limit: Threshold) -> dict[str, Any]:
    score = rule_fit.score
    accept: dict[str, Any] = {"use": CALIBRATED, "score": parameters(score)}
    if score.intercept:
        accept["intercept"] = score.intercept
    if math.isfinite(limit.value):
        accept["accept_above"] = limit.value
        even = rule_fit.quality.curve.reaches(0.5)
        if even < limit.value:
            accept["ambiguous_above"] = min(float(f"{max(even, _LOWEST):.4g}"), limit.value)
    heads = [term.number.partition(".")[0] for term in score.terms]
    measured = [*before.metric_names, *(head for head in heads if head not in _OWN_NUMBERS)]  # the verifier may need it
    metrics: dict[str, Any] = {name: {} for name in measured}
    return {**accept, **_limits(before), "metrics": metrics | _vetoes(before)}


def _limits(before: Measuring) -> dict[str, Any]:
    """What an acceptor forbids whatever the score is, beside its vetoes, as the acceptor ``calibrated`` takes it."""
    told = before.parameters
    if before.use == "thresholds":
        given = {name: value for name, value in told.items() if value is not None and value != {}}
        return {"limits": given} if given else {}
    return {name: told[name] for name in ("limits", "refuted") if name in told}


def _vetoes(before: Measuring) -> dict[str, Any]:
    """The limits on metrics that an acceptor has beside what it goes by, as the acceptor ``calibrated`` takes them."""
    told = before.parameters.get("metrics", {})
    if before.use == CALIBRATED:
        return {name: dict(limits) for name, limits in told.items() if limits}
    if before.use != "posterior":
        return {}
    judged = before.parameters.get("metric", "posterior")
    return {name: dict(limits) or dict(_OWN_LIMIT) for name, limits in told.items() if limits or name != judged}


def _verify(before: Verification, fit: Fit) -> dict[str, Any]:
    verify: dict[str, Any] = before.model_dump(exclude_defaults=True)
    if fit.revert is None:
        return verify
    if fit.revert.value is not None:
        verify["revert_at"] = fit.revert.value
        if not fit.prior_reverts:
            verify["revert_below"] = 0.0
        if confirm_at(verify) > -HARDLY:  # the verifier wants it below the limit of reversal, which is never below 0
            verify["confirm_at"] = -HARDLY
    if fit.confirm is not None and fit.confirm.value is None:
        return never_confirming(verify)
    return verify if fit.confirm is None else {**verify, "confirm_at": fit.confirm.value}
