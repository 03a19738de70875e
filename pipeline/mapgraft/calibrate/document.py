"""A calibration as JSON: plain values under documented keys, the same every time."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from mapgraft import __version__
from mapgraft.calibrate.acceptance import Threshold
from mapgraft.calibrate.fitting import Calibration, Fit, RuleFit
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.rules import parameters, written
from mapgraft.calibrate.watching import Limit
from mapgraft.evaluation.document import finite

FORMAT = "mapgraft calibration 1"


def document(calibration: Calibration) -> dict[str, Any]:
    """Everything about a calibration; what is infinite or not a number is None."""
    labels = calibration.labels
    content: dict[str, Any] = finite(
        {
            "format": FORMAT,
            "version": __version__,
            "asked": dataclasses.asdict(calibration.asked),
            "labels": {
                "folders": labels.folders,
                "examples": len(labels.examples),
                "labelled": len(labels.labelled),
                "buildings": labels.buildings,
                "counts": dict(sorted(labels.counts.items())),
                "annotators": dict(sorted(labels.annotators.items())),
            },
            "remarks": list(calibration.remarks),
            "rules": [_rule(rule_fit) for rule_fit in calibration.rules],
            "not_calibrated": [{"rule": one.rule.name, "why": one.why} for one in calibration.others],
        }
    )
    return content


def _rule(rule_fit: RuleFit) -> dict[str, Any]:
    rule, known, transfer = rule_fit.rule, rule_fit.quality, rule_fit.transfer
    return {
        "rule": rule.name,
        "examples": rule_fit.examples,
        "setting_thresholds": rule_fit.setting,
        "score": {
            "terms": parameters(rule_fit.score),
            "intercept": rule_fit.score.intercept,
            "fitted_on": list(rule_fit.score.fitted_on),
        },
        "groups": [_fit(fit, has_rule=fit in written(rule_fit)) for fit in rule_fit.fits],
        "by_quality": [{"quality": name, **_threshold(limit)} for name, limit in rule_fit.by_quality],
        "area": dataclasses.asdict(known.area),
        "curve": [dataclasses.asdict(point) for point in known.points],
        "probability": dataclasses.asdict(known.curve),
        "reliability": None if known.honesty is None else dataclasses.asdict(known.honesty),
        "other_buildings": dataclasses.asdict(transfer),
    }


def _fit(fit: Fit, *, has_rule: bool) -> dict[str, Any]:
    return {
        **_group(fit.group),
        "has_rule": has_rule,
        "accept": _threshold(fit.accept),
        "accepted_wrong": dataclasses.asdict(fit.wrong),
        "accepted_right": dataclasses.asdict(fit.right),
        "accepted_right_by_overlap": {name: dataclasses.asdict(rate) for name, rate in fit.overlaps},
        "revert": _limit(fit.revert),
        "fall_of_probability_reverts": fit.prior_reverts,
        "confirm": _limit(fit.confirm),
        "kept_right_reverted": None if fit.kept is None else dataclasses.asdict(fit.kept[0]),
        "kept_wrong_confirmed": None if fit.kept is None else dataclasses.asdict(fit.kept[1]),
    }


def _group(group: Group) -> Mapping[str, Any]:
    return {
        "group": group.name,
        "receiver_type": group.receiver_type or None,
        "donor_type": group.donor_type or None,
        "receiver_resolution_m": group.own_m,
        "donor_resolution_m": group.other_m,
        "reversal": group.reversal or None,
    }


def _threshold(limit: Threshold) -> dict[str, Any]:
    return {
        "above": limit.value,
        "rate": limit.rate,
        "set_by": None if limit.set_by is None else limit.set_by.name,
        "wrong": limit.wrong,
        "missing": limit.missing,
        "contested": limit.contested,
        "environments": [dataclasses.asdict(cell) for cell in limit.cells],
        "raised_by": limit.raised_by or None,
    }


def _limit(limit: Limit | None) -> dict[str, Any] | None:
    if limit is None:
        return None
    return {
        "at": limit.value,
        "rate": limit.rate,
        "set_by": None if limit.set_by is None else limit.set_by.name,
        "labels": limit.labels,
        "missing": limit.missing,
        "why_none": limit.why or None,
        "unwatched": limit.unwatched,
        "within_observations": limit.observations,
        "environments": [dataclasses.asdict(share) for share in limit.environments],
        "beyond": None if limit.harm is None else dataclasses.asdict(limit.harm),
        "beyond_of_the_others": None if limit.gain is None else dataclasses.asdict(limit.gain),
    }
