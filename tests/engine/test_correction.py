"""Where observations belong by a correction: what it says, what follows from it, and what stays."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import GRID_MESSAGE, Observation, Transform
from mapgraft.correction import Correction, Recollection
from mapgraft.recording.poses.rigid import from_transform

MOUNT = Transform.planar(0.2, 0.1, 0.3)
places = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3)).map(lambda p: Transform.planar(*p))
drives = st.lists(places, min_size=3, max_size=12)


def seen(second: int, T: Transform, kind: str = "scan", mount: Transform = MOUNT) -> Observation:
    return Observation("alpha", second + 1000, second, "laser", kind, None, T @ mount, T)


def driven(poses: list[Transform]) -> Recollection:
    return Recollection([seen(10 * k, T) for k, T in enumerate(poses)])


def said(poses: dict[int, Transform]) -> Correction:
    return Correction("alpha", 0, tuple(poses), tuple(from_transform(T) for T in poses.values()))


def near(one: Transform, other: Transform) -> bool:
    shift_m, turn_rad = one.difference(other)
    return shift_m < 1e-6 and turn_rad < 1e-6


@given(drives, st.data())
def test_what_is_told_of_every_pose_is_taken_as_it_is(poses, data):
    new = data.draw(st.lists(places, min_size=len(poses), max_size=len(poses)))
    recollection = driven(poses)
    anew = recollection.corrected(said({10 * k: T for k, T in enumerate(new)}))
    if anew is None:
        assert all(near(a, b) or a.difference(b)[0] < 0.01 for a, b in zip(poses, new, strict=True))
        return
    for one, T in zip(anew.observations, new, strict=True):
        assert near(one.T_map_base, T) and near(one.T_map_sensor, T @ MOUNT)


@given(drives, places, st.data())
def test_a_map_that_moves_as_a_whole_moves_all_that_is_in_it(poses, T_new_old, data):
    """However few of the poses are told: what lies between them and after them goes with them."""
    told = sorted(data.draw(st.sets(st.integers(0, len(poses) - 1), min_size=1)) | {0})
    anew = driven(poses).corrected(said({10 * k: T_new_old @ poses[k] for k in told}))
    if anew is not None:
        assert all(near(o.T_map_base, T_new_old @ T) for o, T in zip(anew.observations, poses, strict=True))


@given(drives, st.data())
def test_a_correction_told_twice_moves_nothing_the_second_time(poses, data):
    told = data.draw(st.dictionaries(st.integers(0, 10 * len(poses)), places, min_size=1, max_size=5))
    correction = said(dict(sorted(told.items())))
    recollection = driven(poses)
    anew = recollection.corrected(correction)
    if anew is not None:
        recollection.observations[:] = anew.observations
        again = recollection.corrected(correction)
        on_stamps = all(stamp % 10 == 0 for stamp in told)
        assert not on_stamps or again is None


def test_what_was_before_the_first_pose_stays(hear):
    poses = [Transform.planar(float(k), 0.0, 0.0) for k in range(6)]
    anew = driven(poses).corrected(said({20: Transform.planar(2.0, 1.0, 0.0), 40: Transform.planar(4.0, 3.0, 0.0)}))
    assert anew is not None and anew.moved == 4
    assert [one.T_map_base.y_m for one in anew.observations] == pytest.approx([0.0, 0.0, 1.0, 2.0, 3.0, 3.0])
    assert anew.reason == "4 of 6 observations moved, by up to 3.00 m, 0.00°"


def test_poses_of_times_at_which_nothing_was_observed_say_nothing():
    poses = [Transform.planar(float(k), 0.0, 0.0) for k in range(3)]
    assert driven(poses).corrected(said({-30: Transform.planar(9.0, 9.0, 1.0), 70: Transform.identity()})) is None
    assert Recollection().corrected(said({0: Transform.identity()})) is None
    assert driven(poses).corrected(said({})) is None


def test_ready_maps_lie_where_their_maker_put_them():
    recollection = driven([Transform.identity()] * 3)
    recollection.observations.append(seen(15, Transform.identity(), GRID_MESSAGE))
    anew = recollection.corrected(said({0: Transform.planar(1.0, 0.0, 0.0)}))
    assert anew is not None and anew.moved == 3
    assert anew.observations[-1] is recollection.observations[-1]


def test_a_sensor_that_is_the_robot_is_put_exactly_where_it_is_told():
    T_old, T_new = Transform.planar(0.1, 0.2, 0.3), Transform.planar(0.7, 0.6, 0.5)
    one = replace(seen(0, T_old), T_map_sensor=T_old)
    anew = Recollection([one]).corrected(said({0: T_new}))
    assert anew is not None and anew.observations[0].T_map_sensor == anew.observations[0].T_map_base
