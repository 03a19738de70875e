"""The table that comes with the grids: it loads, its tools can be made, and it says what it should."""

from __future__ import annotations

from mapgraft.contracts import MapMetadata
from mapgraft.decision import Rule, facts_of, parse_rules
from mapgraft.plugins import load_plugins
from mapgraft.procedures import Workshop
from mapgraft_grid.correlation import Correlation
from mapgraft_grid.distance import Distance
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.quality import MODEL_FILE
from mapgraft_grid.similarity import Similarity
from mapgraft_standard.known_pose import KnownPose


def rules() -> dict[str, Rule]:
    text = (MODEL_FILE.parent / "rules.yaml").read_text(encoding="utf-8")
    return {rule.name: rule for rule in parse_rules(text, "of the package")}


def test_every_rule_names_installed_tools_and_parameters_they_take() -> None:
    workshop = Workshop(load_plugins())
    known, found = (workshop.tools(rule) for rule in rules().values())
    assert isinstance(known.matcher.matcher, KnownPose) and isinstance(found.matcher.matcher, Correlation)
    for tools in (known, found):
        fuser, metrics = tools.fuser.fuser, {name: guarded.metric for name, guarded in tools.metrics.items()}
        assert isinstance(fuser, LogOdds) and fuser.quality == "windowed"
        assert isinstance(metrics["similarity"], Similarity) and isinstance(metrics["distance"], Distance)
    assert isinstance(workshop.map_type("occupancy_grid"), OccupancyGrid)


def test_the_package_registers_what_it_has() -> None:
    plugins = load_plugins()
    ours = {(kind, name) for kind, name in _offered(plugins)}
    assert {
        ("map type", "occupancy_grid"),
        ("matcher", "carpin"),
        ("matcher", "correlation"),
        ("matcher", "known_pose"),
        ("fuser", "log_odds"),
        ("metric", "similarity"),
        ("metric", "distance"),
        ("metric", "bayes_factor"),
        ("metric", "contradiction"),
        ("metric", "recall"),
        ("metric", "rays"),
        ("metric", "paths"),
        ("metric", "posterior"),
        ("metric", "news"),
        ("acceptor", "thresholds"),
        ("acceptor", "posterior"),
        ("verifier", "thresholds"),
        ("verifier", "sequential"),
    } <= ours


def test_a_pose_that_somebody_knows_goes_first() -> None:
    by_priority = sorted(rules().values(), key=lambda rule: -rule.priority)
    assert [rule.procedure.match.use for rule in by_priority] == ["known_pose", "correlation"]
    assert by_priority[0].when["prior_sigma_m"].max == 0.5
    facts = facts_of(MapMetadata("occupancy_grid", 0.05), MapMetadata("occupancy_grid", 0.5))
    low = by_priority[1].when["resolution_ratio"]
    assert low.min <= facts["resolution_ratio"] <= low.max


def _offered(plugins: object) -> list[tuple[str, str]]:
    kinds = ("map type", "matcher", "fuser", "metric", "acceptor", "verifier")
    return [(kind, offered.descriptor.name) for kind in kinds for offered in plugins.of_kind(kind)]
