"""Building a pair: two maps, each in a frame of its own, and how they really lie to each other."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from mapgraft.contracts import Layer, Map, MapType, Observation, Transform
from mapgraft.evaluation.drawing import PairPlan, Window
from mapgraft.evaluation.truth import Truth

RECEIVER, DONOR = "receiver", "donor"


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One robot of a pair: what it observed, in its own frame, and the map of it."""

    map_type: MapType
    observations: tuple[Observation, ...]
    layer: Layer
    map: Map


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two maps and the truth about them, None across recordings; ``further`` is what the receiver observes next.

    ``given`` is the true transform where a person gave it.
    """

    plan: PairPlan
    receiver: Side
    donor: Side
    further: tuple[Observation, ...]
    truth: Truth | None
    given: Transform | None = None

    @property
    def overlap(self) -> float:
        """The share of the smaller map that both know; 0 across recordings."""
        return 0.0 if self.truth is None else self.truth.overlap


def as_it_is(layer: Layer, source: MapType, target: MapType) -> Layer:
    """The layer of a donor whose map is of the receiver's type."""
    return layer


def build(
    plan: PairPlan,
    receiver_type: MapType,
    donor_type: MapType,
    convert: Callable[[Layer, MapType, MapType], Layer] = as_it_is,
    given: Transform | None = None,
) -> Pair:
    """Map both windows of a plan, each in the frame of its first scan, turned.

    ``convert`` brings the donor's layer into the receiver's type, in which the truth about the two is told. ``given``
    is the true transform where a person gave it, which goes before recorded poses.
    """
    T_receiver_map = frame_of(plan.receiver, plan.receiver_turn_rad)
    T_donor_map = frame_of(plan.donor, plan.donor_turn_rad)
    receiver = _side(receiver_type, rebased(plan.receiver.observations, T_receiver_map, RECEIVER))
    donor = _side(donor_type, rebased(plan.donor.observations, T_donor_map, DONOR))
    truth, T_receiver_donor = None, given
    if T_receiver_donor is None and not plan.across:
        T_world_receiver = plan.receiver.course.T_world_map @ T_receiver_map.inverse()
        T_world_donor = plan.donor.course.T_world_map @ T_donor_map.inverse()
        T_receiver_donor = T_world_receiver.inverse() @ T_world_donor
    if T_receiver_donor is not None:
        truth = Truth.of(receiver_type, receiver.map, convert(donor.layer, donor_type, receiver_type), T_receiver_donor)
    return Pair(plan, receiver, donor, rebased(plan.receiver.following, T_receiver_map, RECEIVER), truth, given)


def frame_of(window: Window, turn_rad: float) -> Transform:
    """``T_window_map``: the window's frame begins, level, where its first scan was made, and is turned."""
    first = window.observations[0].T_map_base
    x_m, y_m, z_m = first.matrix[:3, 3].tolist()
    level = Transform.planar(x_m, y_m, first.yaw_rad).matrix.copy()
    level[2, 3] = z_m
    return Transform.planar(0.0, 0.0, turn_rad) @ Transform(level).inverse()


def rebased(observations: Iterable[Observation], T_window_map: Transform, robot: str) -> tuple[Observation, ...]:
    """The observations in another map frame, as those of ``robot``."""
    return tuple(
        dataclasses.replace(
            observation,
            robot=robot,
            T_map_sensor=T_window_map @ observation.T_map_sensor,
            T_map_base=T_window_map @ observation.T_map_base,
        )
        for observation in observations
    )


def _side(map_type: MapType, observations: tuple[Observation, ...]) -> Side:
    layer = map_type.new_layer()
    for observation in observations:
        map_type.integrate(layer, observation)
    return Side(map_type, observations, layer, map_type.view(layer))
