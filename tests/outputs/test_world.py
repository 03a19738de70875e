"""Frames in ``world``: side by side or together, and without jumps."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.outputs.standing import StandingMerge
from mapgraft.outputs.world import Box, grown, lay_out, placed_box

SIDE = st.floats(0.5, 80)
BOXES = st.builds(lambda x, y, w, h: (x, y, x + w, y + h), st.floats(-90, 90), st.floats(-90, 90), SIDE, SIDE)
ROBOTS = "abcde"


def merge(receiver: str, donor: str, T: Transform) -> StandingMerge:
    return StandingMerge(f"{receiver}.{donor}.1", 0, receiver, donor, T)


def apart(T: dict[str, Transform], boxes: dict[str, Box]) -> bool:
    placed = [placed_box(T[name], boxes[name]) for name in boxes]
    return not any(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for a, b in combinations(placed, 2))


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from(ROBOTS), BOXES, min_size=1))
def test_unmerged_maps_never_cover_each_other(boxes: dict[str, Box]) -> None:
    T = lay_out({}, boxes, [])
    assert apart(T, boxes)
    assert T[min(boxes)] == Transform.identity()
    assert lay_out(T, boxes, []) == T


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from(ROBOTS), BOXES, min_size=1), BOXES)
def test_growing_maps_move_only_who_is_in_the_way_and_never_the_first(boxes: dict[str, Box], more: Box) -> None:
    before = lay_out({}, boxes, [])
    name = max(boxes)
    larger = boxes | {name: grown(boxes[name], more) or more}
    after = lay_out(before, larger, [])
    assert apart(after, larger)
    for robot in boxes:
        if robot != name:
            assert after[robot] == before[robot]


@settings(deadline=None)
@given(BOXES, BOXES, BOXES, st.floats(-60, 60), st.floats(-3.1, 3.1))
def test_merged_robots_follow_the_receiver_and_go_aside_again_after_a_revert(
    a: Box, b: Box, c: Box, x_m: float, yaw_rad: float
) -> None:
    boxes = {"a": a, "b": b, "c": c}
    before = lay_out({}, boxes, [])
    T = Transform.planar(x_m, 2.0, yaw_rad)
    merged = lay_out(before, boxes, [merge("c", "a", T)])
    assert merged["a"] == before["a"]
    expected = merged["a"] @ T.inverse()
    assert merged["c"].matrix == pytest.approx(expected.matrix, abs=1e-9)
    reverted = lay_out(merged, boxes, [])
    assert reverted["a"] == before["a"]
    assert apart(reverted, boxes)
    assert all((reverted[name].matrix[:3, :3] == np.eye(3)).all() for name in boxes)


def test_a_robot_of_which_nothing_is_known_gets_some_room() -> None:
    T = lay_out({}, {"a": (0.0, 0.0, 1.0, 1.0), "b": None}, [])
    assert T["b"].x_m > 10.0
