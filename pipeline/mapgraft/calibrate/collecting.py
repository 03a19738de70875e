"""Rules under which examples are collected: every first hypothesis is merged and watched to the end, right or wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mapgraft.calibrate.given import CALIBRATED, FAR, SEQUENTIAL, untouched
from mapgraft.calibrate.rules import plain
from mapgraft.calibrate.table import comment, spelt
from mapgraft.decision import Rule


def collecting_text(rules: Sequence[Rule]) -> str:
    """The decision table as YAML: the same rules, of which those that search merge whatever comes first.

    What labels are to say of thresholds must not depend on those that there are: a wrong hypothesis that nobody merged
    tells nothing about how long it would have stood.
    """
    lines = comment(
        [
            "For collecting examples only: every first hypothesis is merged, and the sequential test neither reverts "
            "nor confirms. Evaluate recordings with it and --examples, then calibrate. Never make maps by it."
        ]
    )
    lines += ["", "rules:"]
    for rule in rules:
        lines += ["", *spelt(_collecting(rule))]
    return "\n".join(lines) + "\n"


def _collecting(rule: Rule) -> Mapping[str, Any]:
    base = plain(rule)
    if rule.accept is None or rule.verify is None or untouched(rule):
        return base
    metrics: dict[str, dict[str, Any]] = {name: {} for name in (*rule.accept.metric_names, *rule.verify.metric_names)}
    score = {"score": {"score": 1.0}, "accept_above": -FAR, "refuted": -FAR}
    base["accept"] = {"use": CALIBRATED, **score, "metrics": metrics}
    if rule.verify.use == SEQUENTIAL:
        limits = {"revert_at": FAR, "revert_below": 0.0, "confirm": False}
        log = {
            "metrics": list(rule.accept.metric_names),
            "every": rule.verify.every,
        }  # what reverts is seen at each look
        base["verify"] = {**base["verify"], **limits, "log": log}
    base["candidates"] = 1
    return base
