"""How the laws are tried on the plugin ``beacons``, whose observations nobody else can make."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import beacons
import echoes
from hypothesis import strategies as st

from mapgraft.contracts import (
    Acceptor,
    Conversion,
    Fuser,
    MapError,
    MapType,
    Matcher,
    Meeting,
    Metric,
    Observation,
    Policy,
    Situation,
    Transform,
    Verifier,
)
from mapgraft.testing import (
    AcceptorLaws,
    ConversionLaws,
    FuserLaws,
    MapTypeLaws,
    MatcherLaws,
    MetricLaws,
    PolicyLaws,
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
def line_scenes(draw: st.DrawFn, matchable: bool = False, least: int = 0, most: int = 4) -> Scene:
    """What two robots have heard along one line: anything, or the same beacons in irregular gaps."""
    if not matchable:
        balance = st.dictionaries(st.integers(-3, 6), st.integers(-2, 2), min_size=least, max_size=most)
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


class EchoesLaws(OnALine, MetricLaws):
    """The metric that counts what observations say."""

    metric_name = "echoes"
    stream = True

    def make_metric(self) -> Metric:
        return echoes.Echoes()


class FirstOneLaws(AcceptorLaws):
    """The acceptor."""

    measured: ClassVar[dict[str, tuple[str, ...]]] = {"disagreement": ()}

    def make_acceptor(self) -> Acceptor:
        return beacons.FirstOne()


class AtMostLaws(VerifierLaws):
    """The verifier."""

    measured: ClassVar[dict[str, tuple[str, ...]]] = {"disagreement": ()}

    def make_verifier(self) -> Verifier:
        return beacons.AtMost(limit=0.5, confirm_after=3)


class Marks(beacons.Beacons):
    """Beacons by another name."""

    name = "marks"

    def new_layer(self):
        return beacons.Heard(map_type=self.name)

    def view(self, own, contributions=(), previous=None, touched=None):
        return dataclasses.replace(super().view(own, contributions, previous, touched), map_type=self.name)

    def place(self, layer, T_receiver_donor, scale=1.0):
        return dataclasses.replace(super().place(layer, T_receiver_donor, scale), map_type=self.name)

    def decode(self, data):
        return dataclasses.replace(super().decode(data), map_type=self.name)

    def metadata(self, layer):
        return dataclasses.replace(super().metadata(layer), type=self.name)


class Doubtful(beacons.Beacons):
    """Beacons that were heard twice; once is never."""

    def view(self, own, contributions=(), previous=None, touched=None):
        seen = super().view(own, contributions)
        return dataclasses.replace(seen, counts={at: n for at, n in seen.counts.items() if abs(n) > 1})


class ToMarks:
    """Beacons as marks."""

    def convert(self, layer, source, target):
        if not isinstance(layer, beacons.Heard) or target.name != Marks.name:
            raise MapError(f"beacons become marks, asked was {layer.map_type} to {target.name}")
        made, seen = target.new_layer(), source.view(layer).counts
        made.counts.update({at: n for at, n in layer.evidence().items() if at in seen})
        return made


class ToMarksLaws(OnALine, ConversionLaws):
    """The conversion."""

    def make_conversion(self) -> Conversion:
        return ToMarks()

    def make_target(self) -> MapType:
        return Marks()

    def make_other_source(self) -> MapType:
        return Doubtful()

    def scenes(self) -> st.SearchStrategy[Scene]:
        return line_scenes(least=4, most=9)


class Regular:
    """A policy: everybody meets every hundred seconds."""

    def due(self, situation: Situation) -> list[Meeting]:
        step = 100 * 10**9
        first = situation.previous_ns // step + 1
        return [Meeting(n * step) for n in range(first, situation.now_ns // step + 1)]


class RegularLaws(PolicyLaws):
    """The policy."""

    def make_policy(self) -> Policy:
        return Regular()


ALL = (
    BeaconLaws,
    SlideLaws,
    SlideNearLaws,
    SumLaws,
    DisagreementLaws,
    EchoesLaws,
    FirstOneLaws,
    AtMostLaws,
    ToMarksLaws,
    RegularLaws,
)
