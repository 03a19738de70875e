"""What the page is told: an example before it is judged, what a person said of it, and what is told afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Which = Literal["own", "donor"]
Said = Literal["right", "wrong", "unsure"]


@dataclass(frozen=True, slots=True)
class Picture:
    """A whole map from above in its own frame, as a picture with pixels of ``px_m`` metres.

    (``x_m``, ``y_m``) is the lower left corner in the map frame, y up; the first row of pixels is the highest y.
    """

    which: Which
    px_m: float
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Place:
    """Where the donor's map lies in the receiver's frame: p_receiver = scale · R(yaw) · p_donor + (x, y)."""

    x_m: float
    y_m: float
    yaw_rad: float
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Shown:
    """An example as it is shown to somebody who has not judged it: nothing tells what the robot made of it.

    ``n`` is its number among the opened examples, ``own`` the receiver's map and ``other`` the donor's. ``place`` is
    the hypothesis to be judged, None where the robot found none; ``others`` are further ones in an order that tells
    nothing. ``compared_type`` is the map type in which the two meet, empty where they do not. ``step_m`` is the finer
    map's resolution: what one press of an arrow key moves.
    """

    n: int
    environment: str
    recording: str
    stamp_s: float | None
    receiver: str
    donor: str
    receiver_type: str
    donor_type: str
    compared_type: str
    receiver_resolution_m: float | None
    donor_resolution_m: float | None
    own: Picture
    other: Picture
    place: Place | None
    others: tuple[Place, ...]
    step_m: float


@dataclass(frozen=True, slots=True)
class Word:
    """What somebody said last of an example; ``place`` is where they put the donor's map, if they moved it."""

    n: int
    annotator: str
    said: Said
    reason: str
    place: Place | None
    at_ns: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the robot made of an example, told after it was judged; numbers that are not known are None."""

    verdict: str
    state: str
    reason: str
    state_reason: str
    rule: str
    matcher: str
    score: float | None
    margin: float | None
    truth_error_m: float | None
    truth_error_deg: float | None
    evidence: Mapping[str, float]
    truth: str | None


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far two annotators agree: on ``both`` examples, ``same`` of which they called the same.

    ``kappa`` is Cohen's, None where it is not defined: nothing in common, or both said one and the same of everything.
    """

    one: str
    other: str
    both: int
    same: int
    kappa: float | None


@dataclass(frozen=True, slots=True)
class Progress:
    """How far an annotator is, and everybody: ``labelled`` examples have a word of somebody.

    ``mine`` counts the annotator's words, ``said`` is annotator → how many examples, ``mean_kappa`` that of all pairs.
    """

    annotator: str
    answered: int
    of: int
    labelled: int
    mine: Mapping[Said, int]
    said: Mapping[str, int]
    agreements: tuple[Agreement, ...]
    mean_kappa: float | None
