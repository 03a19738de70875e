"""An evaluation as JSON: plain values under documented keys. Times stand apart; all else is the same every time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from mapgraft.evaluation.bench import Bench
from mapgraft.evaluation.certainty import ELLIPSE_95
from mapgraft.evaluation.drawing import PairPlan, Window
from mapgraft.evaluation.evaluating import Evaluation
from mapgraft.evaluation.scored import Placed, Scored
from mapgraft.evaluation.statistics import LEVEL, RESAMPLES
from mapgraft.evaluation.truth import RIGHT_DEG, RIGHT_M
from mapgraft.outputs.provenance import RunProvenance

FORMAT = "mapgraft evaluation 1"


def document(evaluation: Evaluation, provenance: RunProvenance) -> dict[str, Any]:
    """Everything about an evaluation; numbers that are not finite are None."""
    bench = evaluation.bench
    content: dict[str, Any] = finite(
        {
            "format": FORMAT,
            "version": provenance.version,
            "plugins": dict(sorted(provenance.plugins.items())),
            "parameters": parameters_of(bench),
            "config": provenance.config_text,
            "files": [file.told for file in provenance.inputs],
            "robots": [
                {
                    "robot": course.robot,
                    "recording": course.recording,
                    "scans": len(course),
                    "poses": course.poses,
                    "timed": course.stamps_ns is not None,
                }
                for course in bench.courses
            ],
            "remarks": list(evaluation.remarks),
            "procedures": {
                contender.name: {
                    "title": evaluation.titles[contender.name],
                    "decision_table": contender.table.source,
                    "summary": dataclasses.asdict(evaluation.summaries[contender.name]),
                }
                for contender in bench.contenders
            },
            "pairs": [_pair(plan, judged.by) for plan, judged in zip(bench.plans, evaluation.judged, strict=True)],
            "times": _times(evaluation),
        }
    )
    return content


def finite(content: Any) -> Any:
    """The same with None for every number that JSON cannot spell."""
    if isinstance(content, Mapping):
        return {key: finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def parameters_of(bench: Bench) -> dict[str, Any]:
    """What was evaluated, in plain values."""
    settings, alike = bench.settings, bench.other_map_type == bench.map_type
    return {
        **dataclasses.asdict(settings.drawing),
        "map_type": bench.map_type,
        "other_map_type": bench.other_map_type,
        "resolution_m": settings.resolution_m,
        "other_resolution_m": settings.other_resolution_m or (settings.resolution_m if alike else None),
        "rules": None if settings.rules is None else str(settings.rules),
        "matcher": settings.matcher,
        "verifier": settings.verifier,
        "reversal": bench.config.reversal,
        "right_m": RIGHT_M,
        "right_deg": RIGHT_DEG,
        "ellipse_chi2": ELLIPSE_95,
        "resamples": RESAMPLES,
        "level": LEVEL,
    }


def _pair(plan: PairPlan, by: Mapping[str, Scored]) -> dict[str, Any]:
    some = next(iter(by.values()))
    return {
        "pair": plan.number,
        "across": plan.across,
        "receiver": _window(plan.receiver, plan.receiver_turn_rad),
        "donor": _window(plan.donor, plan.donor_turn_rad),
        "overlap": some.overlap,
        "new_wall_m": some.walls_m,
        **{name: _scored(scored) for name, scored in by.items()},
    }


def _window(window: Window, turn_rad: float) -> dict[str, Any]:
    return {
        "robot": window.course.robot,
        "first_scan": window.first,
        "recorded_ns": window.observations[0].recorded_ns,
        "turn_rad": turn_rad,
    }


def _scored(scored: Scored) -> dict[str, Any]:
    return {
        "rule": scored.rule,
        "verdict": scored.verdict,
        "reason": scored.reason,
        "right": None if scored.best is None else scored.best.right,
        "best": _placed(scored.best),
        "accepted": _placed(scored.accepted),
        "state": scored.state or None,
        "state_reason": scored.state_reason,
        "final": _placed(scored.final),
        "ellipse_distance2": scored.distance2,
        "sigma_max_m": scored.sigma_max_m,
        "numbers": dict(scored.numbers),
        "later": dict(scored.later),
    }


def _placed(placed: Placed | None) -> dict[str, Any] | None:
    if placed is None:
        return None
    pose = {"x_m": placed.x_m, "y_m": placed.y_m, "yaw_rad": placed.yaw_rad, "scale": placed.scale}
    return {**pose, "right": placed.right, "error_m": placed.error_m, "error_deg": placed.error_deg}


def _times(evaluation: Evaluation) -> dict[str, Any]:
    return {
        "elapsed_s": evaluation.elapsed_s,
        "procedures": {name: dataclasses.asdict(times) for name, times in evaluation.times.items()},
        "match_ms": {
            name: [None if (s := one.by[name].match_s) is None else 1e3 * s for one in evaluation.judged]
            for name in evaluation.times
        },
    }
