"""Whether what a plugin gave can be used at all; each function raises PluginError that goes on after the plugin's name.

What is checked here is what could do harm later: what enters a ledger, moves a map, or is written down.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Real

import numpy as np

from mapgraft.contracts import (
    Candidate,
    Contribution,
    Decision,
    Donation,
    Finding,
    MapType,
    Match,
    Measurement,
    Meeting,
    Transform,
    Verdict,
)
from mapgraft.errors import PluginError, TransformError
from mapgraft.sound_maps import sound_layer
from mapgraft.sound_values import finite, number, numbers, shown, text

_VERDICTS = ("provisional", "ambiguous", "unmatched")
_ACTIONS = ("keep", "confirm", "revert")


def sound_matches(found: object) -> Sequence[Match]:
    """Hypotheses with rigid transforms, finite scores and scales, and covariances of six by six."""
    if not isinstance(found, Sequence) or isinstance(found, str | bytes):
        raise PluginError(f"gave a {type(found).__name__} where a sequence of matches was wanted")
    for match in found:
        if not isinstance(match, Match):
            raise PluginError(f"gave a {type(match).__name__} among its matches")
        _rigid(match.T_receiver_donor)
        finite("a score", match.score)
        number("a margin", match.margin)
        _scale(match.scale)
        if match.covariance is not None:
            covariance = np.asarray(match.covariance)
            if covariance.shape != (6, 6) or covariance.dtype.kind != "f" or not np.isfinite(covariance).all():
                raise PluginError("gave a covariance that is not six by six finite numbers")
        numbers("evidence", match.evidence)
    return found


def sound_decision(decision: object, candidates: Sequence[Candidate]) -> Decision:
    """A verdict that exists, and a choice among the candidates there are."""
    if not isinstance(decision, Decision) or decision.verdict not in _VERDICTS:
        raise PluginError(f"gave {shown(decision)} where a Decision was wanted ({', '.join(_VERDICTS)})")
    chosen = decision.chosen
    fits = chosen is None or (
        isinstance(chosen, int) and not isinstance(chosen, bool) and 0 <= chosen < len(candidates)
    )
    if not fits or (decision.verdict == "provisional" and chosen is None):
        raise PluginError(f"chose number {chosen!r} of {len(candidates)} candidates for the verdict {decision.verdict}")
    text("a reason", decision.reason)
    return decision


def sound_measurement(measurement: object) -> Measurement:
    """A number (NaN where there is too little to measure) with its support."""
    if not isinstance(measurement, Measurement):
        raise PluginError(f"gave {shown(measurement)} where a Measurement was wanted")
    number("a value", measurement.value)
    if isinstance(measurement.support, bool) or not isinstance(measurement.support, int | np.integer):
        raise PluginError(f"gave a support of {shown(measurement.support)}, a count was wanted")
    if measurement.support < 0 or measurement.better not in ("higher", "lower"):
        raise PluginError(f"gave a support of {measurement.support}, of which {shown(measurement.better)} is better")
    text("a name", measurement.name)
    numbers("details", measurement.details)
    _findings(measurement.findings)
    return measurement


def sound_verdict(verdict: object) -> Verdict:
    """An action that exists, with its reason."""
    if not isinstance(verdict, Verdict) or verdict.action not in _ACTIONS:
        raise PluginError(f"gave {shown(verdict)} where a Verdict was wanted ({', '.join(_ACTIONS)})")
    text("a reason", verdict.reason)
    numbers("evidence", verdict.evidence)
    return verdict


def sound_contribution(contribution: object, map_type: MapType, donation: Donation) -> Contribution:
    """A layer of the receiver's type, placed by a rigid transform in fixed point, and of the donor who gave it."""
    if not isinstance(contribution, Contribution):
        raise PluginError(f"gave {shown(contribution)} where a Contribution was wanted")
    sound_layer(contribution.layer, map_type.name)
    T = _rigid(contribution.T_receiver_donor)
    if T.snapped() != T:
        raise PluginError("gave a contribution whose transform is not in fixed point (Transform.snapped)")
    _scale(contribution.scale)
    if contribution.provenance != donation.provenance:
        raise PluginError(f"gave a contribution of {contribution.provenance}, the donor's was {donation.provenance}")
    if contribution.role not in ("observation", "prior"):
        raise PluginError(f"gave a contribution in the role {shown(contribution.role)}")
    for region in (contribution.region, *(() if contribution.fill is None else (contribution.fill,))):
        expected = type(map_type.region(contribution.layer))
        if not isinstance(region, expected):
            raise PluginError(f"gave a region of type {type(region).__name__}, a {expected.__name__} was wanted")
    numbers("a summary", contribution.summary)
    return contribution


def sound_meetings(due: object, robots: Iterable[str]) -> Sequence[Meeting]:
    """Meetings of robots that there are."""
    names = set(robots)
    if not isinstance(due, Sequence) or isinstance(due, str | bytes):
        raise PluginError(f"gave a {type(due).__name__} where a sequence of meetings was wanted")
    for meeting in due:
        if not isinstance(meeting, Meeting) or isinstance(meeting.stamp_ns, bool):
            raise PluginError(f"gave {shown(meeting)} where a Meeting was wanted")
        if not isinstance(meeting.stamp_ns, int | np.integer):
            raise PluginError(f"gave a meeting at {shown(meeting.stamp_ns)}, a whole number of nanoseconds was wanted")
        for pair in meeting.pairs or ():
            if len(pair) != 2 or pair[0] == pair[1] or not names.issuperset(pair):
                raise PluginError(f"lets {shown(pair)} meet, the robots are {', '.join(sorted(names))}")
    return due


def _findings(findings: object) -> None:
    if not isinstance(findings, Sequence) or isinstance(findings, str | bytes):
        raise PluginError(f"gave findings of type {type(findings).__name__}, a sequence was wanted")
    for finding in findings:
        if not isinstance(finding, Finding):
            raise PluginError(f"gave {shown(finding)} among its findings")
        text("the kind of a finding", finding.kind)
        text("the unit of a finding", finding.unit)
        number("the value of a finding", finding.value)
        for end in (finding.start_m, finding.end_m):
            if not isinstance(end, tuple) or len(end) != 3:
                raise PluginError(f"gave a finding at {shown(end)}, x, y and z were wanted")
            for coordinate in end:
                finite("a coordinate of a finding", coordinate)


def _rigid(T: object) -> Transform:
    if not isinstance(T, Transform) or getattr(T.matrix, "shape", None) != (4, 4):
        raise PluginError(f"gave {shown(T)} where a Transform was wanted")
    if T.matrix.dtype != np.float64 or not (T.matrix[3] == (0.0, 0.0, 0.0, 1.0)).all():
        raise PluginError("gave a transform whose matrix is not float64 with a last row of 0 0 0 1")
    try:
        Transform.from_matrix(T.matrix)
    except TransformError as error:
        raise PluginError(f"gave no transform: {error}") from error
    return T


def _scale(value: object) -> None:
    finite("a scale", value)
    if not isinstance(value, Real) or value <= 0:
        raise PluginError(f"gave a scale of {shown(value)}, it must be above 0")
