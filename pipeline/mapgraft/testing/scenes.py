"""What the laws are tried on: what two robots have seen of one place."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from hypothesis import strategies as st

from mapgraft.contracts import Observation, Transform
from mapgraft.testing.laws import NotTriedError
from mapgraft.testing.observing import READY_KINDS, SPATIAL_KINDS, observe
from mapgraft.testing.rooms import poses, rooms, stepped


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a receiver and a donor have seen, each in its own map frame, in the order of time.

    ``T_receiver_donor`` is how the donor's frame really lies in the receiver's, None where nobody knows. ``text`` says
    in a few words what it is, for a person who reads a counterexample.
    """

    own: tuple[Observation, ...]
    donor: tuple[Observation, ...]
    T_receiver_donor: Transform | None = None
    text: str = ""

    def __str__(self) -> str:
        seen = f"{len(self.own)} own and {len(self.donor)} donor's observation(s)"
        return f"{self.text}, {seen}" if self.text else seen


def moved(observation: Observation, T_new_old: Transform) -> Observation:
    """The same observation in a map frame that lies elsewhere."""
    return dataclasses.replace(
        observation,
        T_map_sensor=T_new_old @ observation.T_map_sensor,
        T_map_base=T_new_old @ observation.T_map_base,
    )


@st.composite
def planar_moves(draw: st.DrawFn, reach_m: float = 6.0) -> Transform:
    """Transforms in the plane, in steps of a centimetre and about half a degree, up to ``reach_m`` and any turn."""
    reach = round(reach_m * 100)
    x, y = draw(st.integers(-reach, reach)) / 100.0, draw(st.integers(-reach, reach)) / 100.0
    return Transform.planar(x, y, draw(st.integers(-314, 314)) / 100.0)


@st.composite
def scenes_of(draw: st.DrawFn, kind: str, least: int = 1, most: int = 4, donor_kind: str | None = None) -> Scene:
    """Two robots that look at one little room, each from so many places; for the kinds in ``READY_KINDS``."""
    room = draw(stepped() if {kind, donor_kind} & SPATIAL_KINDS else rooms())
    T_receiver_donor = draw(planar_moves())
    own = observe(kind, room, draw(poses(room, least, most)), Transform.identity(), "receiver")
    donor = observe(donor_kind or kind, room, draw(poses(room, least, most)), T_receiver_donor.inverse(), "donor")
    return Scene(own, donor, T_receiver_donor, f"{room}")


@st.composite
def scenes_from(draw: st.DrawFn, observations: st.SearchStrategy[Observation], most: int = 4) -> Scene:
    """Two robots with observations that have nothing to do with each other."""
    own = draw(st.lists(observations, min_size=1, max_size=most))
    donor = draw(st.lists(observations, min_size=1, max_size=most))
    return Scene(_in_time(own, "receiver"), _in_time(donor, "donor"))


def ready_scenes(kind: str, least: int = 1, most: int = 4, donor_kind: str | None = None) -> st.SearchStrategy[Scene]:
    """``scenes_of`` a kind; raises NotTriedError for one that the kit cannot make."""
    for wanted in (kind, donor_kind or kind):
        if wanted not in READY_KINDS:
            raise NotTriedError(
                f"the kit makes observations of the kinds {', '.join(READY_KINDS)}, not of {wanted!r}: give the laws "
                "observations() or scenes()"
            )
    return scenes_of(kind, least, most, donor_kind)


def _in_time(observations: list[Observation], robot: str) -> tuple[Observation, ...]:
    return tuple(
        dataclasses.replace(o, robot=robot, stamp_ns=n * 10**8, recorded_ns=n * 10**8)
        for n, o in enumerate(observations, start=1)
    )


def describe(T: Transform) -> str:
    """A transform for a person."""
    return f"({T.x_m:.2f} m, {T.y_m:.2f} m, {math.degrees(T.yaw_rad):.1f}°)"
