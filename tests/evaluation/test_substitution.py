"""Another matcher or verifier in the place of the rules' own."""

from __future__ import annotations

import pytest

from mapgraft.decision import DecisionTable, Rule, build_table
from mapgraft.errors import UsageError
from mapgraft.plugins import Plugins
from mapgraft.procedures import Workshop
from mapgraft.substitution import substituted

GRIDS = {"own.type": "occupancy_grid", "other.type": "occupancy_grid"}
KNOWN = {
    "name": "known",
    "when": {**GRIDS, "prior": True},
    "match": {"use": "correlation", "returned": 7},
    "accept": {"use": "thresholds"},
    "fuse": {"use": "log_odds"},
    "verify": {"use": "thresholds", "metrics": {"similarity": {"min": 0.8}}, "patience": 5, "every": 4},
    "priority": 20,
}
FOUND = {
    "name": "found",
    "when": GRIDS,
    "match": {"use": "carpin"},
    "accept": {"use": "posterior", "metrics": {"posterior": {}, "paths": {"max": 4}}},
    "fuse": {"use": "log_odds"},
    "verify": {"use": "sequential", "metrics": ["news"], "every": 6, "log": {"metrics": ["distance", "similarity"]}},
}
NEVER = {"name": "never", "when": {"own.known_area_m2": {"max": 1}}, "reject": "less than a square metre is known"}


@pytest.fixture
def table(plugins: Plugins) -> DecisionTable:
    return build_table(plugins, [KNOWN, FOUND, NEVER])


def rules_of(table: DecisionTable) -> dict[str, Rule]:
    return {record.rule.name: record.rule for record in table.records}


def test_a_matcher_comes_with_the_parameters_of_a_rule_that_uses_it(table: DecisionTable, plugins: Plugins) -> None:
    rules = rules_of(substituted(table, plugins, matcher="correlation"))
    assert rules["never"].reject == NEVER["reject"]
    assert rules["found"].procedure.match.use == "correlation"
    assert rules["found"].procedure.match.parameters == {"returned": 7}
    assert rules["found"].procedure.verify == rules_of(table)["found"].procedure.verify
    bare = rules_of(substituted(table, plugins, matcher="known_pose"))
    assert bare["known"].procedure.match.parameters == bare["found"].procedure.match.parameters == {}


def test_a_verifier_stays_where_it_is_and_comes_with_its_defaults_elsewhere(
    table: DecisionTable, plugins: Plugins
) -> None:
    changed = substituted(table, plugins, verifier="thresholds")
    rules = rules_of(changed)
    assert rules["known"] == rules_of(table)["known"]
    verify = rules["found"].procedure.verify
    assert (verify.use, verify.parameters, verify.every) == ("thresholds", {}, 6)
    assert verify.metric_names == ("posterior", "paths", "news", "distance", "similarity")
    Workshop(plugins).prepare(changed)


def test_without_a_substitute_the_table_is_the_same(table: DecisionTable, plugins: Plugins) -> None:
    assert substituted(table, plugins) is table


@pytest.mark.parametrize("wrong", [{"matcher": "carpine"}, {"verifier": "threshold"}])
def test_who_is_not_there_is_not_put_in(table: DecisionTable, plugins: Plugins, wrong: dict[str, str]) -> None:
    with pytest.raises(UsageError, match="did you mean"):
        substituted(table, plugins, **wrong)
