"""An example's row as what may be shown before it is judged, and what is told afterwards."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from mapgraft.annotate.shown import Outcome, Picture, Place, Shown, Which

SHOWN: Final = (
    *("environment", "recording", "stamp", "receiver", "donor", "receiver_type", "donor_type", "compared_type"),
    *("receiver_resolution_m", "donor_resolution_m", "x_m", "y_m", "yaw_rad", "scale", "hypotheses"),
    *("own_px_m", "own_x_m", "own_y_m", "donor_px_m", "donor_x_m", "donor_y_m"),
)
OUTCOME: Final = (
    *("verdict", "state", "reason", "state_reason", "rule", "matcher", "score", "margin", "evidence"),
    *("truth", "truth_error_m", "truth_error_deg"),
)
TEXT_CHARACTERS: Final = 500  # of a name or a reason
REASON_CHARACTERS: Final = 2_000  # of what an annotator says
HYPOTHESES: Final = 32
EVIDENCE: Final = 500  # numbers
STEP_M: Final = 0.1  # of an arrow key, where no resolution is known
_SAME: Final = 1e-6  # a hypothesis this near to the judged one is that one


def shown_of(n: int, row: Mapping[str, Any]) -> Shown:
    """What may be shown of an example; ``row`` holds the columns ``SHOWN``."""
    judged = _place(row)
    places = [place for given in (row["hypotheses"] or [])[:HYPOTHESES] if (place := _place(given)) is not None]
    others = {place for place in places if judged is None or _apart(place, judged) > _SAME}
    sizes = [number(row[f"{side}_resolution_m"]) for side in ("receiver", "donor")]
    return Shown(
        n=n,
        environment=text(row["environment"]),
        recording=text(row["recording"]),
        stamp_s=None if row["stamp"] is None else row["stamp"] / 1e9,
        receiver=text(row["receiver"]),
        donor=text(row["donor"]),
        receiver_type=text(row["receiver_type"]),
        donor_type=text(row["donor_type"]),
        compared_type=text(row["compared_type"]),
        receiver_resolution_m=sizes[0],
        donor_resolution_m=sizes[1],
        own=_picture(row, "own"),
        other=_picture(row, "donor"),
        place=judged,
        others=tuple(sorted(others, key=lambda place: (place.x_m, place.y_m, place.yaw_rad))),
        step_m=min((size for size in sizes if size), default=STEP_M),
    )


def outcome_of(row: Mapping[str, Any]) -> Outcome:
    """What the robot made of an example; ``row`` holds the columns ``OUTCOME``."""
    evidence = {text(pair["name"]): number(pair["value"]) for pair in (row["evidence"] or [])[:EVIDENCE]}
    return Outcome(
        verdict=text(row["verdict"]),
        state=text(row["state"]),
        reason=text(row["reason"]),
        state_reason=text(row["state_reason"]),
        rule=text(row["rule"]),
        matcher=text(row["matcher"]),
        score=number(row["score"]),
        margin=number(row["margin"]),
        truth_error_m=number(row["truth_error_m"]),
        truth_error_deg=number(row["truth_error_deg"]),
        evidence={name: value for name, value in evidence.items() if value is not None},
        truth=text(row["truth"]) or None,
    )


def text(value: object, characters: int = TEXT_CHARACTERS) -> str:
    """A text of bounded length; empty for None."""
    given = "" if value is None else str(value)
    return given if len(given) <= characters else f"{given[: characters - 1]}…"


def number(value: float | None) -> float | None:
    """A finite number; None for anything else."""
    return value if value is not None and math.isfinite(value) else None


def _picture(row: Mapping[str, Any], which: Which) -> Picture:
    px_m, x_m, y_m = (number(row[f"{which}_{name}"]) for name in ("px_m", "x_m", "y_m"))
    return Picture(which, px_m or STEP_M, x_m or 0.0, y_m or 0.0)


def _place(row: Mapping[str, Any]) -> Place | None:
    x_m, y_m, yaw_rad = (number(row[name]) for name in ("x_m", "y_m", "yaw_rad"))
    if x_m is None or y_m is None or yaw_rad is None:
        return None
    return Place(x_m, y_m, yaw_rad, number(row["scale"]) or 1.0)


def _apart(one: Place, other: Place) -> float:
    turn = abs(math.remainder(one.yaw_rad - other.yaw_rad, math.tau))
    return max(abs(one.x_m - other.x_m), abs(one.y_m - other.y_m), turn)
