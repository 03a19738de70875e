"""Metrics of walls: what is explained, what contradicts, and how far off the explained ones are."""

from __future__ import annotations

import math

from mapgraft.contracts import Anew, Comparison, Measurement
from mapgraft_lines.evidence.standing import Standing, standing_of
from mapgraft_lines.kernels.explaining import STEP_M


class Explained:
    """The share of the walls of both maps, where the other map knows something, that a wall of the other explains.

    Within 0.25 m, running alike, the same side seen. NaN where no wall lies where the other map knows something; the
    support is their length, in pieces of 0.1 m. Details: the lengths of either map, in metres.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _explained)


class Contradiction:
    """The share of the walls that stand in the other map's free space, of those that are explained or do so.

    Free is what beams went through, and all around it, too; so a map without free space (a plan, a file of
    segments) contradicts nothing. NaN where nothing is explained or against; the support is the length of what is, in
    pieces of 0.1 m. Details as ``line_explained``.
    """

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _contradiction)


class Residual:
    """How far walls are off the walls that explain them, root mean square in metres; NaN where none is explained."""

    def track(self, comparison: Comparison) -> Anew:
        return Anew(comparison, _residual)


def _explained(comparison: Comparison) -> Measurement:
    found = standing_of(comparison)
    value = min(found.explained / found.joint_m, 1.0) if found.joint_m > 0.0 else math.nan
    return Measurement("line_explained", value, "1", round(found.joint_m / STEP_M), "higher", details(found))


def _contradiction(comparison: Comparison) -> Measurement:
    found = standing_of(comparison)
    spoken = found.explained + found.against
    value = found.against / spoken if spoken > 0.0 else math.nan
    return Measurement("line_contradiction", value, "1", found.support, "lower", details(found))


def _residual(comparison: Comparison) -> Measurement:
    found = standing_of(comparison)
    value = math.sqrt(found.squares / found.explained) if found.explained > 0.0 else math.nan
    return Measurement("line_residual", value, "m", found.support, "lower", details(found))


def details(found: Standing) -> dict[str, float]:
    return {
        "explained_own_m": found.explained_m[0],
        "explained_donor_m": found.explained_m[1],
        "against_own_m": found.against_m[0],
        "against_donor_m": found.against_m[1],
        "joint_m": found.joint_m,
    }
