"""The decision table that comes of a calibration: ordinary rules, with what labels say of them in comments."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ruamel.yaml import YAML

from mapgraft import __version__
from mapgraft.calibrate.acceptance import Threshold
from mapgraft.calibrate.fitting import Calibration, Fit, RuleFit
from mapgraft.calibrate.scoring import Score
from mapgraft.calibrate.watching import Limit
from mapgraft.decision import Rule
from mapgraft.pages import readable

_WIDTH = 118
_LOWEST = -1e6  # a score below which nobody asks whether a hypothesis is ambiguous
_OWN_NUMBERS = ("score", "margin", "evidence")  # what a match tells of itself; all others are metrics


def rules_text(calibration: Calibration) -> str:
    """The decision table as YAML: a configuration with nothing but ``rules``."""
    lines = [*comment(_head(calibration)), "", "rules:"]
    for rule_fit in calibration.rules:
        for fit in written(rule_fit):
            lines += ["", *comment(told(fit, rule_fit), "  "), *spelt(_rule(rule_fit, fit))]
    for rule in calibration.others:
        said = "No labels tell of this rule: it is as it was, and nothing is promised of it."
        lines += ["", *comment([] if rule.reject else [said], "  "), *spelt(plain(rule))]
    return "\n".join(lines) + "\n"


def written(rule_fit: RuleFit) -> list[Fit]:
    """The groups that get a rule of their own, in the order in which they are looked at; the last takes all others."""
    return [fit for fit in rule_fit.fits if fit.accept.own or not fit.group.resolutions]


def _head(calibration: Calibration) -> Iterator[str]:
    asked, labels = calibration.asked, calibration.labels
    yield (
        f"Made by mapgraft {__version__} calibrate from {', '.join(labels.folders)}: {len(labels.labelled)} labelled "
        f"examples of {', '.join(labels.buildings)}. Use it with mapgraft run -c, or decide -c."
    )
    yield (
        f"Promised, where labels are enough: at most {100 * asked.false_accept:g} % of wrong hypotheses merged, "
        f"{100 * asked.false_confirm:g} % of wrong ones confirmed, {100 * asked.false_revert:g} % of right merges "
        "reverted, of pairs drawn as the labelled ones were."
    )
    for rule_fit in calibration.rules:
        transfer = rule_fit.transfer
        said = {"guaranteed": "guaranteed", "not refuted": "on an assumption", "none": "no guarantee"}
        yield f"Other buildings, {rule_fit.rule.name!r}: {said[transfer.verdict]}: {transfer.reason}."
    yield from (f"Note: {remark}." for remark in calibration.remarks)


def told(fit: Fit, rule_fit: RuleFit) -> list[str]:
    """What labels say of one group, in sentences."""
    said = [_of_threshold(fit.accept)]
    if math.isfinite(fit.accept.value):
        said.append(f"Of the labels here, accepted: wrong {fit.wrong.text}, right {fit.right.text}.")
    verify = rule_fit.rule.verify
    if fit.revert is not None and fit.confirm is not None:
        said.append(_of_revert(fit.revert, prior_reverts=fit.prior_reverts))
        said.append(_of_confirm(fit.confirm))
    elif verify is not None and fit.kept is not None:
        reverted, confirmed = (rate.text for rate in fit.kept)
        said.append(
            f"Its verifier {verify.use!r} keeps the limits it had, of which nothing is promised: of the merges that "
            f"were read, right and reverted {reverted}, wrong and confirmed {confirmed}."
        )
    return said


def _of_threshold(limit: Threshold) -> str:
    asked = f"{100 * limit.rate:g} %"
    if limit.set_by is None:
        return (
            f"Accepts nothing: {asked} cannot be promised from {limit.wrong} wrong hypotheses, "
            f"{limit.missing} more are needed."
        )
    if not math.isfinite(limit.value):
        return f"Accepts nothing: {limit.refusal}."
    whose = f"{limit.wrong} wrong hypotheses"
    by = ", ".join(f"{cell.environment} {cell.wrong}" for cell in limit.cells)
    said = f"Accepts above {limit.value:.4f}: at most {asked} of wrong hypotheses, by {whose} ({by})"
    said += "" if limit.own else f" of {limit.set_by.name}, because of its own {limit.missing} are missing"
    return f"{said}; raised by {limit.raised_by}." if limit.raised_by else f"{said}."


def _of_revert(limit: Limit, *, prior_reverts: bool) -> str:
    if limit.value is None:
        why = f"{limit.labels} right merges were watched, {limit.missing} more are needed"
        why = why if limit.missing else "the run that was read has reverted too many right merges"
        return f"Reverts as before: {100 * limit.rate:g} % cannot be promised, {why}."
    said = f"Reverts at {limit.value:.4f}: at most {100 * limit.rate:g} % of right merges within "
    said += f"{limit.observations} observations, by {limit.labels}{_whose(limit)}; of wrong merges {_gain(limit)}"
    return said + ("." if prior_reverts else "; the fall of the probability alone no longer reverts.")


def _of_confirm(limit: Limit) -> str:
    if limit.value is None:
        why = f"{limit.labels} wrong hypotheses were watched, {limit.missing} more are needed"
        why = why if limit.missing else "too many wrong merges look right"
        return f"Never confirms: {100 * limit.rate:g} % cannot be promised, {why}."
    return (
        f"Confirms from {limit.value:.4f} down: at most {100 * limit.rate:g} % of wrong hypotheses within "
        f"{limit.observations} observations, by {limit.labels}{_whose(limit)}; of right merges {_gain(limit)}."
    )


def _whose(limit: Limit) -> str:
    return "" if limit.set_by is None or limit.set_by == limit.group else f" of {limit.set_by.name}"


def _gain(limit: Limit) -> str:
    return "none to count" if limit.gain is None else limit.gain.text


def _rule(rule_fit: RuleFit, fit: Fit) -> dict[str, Any]:
    """A rule of the table for one group."""
    base = plain(rule_fit.rule)
    base["name"] = fit.group.rule_name(rule_fit.rule.name)
    base["when"] = {**base.get("when", {}), **fit.group.conditions}
    base["accept"] = _accept(rule_fit, fit.accept)
    base["verify"] = {**base["verify"], **_verify(fit)}
    base["candidates"] = 1
    return base


def _accept(rule_fit: RuleFit, limit: Threshold) -> dict[str, Any]:
    accept: dict[str, Any] = {"use": "calibrated", "score": parameters(rule_fit.score)}
    if rule_fit.score.intercept:
        accept["intercept"] = rule_fit.score.intercept
    if math.isfinite(limit.value):
        accept["accept_above"] = limit.value
        even = rule_fit.quality.curve.reaches(0.5)
        if even < limit.value:
            accept["ambiguous_above"] = min(float(f"{max(even, _LOWEST):.4g}"), limit.value)
    return {**accept, "metrics": _metrics(rule_fit)}


def parameters(score: Score) -> dict[str, Any]:
    """A score as the acceptor takes it."""
    return {term.number: term.parameters for term in score.terms}


def _metrics(rule_fit: RuleFit) -> dict[str, Any]:
    """What is measured: what the score needs, and the vetoes of an acceptor that goes by a probability."""
    base = rule_fit.rule.accept
    metrics: dict[str, Any] = {}
    for term in rule_fit.score.terms:
        head = term.number.partition(".")[0]
        if head not in _OWN_NUMBERS:
            metrics[head] = {}
    if base is not None and base.use in ("posterior", "calibrated") and isinstance(base.metrics, dict):
        metrics |= {name: dict(limits) for name, limits in base.metrics.items() if limits}
    return metrics


def _verify(fit: Fit) -> dict[str, Any]:
    changed: dict[str, Any] = {}
    if fit.revert is None or fit.confirm is None:
        return changed
    if fit.revert.value is not None:
        changed["revert_at"] = fit.revert.value
        if not fit.prior_reverts:
            changed["revert_below"] = 0.0
    if fit.confirm.value is None:
        return {**changed, "confirm": False}
    return {**changed, "confirm_at": fit.confirm.value}


def plain(rule: Rule) -> dict[str, Any]:
    """A rule as a mapping, without what is as it is by default."""
    given: dict[str, Any] = rule.model_dump(exclude_defaults=True)
    if "reverse" in given:
        given["reverse"] = {"allow": list(rule.reverse.allow)}
    return given


def spelt(rule: Mapping[str, Any]) -> list[str]:
    """The lines of one rule as an entry of the list ``rules``."""
    buffer = io.StringIO()
    writer = YAML(typ="rt")
    writer.default_flow_style = False
    writer.width = _WIDTH
    writer.indent(mapping=2, sequence=4, offset=2)
    writer.dump([dict(rule)], buffer)
    return buffer.getvalue().rstrip("\n").split("\n")


def comment(sentences: Iterable[str], indent: str = "") -> list[str]:
    """Sentences as comment lines; nothing in them can end a comment."""
    lines = []
    for sentence in sentences:
        clean = " ".join(readable(sentence).split())
        lines += [f"{indent}# {line}" for line in textwrap.wrap(clean, _WIDTH - len(indent) - 2)]
    return lines
