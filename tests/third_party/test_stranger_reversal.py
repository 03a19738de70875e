"""The laws of reversing, with a stranger's map type: whatever happens in whatever order, what is reverted is gone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mapgraft_landmarks.layer import LandmarkLayer
from mapgraft_landmarks.map_type import PointLandmarks
from mapgraft_landmarks.union import LandmarkUnion

from mapgraft.config import ReversalName
from mapgraft.contracts import Contribution, Donation, Match, Observation, Provenance, Transform
from mapgraft.reversal import Reversal, new_reversal

TYPE = PointLandmarks()
DONORS = ("birch", "cedar")
START = 6  # scans before anything else may happen
Scans = Callable[[str, float], list[Observation]]
Step = tuple[str, str, int]

steps = st.lists(
    st.tuples(st.sampled_from(["observe", "merge", "replace", "revert"]), st.sampled_from(DONORS), st.integers(0, 3)),
    max_size=14,
)


def mapped(observations: list[Observation]) -> LandmarkLayer:
    layer = TYPE.new_layer()
    for observation in observations:
        TYPE.integrate(layer, observation)
    return layer


@pytest.fixture(scope="module")
def own(scans: Scans) -> list[Observation]:
    return scans("ash", 12.0)


@pytest.fixture(scope="module")
def contributions(scans: Scans, own: list[Observation]) -> dict[str, list[Contribution]]:
    """Of every donor four: growing layers, at places and with weights of their own."""
    target = TYPE.view(mapped(own[:START]))
    made: dict[str, list[Contribution]] = {}
    for turn, donor in enumerate(DONORS):
        observed = scans(donor, 8.0)
        made[donor] = []
        for version in range(1, 5):
            T = Transform.planar(1.7 * version, -0.6 * version, 0.9 * turn + 0.3 * version)
            donation = Donation(mapped(observed[: 4 * version]), Provenance(donor, 1, 4 * version))
            fuser = LandmarkUnion(weight=1 + version % 2)
            made[donor].append(fuser.fuse(TYPE, target, donation, Match(T, score=1.0, margin=1.0)))
    return made


def play(
    name: ReversalName, script: list[Step], own: list[Observation], contributions: dict[str, list[Contribution]]
) -> tuple[Reversal, int, dict[str, Contribution]]:
    """The reversal after the script, how many scans it has seen, and what stands in it."""
    reversal = new_reversal(name, TYPE)
    for observation in own[:START]:
        reversal.observe(observation)
    seen, standing = START, dict[str, Contribution]()
    for action, donor, version in script:
        if action == "observe" and seen < len(own):
            reversal.observe(own[seen])
            seen += 1
        elif action == "merge" and donor not in standing:
            standing[donor] = contributions[donor][version]
            reversal.merge(donor, standing[donor])
        elif action == "replace" and donor in standing and name != "single_map":
            standing[donor] = contributions[donor][version]
            reversal.replace(donor, standing[donor])
        elif action == "revert" and donor in standing:
            reversal.revert(donor)
            del standing[donor]
        reversal.fused()  # somebody looks in between
    return reversal, seen, standing


@pytest.mark.parametrize("name", ["ledger", "multi_map"])
@settings(max_examples=25, deadline=None)
@given(script=steps)
def test_exact_reversals_hold_what_is_left_and_nothing_else(
    name: ReversalName, script: list[Step], own: list[Observation], contributions: dict[str, list[Contribution]]
) -> None:
    reversal, seen, standing = play(name, script, own, contributions)
    alone = mapped(own[:seen])
    assert TYPE.encode(reversal.offered_layer()) == TYPE.encode(alone)
    expected = TYPE.view(alone, [standing[donor] for donor in sorted(standing)])
    fused = reversal.fused()
    assert np.array_equal(fused.cells.keys, expected.cells.keys)
    assert np.array_equal(fused.cells.counts, expected.cells.counts)
    assert TYPE.files(fused, "map") == TYPE.files(expected, "map")
    for donor in standing:
        assert reversal.revert(donor).exact
    assert TYPE.files(reversal.fused(), "map") == TYPE.files(TYPE.view(alone), "map")


@settings(max_examples=25, deadline=None)
@given(before=st.integers(0, 6), after=st.integers(0, 6), version=st.integers(0, 3), donor=st.sampled_from(DONORS))
def test_a_single_map_states_what_stays(
    before: int,
    after: int,
    version: int,
    donor: str,
    own: list[Observation],
    contributions: dict[str, list[Contribution]],
) -> None:
    script: list[Step] = [("observe", "", 0)] * before + [("merge", donor, version)] + [("observe", "", 0)] * after
    reversal, seen, _ = play("single_map", script, own, contributions)
    said = reversal.revert(donor)
    left, clean = reversal.fused().cells, TYPE.view(mapped(own[:seen])).cells
    keys = np.union1d(left.keys, clean.keys)
    assert said.cells_contaminated == np.count_nonzero((left.at(keys) != clean.at(keys)).any(axis=1))
    assert said.cells_reset + said.cells_contaminated == len(contributions[donor][version].region)
    assert said.exact is (said.cells_contaminated == 0)
