"""The decision table: first match by priority, then by order; a reason for everything."""

from __future__ import annotations

import pytest

from mapgraft.contracts import DecisionTableError, MapMetadata
from mapgraft.decision import build_table, facts_of, parse_rules
from mapgraft.procedures import Workshop

PROCEDURE = (
    "match: {use: slide}, accept: {use: first_one}, fuse: {use: sum}, verify: {use: at_most, metrics: [disagreement]}"
)


def table_of(plugins, tmp_path, text: str):
    path = tmp_path / "rules.yaml"
    path.write_text(text)
    return build_table(plugins, path)


@pytest.fixture
def facts():
    own = MapMetadata("beacons", resolution_m=0.05, known_area_m2=20.0, extra={"floor": 2, "indoor": True})
    other = MapMetadata("beacons", resolution_m=0.10, known_area_m2=8.0)
    return facts_of(own, other, reversal="ledger")


@pytest.mark.parametrize(
    ("condition", "why_not"),
    [
        ("resolution_ratio: {min: 0.4, max: 0.6}", None),
        ("resolution_ratio: {min: 0.6}", "resolution_ratio is 0.5, the rule wants at least 0.6"),
        ("resolution_ratio: {max: 0.1}", "resolution_ratio is 0.5, the rule wants at most 0.1"),
        ("own.type: [beacons, buoys]", None),
        ("own.type: [buoys, bells]", "own.type is beacons, the rule wants buoys or bells"),
        ("prior: true", "prior is false, the rule wants true"),
        ("prior: 0", "prior is false, the rule wants 0"),
        ("own.floor: 2", None),
        ("own.indoor: true", None),
        ("other.floor: 2", "other.floor is not told"),
        ("own.type: {min: 2}", "own.type is beacons, the rule wants a number"),
        ("reversal: single_map", "reversal is ledger, the rule wants single_map"),
    ],
)
def test_conditions_say_why_they_fail(plugins, tmp_path, facts, condition, why_not):
    table = table_of(plugins, tmp_path, f"- {{name: r, when: {{{condition}}}, {PROCEDURE}}}")
    ruling = table.choose(facts)
    assert ruling.rejected == (why_not is not None)
    assert ruling.findings[0].reason == (why_not or "applies")


def test_priority_goes_before_order_and_order_decides_among_equals(plugins, tmp_path, facts):
    text = "".join(f"- {{name: {n}, priority: {p}, {PROCEDURE}}}\n" for n, p in (("a", 0), ("b", 5), ("c", 5)))
    ruling = table_of(plugins, tmp_path, text).choose(facts)
    assert ruling.rule.name == "b"
    assert [finding.rule for finding in ruling.findings] == ["b"]


def test_a_rule_may_turn_a_pair_away(plugins, tmp_path, facts):
    small = "- {name: small, when: {other.known_area_m2: {max: 10}}, reject: too small yet}"
    ruling = table_of(plugins, tmp_path, f"{small}\n- {{name: r, {PROCEDURE}}}").choose(facts)
    assert ruling.rejected
    assert ruling.reason == "too small yet"


def test_a_reversal_that_a_rule_does_not_allow(plugins, tmp_path):
    table = table_of(plugins, tmp_path, f"- {{name: r, reverse: {{allow: [ledger]}}, {PROCEDURE}}}")
    m = MapMetadata("beacons")
    assert (
        "reversal is single_map, the rule allows ledger" in table.choose(facts_of(m, m, reversal="single_map")).reason
    )


def test_the_reason_tells_only_of_rules_for_maps_of_these_types(plugins, tmp_path, facts):
    others = f"- {{name: of others, when: {{other.type: [snow, sand]}}, {PROCEDURE}}}"
    small = f"- {{name: small, when: {{own.type: beacons, other.known_area_m2: {{max: 0}}}}, {PROCEDURE}}}"
    assert table_of(plugins, tmp_path, others).choose(facts).reason.startswith("no rule takes a map of type ")
    ruling = table_of(plugins, tmp_path, f"{others}\n{small}").choose(facts)
    assert ruling.reason.startswith("no rule applies: 'small': other.known_area_m2 is")
    assert "of others" not in ruling.reason
    assert [(finding.rule, finding.about) for finding in ruling.findings] == [("of others", False), ("small", True)]
    turned = f"{others}\n{small}\n- {{name: last, reject: never}}"
    assert "of others" not in table_of(plugins, tmp_path, turned).choose(facts).reason


def test_an_empty_table_rejects(plugins, tmp_path, facts):
    assert table_of(plugins, tmp_path, "[]").choose(facts).reason == "the decision table is empty"


def test_all_faults_of_a_table_at_once():
    text = """
- {name: b, whn: 1, when: {foo: 1}}
- {name: c, match: {use: x}}
- {name: d, reject: no, match: {use: x}}
"""
    with pytest.raises(DecisionTableError) as error:
        parse_rules(text, "of a test")
    for part in ("4 fault(s)", "rule 1 (b), when: there is no field 'foo'", "rule 1 (b), whn: there is no such key",
                 "rule 2 (c)", "accept, fuse, verify missing", "rule 3 (d)", "not both"):  # fmt: skip
        assert part in str(error.value)


def test_a_users_rule_that_names_nothing_is_an_error_with_a_hint(plugins, tmp_path):
    with pytest.raises(DecisionTableError, match="no matcher called 'slid': did you mean 'slide'"):
        table_of(plugins, tmp_path, f"- {{name: r, {PROCEDURE.replace('slide', 'slid')}}}")


def test_a_plugins_rule_that_names_nothing_never_applies_and_says_why(plugins, facts):
    plugins.offered.pop(("matcher", "slide"))
    ruling = build_table(plugins).choose(facts)
    assert "there is no matcher called 'slide'" in ruling.reason


def test_a_plugin_with_a_faulty_table_is_broken_not_fatal(plugins, facts):
    text = plugins.rules[0]
    plugins.rules.insert(0, type(text)("bad", "- {name: x}", text.origin))
    assert not build_table(plugins).choose(facts).rejected
    assert "procedure needs match" in plugins.broken[0].reason


def test_types_that_a_procedure_cannot_take(plugins, tmp_path):
    table = table_of(plugins, tmp_path, f"- {{name: r, {PROCEDURE}}}")
    grid, beacons = MapMetadata("occupancy_grid"), MapMetadata("beacons")
    assert "the matcher 'slide' takes beacons, not occupancy_grid" in table.choose(facts_of(grid, grid)).reason
    assert "there is no conversion from occupancy_grid to beacons" in table.choose(facts_of(beacons, grid)).reason


def test_rules_of_one_name_keep_their_own_tools_and_equal_tools_are_made_once(plugins, tmp_path):
    text = "".join(
        f"- {{name: r, {PROCEDURE.replace('use: first_one', f'use: first_one, least: {least}')}}}\n" for least in (2, 9)
    )
    workshop = Workshop(plugins)
    one, other = (workshop.tools(record.rule) for record in table_of(plugins, tmp_path, text).records)
    assert (one.acceptor.acceptor.least, other.acceptor.acceptor.least) == (2, 9)
    assert one.matcher.matcher is other.matcher.matcher
