"""What stands, which robots it connects, and what the chains of merges say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.events import Event, Kind
from mapgraft.outputs.standing import Chain, StandingMerge, StandingMerges, chains_from, components

METRES, ANGLES = st.floats(-50, 50), st.floats(-3.1, 3.1)
TRANSFORMS = st.builds(Transform.planar, METRES, METRES, ANGLES)
POINTS = np.array([[1.0, 2.0, 0.0], [-3.0, 0.5, 0.0], [0.0, 0.0, 0.0]])


def merge(receiver: str, donor: str, T: Transform, seq: int = 0, **fields: Any) -> StandingMerge:
    return StandingMerge(f"{receiver}.{donor}.{seq}", seq, receiver, donor, T, **fields)


def moved(chain: Chain) -> np.ndarray:
    return chain.T_target_source.apply(chain.scale * POINTS)


@settings(deadline=None)
@given(TRANSFORMS, TRANSFORMS, st.floats(0.2, 5.0), st.floats(0.2, 5.0))
def test_a_chain_moves_points_as_its_merges_do(ab: Transform, cb: Transform, s_ab: float, s_cb: float) -> None:
    merges = [merge("a", "b", ab, 0, scale=s_ab), merge("c", "b", cb, 1, scale=s_cb)]
    p_b = cb.inverse().apply(POINTS) / s_cb  # p_c = T_cb (s_cb p_b)
    expected = ab.apply(s_ab * p_b)
    chain = chains_from("a", merges)["c"]
    assert moved(chain) == pytest.approx(expected, abs=1e-6)
    assert chain.merges == ("a.b.0", "c.b.1")
    back = chains_from("c", merges)["a"]
    assert back.T_target_source.apply(back.scale * expected) == pytest.approx(POINTS, abs=1e-6)


def perturbed(T: Transform, delta: np.ndarray) -> Transform:
    """T with its position moved by delta[:3] and turned by the small vector delta[3:] about the target's axes."""
    angle = float(np.linalg.norm(delta[3:]))
    turn = np.eye(3)
    if angle:
        k = np.array([[0, -delta[5], delta[4]], [delta[5], 0, -delta[3]], [-delta[4], delta[3], 0]]) / angle
        turn = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    matrix = T.matrix.copy()
    matrix[:3, :3] = turn @ matrix[:3, :3]
    matrix[:3, 3] += delta[:3]
    return Transform(matrix)


def difference(T: Transform, other: Transform) -> np.ndarray:
    turn = other.matrix[:3, :3] @ T.matrix[:3, :3].T
    return np.array([*(other.matrix - T.matrix)[:3, 3], turn[2, 1], turn[0, 2], turn[1, 0]])


@pytest.mark.parametrize("scales", [(1.0, 1.0), (1.5, 0.7)])
def test_the_covariance_of_a_chain_equals_numeric_differentiation(scales: tuple[float, float]) -> None:
    rng = np.random.default_rng(3)
    ab = Transform.from_quaternion((2.0, -1.0, 0.3), (0.1, -0.2, 0.5, 0.8))
    cb = Transform.from_quaternion((-4.0, 0.5, 1.0), (-0.3, 0.2, 0.1, 0.9))
    roots = [rng.normal(size=(6, 6)) for _ in range(2)]
    covariances = [root @ root.T * 1e-4 for root in roots]

    def chain_of(ab_: Transform, cb_: Transform) -> Chain:
        merges = [
            merge("a", "b", ab_, 0, scale=scales[0], covariance=covariances[0]),
            merge("c", "b", cb_, 1, scale=scales[1], covariance=covariances[1]),
        ]
        return chains_from("a", merges)["c"]

    expected, step = np.zeros((6, 6)), 1e-6
    here = chain_of(ab, cb)
    for which, covariance in enumerate(covariances):
        J = np.zeros((6, 6))
        for axis, delta in enumerate(np.eye(6) * step):
            there = chain_of(perturbed(ab, delta), cb) if which == 0 else chain_of(ab, perturbed(cb, delta))
            J[:, axis] = difference(here.T_target_source, there.T_target_source) / step
        expected += J @ covariance @ J.T
    assert here.covariance == pytest.approx(expected, rel=1e-4, abs=1e-9)


def test_a_chain_without_one_covariance_has_none() -> None:
    merges = [merge("a", "b", Transform.identity(), 0, covariance=np.eye(6)), merge("b", "c", Transform.identity(), 1)]
    chains = chains_from("a", merges)
    assert chains["b"].covariance is not None and chains["c"].covariance is None


def test_a_more_direct_merge_wins_then_the_receivers_own_then_the_older() -> None:
    one, two, three = (Transform.planar(x, 0.0, 0.0) for x in (1.0, 2.0, 3.0))
    merges = [merge("b", "a", one, 0), merge("a", "b", two, 1), merge("a", "b", three, 2), merge("b", "c", one, 3)]
    chains = chains_from("a", merges)
    assert chains["b"].T_target_source == two
    assert chains["c"].T_target_source.x_m == 3.0
    direct = [*merges, merge("c", "a", three, 4)]
    assert chains_from("a", direct)["c"].T_target_source.x_m == -3.0


def test_state_of_a_chain_is_confirmed_only_when_all_its_merges_are() -> None:
    T = Transform.identity()
    merges = [merge("a", "b", T, 0, state="confirmed"), merge("b", "c", T, 1, state="provisional")]
    chains = chains_from("a", merges)
    assert (chains["b"].state, chains["c"].state) == ("confirmed", "provisional")


def test_components_are_sorted_and_hold_robots_without_merges() -> None:
    T = Transform.identity()
    merges = [merge("d", "b", T), merge("b", "e", T), merge("x", "c", T)]
    assert components(["z", "a", "b"], merges) == [("a",), ("b", "d", "e"), ("c", "x"), ("z",)]


def event(kind: Kind, merge_id: str = "a.b.1", T: Transform | None = None, **fields: Any) -> Event:
    states: dict[str, Any] = {"merged": "provisional", "confirmed": "confirmed", "reverted": "reverted"}
    return Event(0, 0, kind, "a", "b", merge_id, states.get(kind, "provisional"), T_receiver_donor=T, **fields)


def test_the_present_follows_the_events() -> None:
    T, other = Transform.planar(1.0, 0.0, 0.0), Transform.planar(1.1, 0.0, 0.0)
    standing = StandingMerges()
    assert not standing.happened(event("unmatched", T=T))
    assert not standing.happened(event("ambiguous", T=T))
    assert standing.merges == ()
    assert standing.happened(event("merged", T=T))
    assert not standing.happened(event("verified", T=T))
    assert standing.happened(event("updated", T=other))
    assert standing.merges[0].T_receiver_donor == other
    assert standing.happened(event("confirmed"))
    assert standing.merges[0].state == "confirmed" and standing.merges[0].T_receiver_donor == other
    assert not standing.happened(event("reverted", "a.b.2"))
    assert standing.happened(event("reverted"))
    assert standing.merges == ()
