"""Names for other systems: allowed there, and never one for two robots."""

from __future__ import annotations

import re

from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.outputs.names import RESERVED, file_names, ros_names

ROBOTS = st.lists(st.text(min_size=1, max_size=12) | st.sampled_from(["a@b", "a_b", "a b", "a__b", "1", "robot_1"]))


@settings(deadline=None)
@given(ROBOTS)
def test_ros_names_are_valid_and_injective(robots: list[str]) -> None:
    names = ros_names()
    given_names = {robot: names[robot] for robot in robots}
    assert len(set(given_names.values())) == len(given_names)
    for name in given_names.values():
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", name)
        assert name not in RESERVED
    assert {robot: names[robot] for robot in robots} == given_names == names.given


@settings(deadline=None)
@given(ROBOTS)
def test_file_names_hold_no_way_out_of_the_folder_and_are_injective(robots: list[str]) -> None:
    names = file_names()
    given_names = {robot: names[robot] for robot in robots}
    assert len(set(given_names.values())) == len(given_names)
    for name in given_names.values():
        assert "/" not in name and "\0" not in name and not name.startswith((".", "-"))


def test_valid_names_stay_as_they_are() -> None:
    assert [ros_names()[name] for name in ("robot_0", "Alice", "a")] == ["robot_0", "Alice", "a"]
    assert file_names()["beta@2"] == "beta@2"


def test_names_are_told_apart_in_order_of_appearance() -> None:
    names = ros_names()
    assert [names["beta@2"], names["beta_2"], names["beta.2"]] == ["beta_2", "beta_2_2", "beta_2_3"]
    assert [names["7"], names["merge"], names["@"]] == ["robot_7", "merge_2", "robot"]
