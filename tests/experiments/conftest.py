"""A small experiment on the demo recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import pytest

from mapgraft.config import ReversalName, parse_config
from mapgraft.contracts import Exactness, Transform
from mapgraft.evaluation import Course, PairPlan, Window, load_courses
from mapgraft.experiments.andersone2021 import (
    STRATEGIES,
    Combination,
    Experiment,
    Kept,
    Laboratory,
    Merge,
    Search,
    Settings,
    conduct,
)
from mapgraft.experiments.andersone2021.outcome import Cost, Leftovers, Watched
from mapgraft.experiments.andersone2021.settings import PAPER
from mapgraft.experiments.andersone2021.telling.presentation import present
from mapgraft.job import provenance_of
from mapgraft.outputs.provenance import RunProvenance
from mapgraft.plugins import load_plugins
from mapgraft_recordings import demo_files


@pytest.fixture(scope="session")
def laboratory() -> Laboratory:
    """Two right and two wrong merges are wanted of each combination."""
    config, plugins = parse_config({}), load_plugins()
    return Laboratory.of(load_courses(demo_files()[0], config, plugins), config, Settings(right=2, wrong=2), plugins)


@pytest.fixture(scope="session")
def experiment(laboratory: Laboratory) -> Experiment:
    return conduct(laboratory)


@pytest.fixture(scope="session")
def provenance(laboratory: Laboratory) -> RunProvenance:
    """What the small experiment was made of."""
    return provenance_of(demo_files()[0], laboratory.config, load_plugins(), laboratory.table)


@pytest.fixture(scope="session")
def files(experiment: Experiment, laboratory: Laboratory, provenance: RunProvenance) -> Mapping[str, bytes]:
    """Everything that the small experiment tells."""
    told = present(experiment, laboratory, provenance, "nobody named another")
    return {**told.files, **told.last()}


@pytest.fixture
def made() -> Callable[..., Merge]:
    """Make a merge by hand: its kind and draw, and SM and DM in one map and in two, at the merge and in the end."""

    def make(
        right: bool,
        number: int,
        one: tuple[float, float] = (0.99, 1.0),
        two: tuple[float, float] = (0.95, 2.0),
        combination: Combination = PAPER[0],
        costs_s: tuple[float, float, float] = (1.0, 1.5, 0.9),
        watched: Watched | None = None,
    ) -> Merge:
        numbers = {"single_map": one, "multi_map": two, "ledger": two}
        by = {
            strategy: _kept(strategy, *numbers[strategy], combination, cost_s)
            for strategy, cost_s in zip(STRATEGIES, costs_s, strict=True)
        }
        course = Course.of(0, "ann", "a place", ())
        windows = (Window(course, 400 * number + 100 * side, 30, 10) for side in (0, 1))
        plan = PairPlan(number, *windows, 0.0, 0.0)
        seen = watched or Watched("", "", "", {}, {})
        T = Transform.identity()
        return Merge(combination, number, plan, right, 0.5, 0.0 if right else 9.0, 0.0, T, 0.95, by, seen)

    return make


def _kept(strategy: ReversalName, similarity: float, distance: float, combination: Combination, cost_s: float) -> Kept:
    numbers = {
        "similarity": similarity,
        "similarity.limit": 0.9,
        "distance": distance,
        "distance.metres": distance * combination.own_m,
        "distance.limit": 1.5,
    }
    exact = strategy != "single_map"
    left = Leftovers(100, 0, 0, 0, 0, identical=True) if exact else Leftovers(100, 1, 2, 3, 10, identical=False)
    statement = Exactness(exact, 0, 0 if exact else 20)
    return Kept(strategy, numbers, numbers, Cost(cost_s, 0.0, 0.5), statement, 0.1, left)


@pytest.fixture
def experiment_of() -> Callable[[Sequence[Merge]], Experiment]:
    """An experiment of merges that were made by hand."""

    def make(merges: Sequence[Merge]) -> Experiment:
        combinations = tuple(dict.fromkeys(merge.combination for merge in merges))
        settings = Settings(right=len(merges), wrong=len(merges), combinations=combinations)
        searches = [Search(combination, 9, 3, 4, 1, 1) for combination in combinations]
        return Experiment(settings, "carpin", 0.9, merges, searches, {}, [], 12.0)

    return make
