"""The tf buffer: interpolation against scipy, the ways through a tree, and a named cause for every failure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mapgraft.recording.poses.rigid import (
    IDENTITY,
    Pose7,
    angle_of,
    compose,
    interpolate,
    inverse,
    levelled,
    planar,
    pose7,
    to_transform,
    yaw_of,
)
from mapgraft.recording.poses.tf import Missing, TransformBuffer

S = 1_000_000_000
metres = st.floats(-50, 50, allow_nan=False)
quaternions = st.tuples(*[st.floats(-1, 1, allow_nan=False)] * 4).filter(lambda q: math.hypot(*q) > 1e-2)
poses = st.builds(pose7, st.tuples(metres, metres, metres), quaternions)


def found(pose: Pose7 | Missing) -> Pose7:
    assert not isinstance(pose, Missing), pose
    return pose


@settings(deadline=None)
@given(poses, poses)
def test_composition_and_inverse_are_those_of_matrices(a: Pose7, b: Pose7) -> None:
    A, B = to_transform(a), to_transform(b)
    assert np.allclose(to_transform(compose(a, b)).matrix, (A @ B).matrix, atol=1e-9)
    assert np.allclose(to_transform(inverse(a)).matrix, A.inverse().matrix, atol=1e-9)
    assert math.isclose(angle_of(a), A.difference(A @ A.inverse())[1], abs_tol=1e-6)


@settings(deadline=None)
@given(poses, poses, st.floats(0, 1))
def test_interpolation_is_scipys_slerp_and_a_straight_line(a: Pose7, b: Pose7, u: float) -> None:
    between = to_transform(interpolate(a, b, u)).matrix
    relative = Rotation.from_quat(a[3:]).inv() * Rotation.from_quat(b[3:])
    if relative.magnitude() < math.pi - 1e-6:  # half a turn has two shortest ways
        expected = Slerp([0, 1], Rotation.from_quat([a[3:], b[3:]]))(u).as_matrix()
        assert np.allclose(between[:3, :3], expected, atol=1e-7)
    assert np.allclose(between[:3, 3], (1 - u) * np.array(a[:3]) + u * np.array(b[:3]), atol=1e-9)


@settings(deadline=None)
@given(metres, metres, st.floats(-3.1, 3.1), st.floats(-3.1, 3.1), st.floats(0, 1))
def test_planar_poses_stay_planar_and_turn_the_shorter_way(x: float, y: float, a: float, b: float, u: float) -> None:
    turn = math.remainder(b - a, 2 * math.pi)
    if abs(turn) > 3.1:
        return
    between = interpolate(planar(x, y, a), planar(y, x, b), u)
    assert between[2:5] == (0.0, 0.0, 0.0)
    assert abs(math.remainder(yaw_of(between) - a - u * turn, 2 * math.pi)) < 1e-9


@settings(deadline=None)
@given(poses)
def test_levelling_keeps_place_and_heading_only(a: Pose7) -> None:
    flat = levelled(a)
    assert flat[:2] == a[:2]
    assert flat[2:5] == (0.0, 0.0, 0.0)
    assert abs(math.remainder(yaw_of(flat) - to_transform(a).yaw_rad, 2 * math.pi)) < 1e-9


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 400), poses), min_size=2, max_size=30, unique_by=lambda s: s[0]), st.data())
def test_samples_may_come_in_any_order(samples: list[tuple[int, Pose7]], data: st.DataObject) -> None:
    given_, sorted_ = TransformBuffer(10 * S), TransformBuffer(10 * S)
    for stamp_ns, pose in samples:
        given_.add("odom", "base", stamp_ns, pose)
    for stamp_ns, pose in sorted(samples):
        sorted_.add("odom", "base", stamp_ns, pose)
    stamp_ns = data.draw(st.integers(-5, 405))
    assert given_.lookup("odom", "base", stamp_ns) == sorted_.lookup("odom", "base", stamp_ns)


@settings(deadline=None)
@given(st.lists(poses, min_size=1, max_size=6), st.data())
def test_a_chain_is_the_product_of_its_edges_either_way(edges: list[Pose7], data: st.DataObject) -> None:
    buffer = TransformBuffer(S)
    expected = to_transform(IDENTITY)
    for k, pose in enumerate(edges):
        if data.draw(st.booleans()):
            buffer.fix(f"f{k}", f"f{k + 1}", pose)
        else:
            buffer.add(f"f{k}", f"f{k + 1}", 0, pose)
        expected = expected @ to_transform(pose)
    down = to_transform(found(buffer.lookup("f0", f"f{len(edges)}", 0)))
    up = to_transform(found(buffer.lookup(f"f{len(edges)}", "f0", 0)))
    assert np.allclose(down.matrix, expected.matrix, atol=1e-6)
    assert np.allclose((up @ down).matrix, np.eye(4), atol=1e-6)


def test_frames_meet_at_their_nearest_common_ancestor() -> None:
    buffer = TransformBuffer(S)
    buffer.fix("world", "a/map", planar(1, 0, 0))
    buffer.fix("world", "b/map", planar(0, 2, math.pi / 2))
    T_a_b = to_transform(found(buffer.lookup("a/map", "b/map", 0)))
    assert np.allclose([T_a_b.x_m, T_a_b.y_m, T_a_b.yaw_rad], [-1, 2, math.pi / 2])
    assert buffer.lookup("b/map", "b/map", 0) == IDENTITY


def causes(buffer: TransformBuffer, target: str, source: str, stamp_ns: int) -> str:
    missing = buffer.lookup(target, source, stamp_ns)
    assert isinstance(missing, Missing)
    assert missing.sentence
    return missing.cause


def test_nothing_is_extrapolated() -> None:
    buffer = TransformBuffer(S // 2)
    for k in range(3):
        buffer.add("odom", "base", 10 * S + k * S // 2, planar(k, 0, 0))
    assert causes(buffer, "odom", "base", 10 * S - 1) == "before_first"
    assert causes(buffer, "odom", "base", 11 * S + 1) == "after_last"
    assert found(buffer.lookup("odom", "base", 11 * S)) == planar(2, 0, 0)
    assert found(buffer.lookup("odom", "base", 10 * S + S // 4))[0] == 0.5


def test_a_gap_is_too_long_only_when_something_moved_in_it() -> None:
    buffer = TransformBuffer(S // 2)
    for stamp_s, x in ((0, 0.0), (1, 1.0), (9, 1.0), (10, 1.5)):
        buffer.add("odom", "base", stamp_s * S, planar(x, 0, 0))
    assert causes(buffer, "odom", "base", S // 3) == "gap_too_long"
    assert found(buffer.lookup("odom", "base", 5 * S)) == planar(1, 0, 0)
    assert causes(buffer, "odom", "base", 9 * S + 1) == "gap_too_long"


def test_broken_trees_are_named() -> None:
    buffer = TransformBuffer(S)
    buffer.fix("map", "odom", IDENTITY)
    buffer.fix("base", "laser", IDENTITY)
    assert causes(buffer, "map", "laser", 0) == "no_link"
    assert causes(buffer, "map", "camera", 0) == "no_link"
    buffer.fix("odom", "base", IDENTITY)
    assert found(buffer.lookup("map", "laser", 0)) == IDENTITY
    buffer.fix("map", "base", planar(1, 0, 0))
    assert causes(buffer, "map", "laser", 0) == "two_parents"
    assert found(buffer.lookup("odom", "laser", 0)) == IDENTITY
    buffer.fix("laser", "map", IDENTITY)
    assert causes(buffer, "map", "laser", 0) == "loop"


def test_a_second_parent_that_leads_elsewhere_does_no_harm() -> None:
    buffer = TransformBuffer(S)
    buffer.fix("odom", "base", planar(5, 0, 0))
    buffer.fix("map", "base", planar(1, 0, 0))
    buffer.fix("base", "laser", planar(0, 1, 0))
    assert found(buffer.lookup("map", "laser", 0)) == planar(1, 1, 0)
    assert found(buffer.lookup("odom", "laser", 0)) == planar(5, 1, 0)


def test_old_samples_are_let_go_and_their_absence_is_named() -> None:
    buffer = TransformBuffer(S)
    for k in range(5000):
        buffer.add("odom", "base", k * S // 10, planar(k, 0, 0))
    kept = found(buffer.lookup("odom", "base", 490 * S + 1))
    buffer.forget_older(10 * S)
    assert sum(len(edge.stamps_ns) for edge in buffer.edges()) <= 101
    assert buffer.lookup("odom", "base", 490 * S + 1) == kept
    assert causes(buffer, "odom", "base", 10 * S) == "forgotten"
    assert causes(buffer, "odom", "base", -1) == "before_first"


def test_waiting_ends_when_every_sampled_edge_has_passed_the_stamp() -> None:
    buffer = TransformBuffer(S)
    buffer.fix("base", "laser", IDENTITY)
    buffer.add("map", "odom", 5 * S, IDENTITY)
    buffer.add("odom", "base", 3 * S, IDENTITY)
    chain = buffer.chain("map", "laser")
    assert not isinstance(chain, Missing)
    assert [(edge.parent, edge.child) for edge in chain.sampled] == [("map", "odom"), ("odom", "base")]
    assert chain.covers(3 * S)
    assert not chain.covers(4 * S)


def test_a_fixed_edge_may_change_and_stays_fixed() -> None:
    buffer = TransformBuffer(S)
    buffer.fix("base", "laser", IDENTITY)
    assert buffer.lookup("base", "laser", 0) == IDENTITY
    buffer.fix("base", "laser", planar(1, 0, 0))
    buffer.add("base", "laser", 0, planar(2, 0, 0))
    assert buffer.lookup("base", "laser", 7) == planar(1, 0, 0)
    assert buffer.frames() == ("base", "laser")
    assert buffer.parents("laser") == ("base",)
    assert buffer.parents("base") == ()


@pytest.mark.parametrize("shape", [(0.0, 0.0, 0.0, 2.0), (0.0, 0.0, -3.0, 0.0)])
def test_quaternions_are_normalised(shape: tuple[float, float, float, float]) -> None:
    assert math.isclose(math.hypot(*pose7((1, 2, 3), shape)[3:]), 1.0)


def test_contradictions_are_told_once_each_in_the_order_of_the_recording():
    buffer = TransformBuffer(S)
    for stamp, (parent, child) in enumerate(["ab", "bc", "xc", "ca", "de", "ed", "ff"], 1):
        buffer.add(parent, child, stamp * S, IDENTITY)
    two, *loops = buffer.contradictions()
    assert two[0] == "two_parents" and "'c' hangs on 'b' and from 3.000 s on on 'x', too" in two[1]
    assert [cause for cause, _ in loops] == ["loop"] * 3
    assert {frozenset(text.split("'")[1::2]) for _, text in loops} == {
        frozenset("abc"),
        frozenset("de"),
        frozenset("f"),
    }


def test_a_chain_without_end_is_walked_once():
    buffer = TransformBuffer(S)
    for n in range(100_000):
        buffer.add(f"f{n}", f"f{n + 1}", S, IDENTITY)
    assert buffer.contradictions() == []
    missing = buffer.lookup("f0", "f100000", S)
    assert isinstance(missing, Missing) and "more than 256 frames deep" in missing.sentence
