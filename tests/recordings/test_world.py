"""Floor plans: doors, repeated parts, clutter, and what is wrong with a bad file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mapgraft.errors import ConfigError
from mapgraft_recordings.simulator import build_world, cast_rays, distance_to_walls, load_plan, parse_plan, unit_vectors

ROOM: dict[str, Any] = {
    "walls": [{"line": [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]], "doors": [{"at_m": 1.5, "width_m": 1.0}]}]
}


def plan_of(floor: dict[str, Any], **parts: Any) -> Any:
    return parse_plan({"name": "test", "parts": parts, "floor": floor})


def look(segments: np.ndarray, x: float, y: float, bearing_deg: float) -> float:
    return float(cast_rays(np.array([[x, y]]), unit_vectors(np.radians([bearing_deg])), segments, 50.0)[0])


def test_walls_have_thickness_and_doors_are_open() -> None:
    walls = build_world(plan_of(ROOM), seed=0).segments
    assert look(walls, 1.5, 1.5, 90) == pytest.approx(1.5 - 0.06)
    assert look(walls, 3.0, 1.5, 270) == pytest.approx(1.5 - 0.06)
    assert look(walls, 1.5, 1.5, 270) == np.inf
    assert look(walls, 0.99, 1.5, 270) == pytest.approx(1.5 - 0.06)
    assert look(walls, 1.01, 1.5, 270) == np.inf


def test_a_door_on_a_later_side_is_measured_along_the_whole_line() -> None:
    room = {"walls": [{"line": [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]], "doors": [{"at_m": 5.5, "width_m": 1.0}]}]}
    walls = build_world(plan_of(room), seed=0).segments
    assert look(walls, 2.0, 1.5, 0) == np.inf
    assert look(walls, 2.0, 2.5, 0) == pytest.approx(2.0 - 0.06)


def test_placed_parts_are_exact_copies() -> None:
    one = build_world(plan_of(ROOM), seed=0).segments
    two = build_world(
        plan_of({"parts": [{"part": "room"}, {"part": "room", "at": [10, 5, 180]}]}, room=ROOM), seed=0
    ).segments
    assert np.array_equal(two[: len(one)], one)
    assert np.allclose(two[len(one) :], np.array([10, 5, 10, 5]) - one, atol=1e-12)


def test_clutter_varies_with_the_seed_alone_and_keeps_clear_of_ways() -> None:
    floor = {**ROOM, "clutter": [{"name": "stool", "size": [0.3, 0.3], "within": [0.5, 0.5, 3.5, 2.5], "count": 5}]}
    way = np.stack((np.full(30, 1.5), np.linspace(0, 3, 30)), axis=1)
    same = [build_world(plan_of(floor), seed=3, keep_clear=way).segments for _ in range(2)]
    assert np.array_equal(*same)
    assert not np.array_equal(same[0], build_world(plan_of(floor), seed=4, keep_clear=way).segments)
    assert distance_to_walls(way[5:-5], same[0][-20:]).min() >= 0.5


@pytest.mark.parametrize(
    ("floor", "parts", "said"),
    [
        ({"parts": [{"part": "hall"}]}, {"room": ROOM}, "'hall' that it does not define; it defines room"),
        (
            {"parts": [{"part": "a"}]},
            {"a": {"parts": [{"part": "b"}]}, "b": {"parts": [{"part": "a"}]}},
            "holds itself",
        ),
        ({}, {}, "neither walls nor furniture"),
        ({"walls": [{"line": [[0, 0], [2, 0]], "doors": [{"at_m": 1.8}]}]}, {}, "does not fit into its wall"),
        ({"walls": [{"line": [[0, 0], [0, 0]]}]}, {}, "twice in a row"),
        ({"wals": []}, {}, "floor.wals"),
        ({"furniture": [{"name": "bed"}]}, {}, "either a polygon or a box"),
        (
            {**ROOM, "clutter": [{"name": "sofa", "size": [1, 1], "within": [1, 1, 2, 2]}]},
            {},
            "no room for 'sofa'",
        ),
    ],
)
def test_bad_plans_say_what_is_wrong(floor: dict[str, Any], parts: dict[str, Any], said: str) -> None:
    way = np.array([[1.5, 1.5]])
    with pytest.raises(ConfigError, match=said):
        build_world(plan_of(floor, **parts), seed=0, keep_clear=way)


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no file"):
        load_plan(tmp_path / "none.yaml")
