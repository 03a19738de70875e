"""Matching by walls that consistently lie on each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapgraft.contracts import ConfigError, EmptyMapError, MapError, Prior, Transform
from mapgraft_lines import scene
from mapgraft_lines.line_association import LineAssociation
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.segments import from_segments

KIND = LineSegments()
MATCHER = LineAssociation()
PLAN = np.array(
    [
        [(0, 0), (9, 0)], [(9, 0), (9, 5)], [(9, 5), (4, 5)], [(4, 5), (4, 7.5)], [(4, 7.5), (0, 7.5)],
        [(0, 7.5), (0, 0)], [(3, 0), (3, 2.2)], [(6, 5), (6, 3.4)], [(0, 4), (1.7, 4)],
    ],
    np.float64,
)  # fmt: skip
CORRIDOR = np.array([[(0, 0), (20, 0)], [(20, 2), (0, 2)]], np.float64)


def placed(points, x, y, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return points @ np.array([[c, s], [-s, c]]) + (x, y)


def of(points, **more):
    return KIND.view(from_segments(KIND, points, 0.02, **more))


@pytest.mark.parametrize("faced", [False, True])
@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.0, math.pi])
def test_a_plan_is_found_in_itself(faced, yaw):
    T = Transform.planar(31.0, -7.0, yaw)
    matches = MATCHER.match(of(placed(PLAN, 31.0, -7.0, yaw), faced=faced), of(PLAN, faced=faced))
    shift_m, turn_rad = matches[0].T_receiver_donor.difference(T)
    assert shift_m < 0.02 and turn_rad < 0.005
    assert matches[0].margin > 5.0 and len(matches) >= 2
    assert [m.score for m in matches] == sorted((m.score for m in matches), reverse=True)
    assert matches[0].evidence["degenerate"] == 0.0


def test_scans_of_two_drives_find_each_other(office):
    first, second = KIND.new_layer(), KIND.new_layer()
    for observation in office[:70]:
        KIND.integrate(first, observation)
    for observation in office[50:130]:
        KIND.integrate(second, observation)
    T = Transform.planar(-3.0, 8.0, 2.2)
    best = MATCHER.match(KIND.view(first), KIND.view(KIND.place(second, T.inverse())))[0]
    walls = KIND.structure(KIND.view(second))
    off = np.hypot(*(best.T_receiver_donor.apply(T.inverse().apply(walls)) - walls).T).mean()
    assert off < 0.2
    assert best.evidence["explained_m"] > 20.0
    assert best.covariance is not None
    assert 0.0 < best.evidence["sigma_max_m"] < 0.2


def test_walls_seen_from_the_wrong_side_do_not_match():
    """A room from inside and a pillar of its size from outside have the same lines."""
    room = np.array([[(0, 0), (4, 0)], [(4, 0), (4, 3)], [(4, 3), (0, 3)], [(0, 3), (0, 0)]], np.float64)
    inside, outside = of(room, faced=True), of(room[:, ::-1], faced=True)
    whole = MATCHER.match(inside, inside)[0]
    wrong = MATCHER.match(inside, outside)
    assert whole.evidence["explained_target"] > 0.95
    assert not wrong or wrong[0].evidence["explained_target"] < 0.8


def test_walls_in_free_space_count_against():
    x, y = np.meshgrid(np.arange(0.4, 8.8, 0.2), np.arange(0.4, 4.8, 0.2))
    free = np.column_stack((x.ravel(), y.ravel()))
    more = np.concatenate((PLAN, [[(4.6, 0.9), (4.6, 3.0)]]))  # stands where the other map is free
    clear, crowded = (MATCHER.match(of(PLAN, free_m=free), of(points))[0] for points in (PLAN, more))
    assert clear.evidence["against_m"] == 0.0
    assert crowded.evidence["against_m"] > 1.5
    assert crowded.score < clear.score


def test_parallel_walls_say_what_is_missing():
    with pytest.raises(MapError, match=r"the target's 2 walls all run one way.*map 1 m of wall across them"):
        MATCHER.match(of(CORRIDOR), of(PLAN))
    with pytest.raises(MapError, match="the source's 2 walls"):
        MATCHER.match(of(PLAN), of(CORRIDOR))


def test_along_a_corridor_a_prior_says_where_and_the_match_how_little_it_knows():
    turned = placed(CORRIDOR, 3.0, 1.0, 0.5)
    guess = Transform.planar(3.05, 1.05, 0.51)
    covariance = np.diag([0.04, 0.04, 0.0, 0.0, 0.0, 0.01])
    best = MATCHER.match(of(turned), of(CORRIDOR), Prior(guess, covariance, "somebody"))[0]
    assert best.evidence["degenerate"] == 1.0
    assert best.evidence["degenerate_dir_rad"] == pytest.approx(0.5, abs=0.03)
    across = best.T_receiver_donor.apply(np.zeros((1, 2)))[0] - (3.0, 1.0)
    assert abs(-math.sin(0.5) * across[0] + math.cos(0.5) * across[1]) < 0.02
    assert best.evidence["prior_score"] <= best.score


def test_a_prior_restricts_the_search():
    T = Transform.planar(31.0, -7.0, 0.4)
    target, source = of(placed(PLAN, 31.0, -7.0, 0.4)), of(PLAN)
    sure = np.diag([0.01, 0.01, 0.0, 0.0, 0.0, 0.001])
    near = MATCHER.match(target, source, Prior(T, sure, "somebody"))
    assert near[0].T_receiver_donor.difference(T)[0] < 0.02
    elsewhere = Transform.planar(34.0, -9.0, 2.4)
    for match in MATCHER.match(target, source, Prior(elsewhere, sure, "somebody")):
        assert match.T_receiver_donor.difference(elsewhere)[0] < 2.0
        assert match.score < near[0].score
    with pytest.raises(MapError, match="covariance"):
        MATCHER.match(target, source, Prior(T, np.eye(3), "somebody"))


def test_symmetric_places_have_no_margin():
    square = np.array([[(0, 0), (5, 0)], [(5, 0), (5, 5)], [(5, 5), (0, 5)], [(0, 5), (0, 0)]], np.float64)
    matches = MATCHER.match(of(square), of(square))
    assert len(matches) == 4
    assert matches[0].margin < 0.2 * matches[0].score
    assert matches[0].evidence["rivals"] == 3.0


def test_empty_maps_and_maps_without_walls_are_told_apart():
    nothing = KIND.view(KIND.new_layer())
    with pytest.raises(EmptyMapError, match="target's map of line segments is empty"):
        MATCHER.match(nothing, of(PLAN))
    hall = of(np.empty((0, 2, 2)), free_m=np.array([[1.0, 1.0], [2.0, 2.0]]))
    with pytest.raises(MapError, match=r"has no wall of 0\.4 m or more"):
        MATCHER.match(of(PLAN), hall)


@pytest.mark.parametrize("wrong", [{"returned": 1}, {"returned": 2.0}, {"against": -1.0}, {"against": math.nan}])
def test_impossible_parameters_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        LineAssociation(**wrong)


def test_many_walls_are_matched_by_the_longest(monkeypatch):
    monkeypatch.setattr(scene, "MOST_WALLS", 300)
    rng = np.random.default_rng(3)
    start = rng.uniform(0.0, 60.0, (1_500, 2))
    turn = rng.choice([0.0, math.pi / 2], 1_500)
    ends = np.stack(
        (start, start + rng.uniform(0.6, 5.0, (1_500, 1)) * np.column_stack((np.cos(turn), np.sin(turn)))), 1
    )
    T = Transform.planar(12.0, 4.0, 0.3)
    best = MATCHER.match(of(placed(ends, 12.0, 4.0, 0.3)), of(ends))[0]
    assert best.T_receiver_donor.difference(T)[0] < 0.1
