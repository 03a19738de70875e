"""Robots that have seen each other: what of it anybody needs who holds a merge against it."""

from __future__ import annotations

from dataclasses import dataclass

from mapgraft.contracts.geometry import Transform


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One robot of a pair saw the other, or somebody knows how they lay to each other at one time.

    ``T_receiver_base`` and ``T_donor_base`` are where the two robots knew themselves, each in its own map frame, at
    ``stamp_ns`` of the mission. What was measured is where the donor's base lay in the receiver's: ``x_m``, ``y_m`` and
    ``yaw_rad`` (NaN where only the place was); with ``by_donor`` it is where the receiver's base lay in the donor's.
    ``sigma_m`` and ``sigma_yaw_rad`` are standard deviations.
    """

    stamp_ns: int
    T_receiver_base: Transform
    T_donor_base: Transform
    x_m: float
    y_m: float
    yaw_rad: float
    sigma_m: float
    sigma_yaw_rad: float
    by_donor: bool = False
