"""Two places that robots have driven through, with true poses."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

import oracle
import pytest

from mapgraft.config import parse_config
from mapgraft.evaluation import Bench, Course, Drawing, Settings, build
from mapgraft.plugins import Origin, Plugins, load_plugin, load_plugins
from mapgraft_recordings.buildings import building, drive

if importlib.util.find_spec("mapgraft_landmarks") is None:
    sys.path.append(str(Path(__file__).parents[1] / "third_party" / "landmarks" / "src"))

RULES = """
- name: whatever matches
  when: {own.type: occupancy_grid, other.type: occupancy_grid}
  match: {use: oracle}
  accept: {use: thresholds}
  fuse: {use: log_odds}
  verify: {use: thresholds, metrics: {similarity: {min: 0.0}}, every: 5, patience: 1, confirm_after: 5, new_support: 0}
"""


@pytest.fixture(scope="session")
def courses() -> list[Course]:
    """One robot in a place, two robots in another."""
    one, other = building(3), building(5)
    return [
        Course.of(0, "ann", "one", drive(one, 1, 160)),
        Course.of(1, "bob", "other", drive(other, 1, 90)),
        Course.of(2, "cid", "other", drive(other, 2, 150)),
    ]


@pytest.fixture
def plugins() -> Plugins:
    """Everything that is installed, and the matchers that know the truth."""
    found = load_plugins()
    load_plugin(found, oracle, Origin("oracle", "mapgraft-oracle", "1.0"))
    return found


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    """A decision table that takes whatever is matched."""
    path = tmp_path / "rules.yaml"
    path.write_text(RULES)
    return path


@pytest.fixture
def tell_truth(courses: list[Course], plugins: Plugins) -> Callable[[Settings], None]:
    """Tell the oracle the truth about all pairs that will be drawn."""

    def tell(settings: Settings) -> None:
        bench = Bench(courses, parse_config({}), plugins, settings)
        oracle.TRUTH.clear()
        for plan in bench.plans:
            pair = build(plan, *bench.new_types())
            if pair.truth is not None:
                key = pair.receiver.map.known(), pair.donor.map.known()
                assert key not in oracle.TRUTH
                oracle.TRUTH[key] = pair.truth.T_receiver_donor

    return tell


@pytest.fixture
def small() -> Drawing:
    """Few small windows."""
    return Drawing(pairs=12, scans=20, further=5, across=0.25, seed=7)
