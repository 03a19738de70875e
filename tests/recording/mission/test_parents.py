"""Frames that a recording hangs on two others, both of which lead to the map: nobody guesses, a person chooses."""

from __future__ import annotations

import pytest

from mapgraft.errors import ConfigError


def test_a_tree_with_two_parents_is_not_guessed_at(record, mission):
    file = record().drive(4)
    for k in range(81):
        file.tf(k / 20, "map", "base_link", 7.0)
    found = mission(file.write())
    assert not list(found.observations())
    (topic,) = found.tally
    assert {cause: dropped.count for cause, dropped in topic.dropped.items()} == {"two_parents": 20}
    assert "choose with poses.parents: {base_link: " in found.tally.sentences()[0]
    chosen = mission(file.write(), {"run": {"poses": {"map_frame": "odom"}}})
    assert len(list(chosen.observations())) == 20


@pytest.mark.parametrize(("parent", "x_m"), [("map", 7.0), ("odom", 1.0)])
def test_which_of_two_parents_counts_can_be_chosen(record, mission, parent, x_m):
    file = record().drive(4)
    for k in range(81):
        file.tf(k / 20, "map", "base_link", 7.0)
    chosen = mission(file.write(), {"run": {"poses": {"parents": {"base_link": parent}}}})
    (robot,) = chosen.robots
    assert robot.map_frame == "map" and ("odom" in robot.poses) is (parent == "odom")
    seen = list(chosen.observations())
    assert len(seen) == 20 and not any(topic.dropped for topic in chosen.tally) and not chosen.faults
    assert seen[0].T_map_base.x_m == pytest.approx(x_m, abs=0.2)
    assert (seen[0].T_map_base == seen[-1].T_map_base) is (parent == "map")


def test_a_chosen_parent_must_be_one(record, mission):
    file = record().drive(4).write()
    for parents, said in (
        ({"base_link": "moon"}, "poses.parents hangs 'base_link' on 'moon': in the recording it hangs on 'odom'"),
        ({"moon": "map"}, "poses.parents hangs 'moon' on 'map': in the recording it hangs on nothing"),
    ):
        with pytest.raises(ConfigError, match=said):
            mission(file, {"run": {"poses": {"parents": parents}}})
