"""A pairing as a JSON document: the same for ``--json`` and for ``match.json``."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from mapgraft.contracts import Measurement
from mapgraft.matching.pairing import Hypothesis, Pairing
from mapgraft.matching.pixels import Similarity, in_pixels, planar
from mapgraft.matching.ready_map import ReadyMap

FORMAT_VERSION = 1


def document(pairing: Pairing) -> dict[str, Any]:
    """What came of a pairing: the same for the same files, without the time it took.

    There is a transform at the top only when it was accepted; numbers that are none are null.
    """
    accepted, rule = pairing.accepted, pairing.ruling.rule
    return {
        "format_version": FORMAT_VERSION,
        "a": _map(pairing.a),
        "b": _map(pairing.b),
        "verdict": pairing.verdict,
        "accepted": accepted is not None,
        "reason": pairing.reason,
        **(_transform(pairing, accepted) if accepted else {"T_a_b": None, "scale": None, "T_px_b2a": None}),
        "rule": None if rule is None else rule.name,
        "findings": [dataclasses.asdict(finding) for finding in pairing.ruling.findings],
        "procedure": _procedure(pairing),
        "hypotheses": [_hypothesis(pairing, hypothesis) for hypothesis in pairing.hypotheses],
    }


def pixels_of(pairing: Pairing, hypothesis: Hypothesis) -> Similarity | None:
    """Where b's pixels lie among a's under a hypothesis; None where one of the two has no pixels."""
    a, b = pairing.a.image, pairing.b.image
    if a is None or b is None:
        return None
    return in_pixels(a, b, planar(hypothesis.match.T_receiver_donor, hypothesis.match.scale))


def number(value: float | None) -> float | None:
    """The number, or None for one that JSON does not know."""
    return value if value is not None and math.isfinite(value) else None


def _map(map_: ReadyMap) -> dict[str, Any]:
    metadata = map_.metadata
    return {
        "path": str(map_.path),
        "format": map_.format,
        "map_type": map_.map_type.name,
        "resolution_m": metadata.resolution_m,
        "known_area_m2": metadata.known_area_m2,
        "bounds_m": None if metadata.bounds_m is None else list(metadata.bounds_m),
        "width_px": map_.image.width if map_.image else None,
        "height_px": map_.image.height if map_.image else None,
        "remarks": list(map_.remarks),
    }


def _transform(pairing: Pairing, hypothesis: Hypothesis) -> dict[str, Any]:
    match = hypothesis.match
    T, pixels = match.T_receiver_donor, pixels_of(pairing, hypothesis)
    return {
        "T_a_b": {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad},
        "scale": match.scale,
        "T_px_b2a": None if pixels is None else (pixels[:2].ravel() + 0.0).tolist(),  # + 0.0: no -0.0,
    }


def _hypothesis(pairing: Pairing, hypothesis: Hypothesis) -> dict[str, Any]:
    match = hypothesis.match
    measured = hypothesis.measurements
    return {
        **_transform(pairing, hypothesis),
        "accepted": hypothesis.accepted,
        "score": number(match.score),
        "margin": number(match.margin),
        "covariance": None if match.covariance is None else match.covariance.ravel().tolist(),
        "evidence": _numbers(match.evidence),
        "metrics": None if measured is None else {m.name: _measurement(m) for m in measured},
    }


def _measurement(measurement: Measurement) -> dict[str, Any]:
    return {
        "value": number(measurement.value),
        "unit": measurement.unit,
        "support": measurement.support,
        "better": measurement.better,
        "details": _numbers(measurement.details),
    }


def _numbers(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: number(value) for name, value in values.items()}


def _procedure(pairing: Pairing) -> dict[str, Any] | None:
    rule = pairing.ruling.rule
    if rule is None or pairing.ruling.rejected:
        return None
    chosen = rule.procedure
    return {
        "match": chosen.match.use,
        "accept": chosen.accept.use,
        "fuse": chosen.fuse.use,
        "metrics": list(chosen.accept.metric_names),
    }
