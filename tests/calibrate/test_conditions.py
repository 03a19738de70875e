"""Conditions that are put together, and the names of rules that were made of another one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.calibrate.conditions import together
from mapgraft.calibrate.groups import Group, named, told
from mapgraft.decision import Condition, Range, Value, holds

values = st.sampled_from([True, False, 0, 1, 2, 0.5, 1.5, "a", "b", "1"])
ends = st.none() | st.sampled_from([0.0, 0.5, 1.0, 1.5, 2.0])
conditions = values | st.lists(values, max_size=4) | st.builds(Range, min=ends, max=ends)
metres = st.none() | st.floats(1e-4, 1e4).map(told)
types = st.sampled_from(["occupancy_grid", "m", "0.07", "←", "x,"])


@given(st.lists(conditions, min_size=1, max_size=4), values)
def test_what_is_put_together_holds_where_all_hold(those: list[Condition], value: Value) -> None:
    both = together(*({"own.x": condition} for condition in those))
    assert (both is not None and holds(both["own.x"], value)) == all(holds(condition, value) for condition in those)


def test_conditions_on_other_fields_stay() -> None:
    assert together({"a.x": 1, "a.y": "p"}, {"a.z": Range(min=1.0), "a.y": ["p", "q"]}) == {
        "a.x": 1,
        "a.y": "p",
        "a.z": Range(min=1.0),
    }
    assert together({"a.x": 1}, {"a.x": 2}) is None


@given(st.text(min_size=1), types, types, metres, metres, st.booleans())
def test_the_name_of_a_rule_that_was_made_tells_its_group(
    base: str, own: str, other: str, own_m: float | None, other_m: float | None, resolutions: bool
) -> None:
    sizes = (own_m, other_m) if resolutions else (None, None)
    group = Group(base, own, other, "ledger", *sizes, resolutions=resolutions)
    assert named(group.rule_name(base)) == group


@pytest.mark.parametrize(
    "name", ["grids", "grids: small ones", "a: b ← c", "a: b 0.070 m ← c, ledger", "b ← c, ledger"]
)
def test_other_names_tell_no_group(name: str) -> None:
    assert named(name) is None
