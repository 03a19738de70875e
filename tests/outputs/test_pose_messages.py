"""Transforms in CDR: what rosbags reads is what was meant."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.outputs.messages import MessageEncoder
from mapgraft.outputs.poses import paths_of
from mapgraft.outputs.tf import TF_TYPE, FramePair, pose_numbers

METRES = st.floats(-1e4, 1e4)
TURNS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-3)
TRANSFORMS = st.builds(Transform.from_quaternion, st.tuples(METRES, METRES, METRES), TURNS)
ENCODER = MessageEncoder()


@settings(deadline=None)
@given(st.lists(TRANSFORMS, min_size=1, max_size=5))
def test_many_quaternions_equal_those_one_by_one(transforms: list[Transform]) -> None:
    numbers = pose_numbers(np.stack([T.matrix for T in transforms]))
    for row, T in zip(numbers, transforms, strict=True):
        again = Transform.from_quaternion(tuple(row[:3]), tuple(row[3:]))
        assert again.matrix == pytest.approx(T.matrix, abs=1e-9)
        assert row[6] >= 0.0
        assert np.linalg.norm(row[3:]) == pytest.approx(1.0)


@settings(deadline=None)
@given(st.text("abc_/", min_size=1, max_size=9), st.text("xyz", max_size=9), st.integers(0, 2**31 * 10**9 - 1))
def test_a_frame_pair_encodes_what_the_general_encoder_does(parent: str, child: str, stamp_ns: int) -> None:
    numbers = np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8]])
    (message,) = FramePair(parent, child).encode(np.array([stamp_ns]), numbers)
    transform = {
        "child_frame_id": child,
        "transform": {"translation": {"x": 1.0, "y": 2.0, "z": 3.0}, "rotation": {"z": 0.6, "w": 0.8}},
    }
    assert message == ENCODER.encode(TF_TYPE, {"transforms": [transform]}, stamp_ns, parent)


def test_paths_keep_the_order_of_every_robot() -> None:
    T = [Transform.planar(float(n), 0.0, 0.0).matrix for n in range(5)]
    poses = [(n, "ab"[n % 2], 10 * n, T[n]) for n in range(5)]
    a, b = paths_of(poses)
    assert (a.robot, a.order.tolist(), a.stamps_ns.tolist(), a.numbers[:, 0].tolist()) == (
        "a",
        [0, 2, 4],
        [0, 20, 40],
        [0.0, 2.0, 4.0],
    )
    assert (b.robot, b.order.tolist()) == ("b", [1, 3])
    assert paths_of([]) == []
