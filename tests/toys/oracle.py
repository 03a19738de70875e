"""Matchers that are told the truth beforehand: one says it, one lies about it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from mapgraft.contracts import Descriptor, Map, Match, Prior, Transform, hookimpl

TRUTH: dict[tuple[int, int], Transform] = {}  # by how much the two maps know
SIGMAS = np.array([0.02, 0.03, 0.0, 0.0, 0.0, 0.004])


class Oracle:
    """The true transform, and another one far away; nothing for maps of which nothing was told."""

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        T = TRUTH.get((target.known(), source.known()))
        if T is None:
            return []
        covariance = np.diag(SIGMAS**2)
        return [
            Match(T, 2.0, 1.0, covariance=covariance, evidence={"told": 1.0}),
            Match(Transform.planar(50.0, 0.0, 0.0) @ T, 1.0, -1.0, covariance=covariance, evidence={"told": 1.0}),
        ]


class Liar:
    """The truth, moved by a metre."""

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        told = Oracle().match(target, source)
        aside = Transform.planar(1.0, 0.0, 0.0)
        return [dataclasses.replace(match, T_receiver_donor=aside @ match.T_receiver_donor) for match in told]


class Broken:
    """A matcher with a fault."""

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        raise ZeroDivisionError("by nothing")


@hookimpl
def register_matchers(register):
    register(Descriptor("oracle", "oracle:Oracle", "the truth", accepts=("occupancy_grid",)))
    register(Descriptor("liar", "oracle:Liar", "the truth, moved", accepts=("occupancy_grid",)))
    register(Descriptor("broken", "oracle:Broken", "fails", accepts=("occupancy_grid",)))
