"""How the laws are tried on the plugin ``beacons``, whose observations nobody else can make."""

from __future__ import annotations

import beacons
from hypothesis import strategies as st

from mapgraft.contracts import Acceptor, Fuser, MapType, Matcher, Metric, Observation, Transform, Verifier
from mapgraft.testing import (
    AcceptorLaws,
    FuserLaws,
    MapTypeLaws,
    MatcherLaws,
    MetricLaws,
    Scene,
    Supply,
    VerifierLaws,
)

HERE = Transform.identity()


def heard(robot: str, stamp: int, balance: dict[int, int], shift: int = 0) -> Observation:
    """How much more often a beacon was heard at each whole metre than not."""
    moved = {at + shift: n for at, n in balance.items()}
    T = Transform.planar(float(max(moved, default=0)), 0.0, 0.0)
    return Observation(robot, stamp, stamp, "ear", "heard", moved, HERE, T)


@st.composite
def line_scenes(draw: st.DrawFn, matchable: bool = False) -> Scene:
    """What two robots have heard along one line: anything, or the same beacons in irregular gaps."""
    if not matchable:
        balance = st.dictionaries(st.integers(-3, 6), st.integers(-2, 2), max_size=4)
        own, donor = (draw(st.lists(balance, min_size=1, max_size=4)) for _ in range(2))
        shift = 0
    else:
        gaps = draw(st.lists(st.integers(1, 4), min_size=4, max_size=7))
        places = {sum(gaps[:n]): 1 for n in range(len(gaps))}
        own, donor, shift = [places], [places], draw(st.integers(-5, 5))
    return Scene(
        tuple(heard("alpha", n, balance) for n, balance in enumerate(own)),
        tuple(heard("bravo", n, balance, -shift) for n, balance in enumerate(donor)),
        Transform.planar(float(shift), 0.0, 0.0),
        "a line of beacons",
    )


class OnALine(Supply):
    """Beacons stand at whole metres of a line: nothing turns, and a frame is moved by whole metres."""

    examples = 60

    def make_map_type(self) -> MapType:
        return beacons.Beacons()

    def scenes(self) -> st.SearchStrategy[Scene]:
        return line_scenes()

    def moves(self) -> st.SearchStrategy[Transform]:
        return st.integers(-4, 4).map(lambda metres: Transform.planar(float(metres), 0.0, 0.0))


class BeaconLaws(OnALine, MapTypeLaws):
    """The map type."""


class SlideLaws(OnALine, MatcherLaws):
    """The matcher."""

    def make_matcher(self) -> Matcher:
        return beacons.Slide()

    def scenes(self) -> st.SearchStrategy[Scene]:
        return line_scenes(matchable=True)


class SlideNearLaws(SlideLaws):
    """The matcher around a prior."""

    uses_prior = True

    def make_matcher(self) -> Matcher:
        return beacons.SlideNear()


class SumLaws(OnALine, FuserLaws):
    """The fuser."""

    def make_fuser(self) -> Fuser:
        return beacons.Sum()


class DisagreementLaws(OnALine, MetricLaws):
    """The metric."""

    metric_name = "disagreement"

    def make_metric(self) -> Metric:
        return beacons.Disagreement()


class FirstOneLaws(AcceptorLaws):
    """The acceptor."""

    measured = {"disagreement": ()}

    def make_acceptor(self) -> Acceptor:
        return beacons.FirstOne()


class AtMostLaws(VerifierLaws):
    """The verifier."""

    measured = {"disagreement": ()}

    def make_verifier(self) -> Verifier:
        return beacons.AtMost(limit=0.5, confirm_after=3)


ALL = (
    BeaconLaws,
    SlideLaws,
    SlideNearLaws,
    SumLaws,
    DisagreementLaws,
    FirstOneLaws,
    AtMostLaws,
)
