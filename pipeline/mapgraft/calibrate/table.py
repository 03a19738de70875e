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
from mapgraft.calibrate.rules import has_vetoes, plain, rules_of
from mapgraft.calibrate.transfer import SAID_OF
from mapgraft.calibrate.watching import Limit
from mapgraft.pages import readable

_WIDTH = 118


def rules_text(calibration: Calibration) -> str:
    """The decision table as YAML: a configuration with nothing but ``rules``."""
    lines = [*comment(_head(calibration)), "", "rules:"]
    for one in calibration.table:
        if isinstance(one, RuleFit):
            for fit, rule in rules_of(one):
                lines += ["", *comment(told(fit, one), "  "), *spelt(plain(rule))]
        else:
            said = f"It is as it was, and nothing is promised of it: {one.why}."
            lines += ["", *comment([] if one.rule.reject is not None else [said], "  "), *spelt(plain(one.rule))]
    return "\n".join(lines) + "\n"


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
        verdicts = {"guaranteed": "guaranteed", "not refuted": "on an assumption", "none": "no guarantee"}
        for kind, said in rule_fit.transfer.told:
            whose = f"Other buildings, {rule_fit.rule.name!r}, {SAID_OF[kind]}"
            yield f"{whose}: {verdicts[said.verdict]}: {said.reason}."
    yield from (f"Note: {remark}." for remark in calibration.remarks)


def told(fit: Fit, rule_fit: RuleFit) -> list[str]:
    """What labels say of one group, in sentences."""
    said, rule = [_of_threshold(fit.accept)], rule_fit.given.rule_for(fit.group)
    if math.isfinite(fit.accept.value):
        said.append(f"Of the labels here, accepted: wrong {fit.wrong.text}, right {fit.right.text}.")
        if has_vetoes(rule):
            said.append("Vetoes of the rule stay, so that fewer may be merged.")
    if fit.revert is not None:
        said.append(_of_revert(fit.revert, prior_reverts=fit.prior_reverts))
        said.append("Never confirms: the rule does not." if fit.confirm is None else _of_confirm(fit.confirm))
    elif rule.verify is not None and fit.kept is not None:
        reverted, confirmed = (rate.text for rate in fit.kept)
        said.append(
            f"Its verifier {rule.verify.use!r} keeps the limits it had, of which nothing is promised: of the merges "
            f"that were read, right and reverted {reverted}, wrong and confirmed {confirmed}."
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
        return f"Reverts as before: {100 * limit.rate:g} % cannot be promised, {limit.why}."
    said = f"Reverts at {limit.value:.4f}: at most {100 * limit.rate:g} % of right merges within "
    said += f"{limit.observations} observations, by {limit.labels}{_whose(limit)}; of wrong merges {_gain(limit)}"
    return said + ("." if prior_reverts else "; the fall of the probability alone no longer reverts.")


def _of_confirm(limit: Limit) -> str:
    if limit.value is None:
        return f"Never confirms: {100 * limit.rate:g} % cannot be promised, {limit.why}."
    return (
        f"Confirms from {limit.value:.4f} down: at most {100 * limit.rate:g} % of wrong hypotheses within "
        f"{limit.observations} observations, by {limit.labels}{_whose(limit)}; of right merges {_gain(limit)}."
    )


def _whose(limit: Limit) -> str:
    whose = "" if limit.set_by is None or limit.set_by == limit.group else f" of {limit.set_by.name}"
    return whose + (f", of which nobody watched {limit.unwatched}: they count as the worst" if limit.unwatched else "")


def _gain(limit: Limit) -> str:
    return "none to count" if limit.gain is None else limit.gain.text


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
