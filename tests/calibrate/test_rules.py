"""The rules that a calibration makes: laws that hold for any decision table and any labels."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.calibrate import Asked, Calibration, Labelled, Labels, calibrate
from mapgraft.calibrate.fitting import RuleFit
from mapgraft.calibrate.groups import Group, named
from mapgraft.calibrate.rules import plain
from mapgraft.calibrate.table import rules_text
from mapgraft.decision import Rule, Value, build_table, parse_rules
from mapgraft.errors import UsageError
from mapgraft.plugins import Plugins, load_plugins
from mapgraft_standard.acceptance import Thresholds
from mapgraft_standard.calibrated import Calibrated
from mapgraft_standard.sequential import Sequential

Make = Callable[..., list[Labelled]]
GRIDS = {"own.type": "occupancy_grid", "other.type": "occupancy_grid"}
FINE = "occupancy_grid 0.07 m ← occupancy_grid 0.07 m, ledger"
SIZES = (0.05, 0.0703, 0.07, 0.1)


@cache
def plugins() -> Plugins:
    return load_plugins()


def table_of(text: str) -> list[Rule]:
    """The rules of a table, which a run must be able to use."""
    given_rules = parse_rules(text, "here")
    rules = [record.rule for record in build_table(plugins(), [plain(rule) for rule in given_rules]).records]
    acceptors = {"calibrated": Calibrated, "thresholds": Thresholds}
    for rule in rules:
        if rule.reject is None:
            name = rule.procedure.accept.use
            if name in acceptors:
                acceptors[name](**rule.procedure.accept.parameters)
            if rule.procedure.verify.use == "sequential":
                Sequential(**rule.procedure.verify.parameters)
    return rules


def all_facts() -> list[dict[str, Value]]:
    sides = itertools.product(SIZES, SIZES, (10.0, 50.0), ("ledger", "single_map"), (None, 0.3))
    out = []
    for own_m, other_m, area_m2, reversal, sigma_m in sides:
        facts: dict[str, Value] = {**GRIDS, "own.resolution_m": own_m, "other.resolution_m": other_m}
        facts |= {"other.known_area_m2": area_m2, "reversal": reversal, "prior": sigma_m is not None}
        out.append(facts if sigma_m is None else facts | {"prior_sigma_m": sigma_m})
    return out


FACTS = all_facts()

# what rules may say

sizes = st.fixed_dictionaries({}, optional={"min": st.sampled_from(SIZES), "max": st.sampled_from(SIZES)})
fields = {
    "own.type": st.sampled_from(["occupancy_grid", ["occupancy_grid", "line_segments"], "point_cloud"]),
    "own.resolution_m": sizes | st.sampled_from([0.07, [0.07, 0.1]]),
    "other.resolution_m": sizes,
    "other.known_area_m2": st.just({"max": 40}),
    "reversal": st.sampled_from(["ledger", ["ledger", "single_map"]]),
    "prior_sigma_m": st.just({"max": 0.5}),
}
made_acceptors = [
    {"use": "calibrated", "score": {"posterior.log_odds": 1.0}, "metrics": {"posterior": {}, "paths": {"max": 2}}},
    {"use": "calibrated", "limits": {"score_min": 3, "metrics": {"paths": {}}}, "metrics": ["paths", "posterior"]},
]
acceptors = [
    {"use": "posterior", "metrics": {"posterior": {}, "paths": {"max": 4}, "similarity": {}}, "refuted": -3.0},
    {"use": "posterior", "metric": "kappa", "metrics": ["kappa"]},
    {"use": "thresholds"},
    {"use": "thresholds", "margin_min": 20, "evidence": {"x": {"min": 3}}, "metrics": {"paths": {"max": 4}}},
    *made_acceptors,
]
reversals = st.fixed_dictionaries(
    {}, optional={name: st.builds(lambda b: {"confirm": b}, st.booleans()) for name in ("ledger", "single_map")}
)
limits_of_the_test = st.fixed_dictionaries(
    {},
    optional={
        "confirm": st.booleans(),
        "confirm_at": st.sampled_from([-9.0, -3.0, 1.0]),
        "revert_at": st.sampled_from([2.0, 9.0]),
        "revert_below": st.sampled_from([0.0, 0.3]),
        "reversals": reversals,
    },
)


@st.composite
def procedures(draw: st.DrawFn, *, made: bool) -> dict[str, Any]:
    verify: dict[str, Any] = {"use": "sequential", "metrics": ["news"], "log": {"metrics": ["posterior"]}}
    verify |= draw(limits_of_the_test)
    if draw(st.sampled_from([False, False, False, True])):
        verify = {"use": "thresholds", "metrics": {"similarity": {"min": 0.8}}}
    accept = draw(st.sampled_from(made_acceptors if made else acceptors))
    rule = {"match": {"use": "correlation"}, "accept": accept, "fuse": {"use": "log_odds"}, "verify": verify}
    return rule | draw(st.sampled_from([{}, {"candidates": 3}]))


@st.composite
def tables(draw: st.DrawFn) -> list[dict[str, Any]]:
    """A procedure ``a`` among others, rules that turn away, and some that look as if made of it by a calibration."""
    names = st.sampled_from(["a", "b", f"a: {FINE}", f"a: {FINE}", "c\n  - name: d"])
    out = []
    for number in range(draw(st.integers(1, 5))):
        name = "a" if number == 0 else draw(names)
        is_procedure = number == 0 or (name != "a" and draw(st.booleans()))
        body = draw(procedures(made=name.startswith("a: "))) if is_procedure else {"reject": "it's small: # no"}
        chosen = {name: draw(fields[name]) for name in sorted(draw(st.sets(st.sampled_from(list(fields)), max_size=2)))}
        out.append({"name": name, "when": GRIDS | chosen, **body, "priority": draw(st.sampled_from([0, 0, 10]))})
    return draw(st.permutations(out))


@st.composite
def which_labels(draw: st.DrawFn) -> list[tuple[str, str, float, int, str]]:
    one = st.tuples(
        st.sampled_from(["a", "a", "b"]),
        st.sampled_from(["x", "y"]),
        st.sampled_from([0.07, 0.1]),
        st.sampled_from([20, 90]),
        st.sampled_from(["ledger", "single_map"]),
    )
    return draw(st.lists(one, min_size=1, max_size=3, unique=True))


@pytest.fixture(scope="module")
def labels(made: Make) -> Callable[..., Labels]:
    """Labels of several rules, buildings, resolutions and reversals; those of a kind are always the same."""

    @cache
    def of(rule: str, building: str, own_m: float, count: int, reversal: str) -> list[Labelled]:
        group = Group(rule, "occupancy_grid", "occupancy_grid", reversal, own_m, 0.07, resolutions=True)
        return made(building, count, int(1000 * own_m), of=group, watched=True, share=0.5)

    def all_of(those: Sequence[tuple[str, str, float, int, str]]) -> Labels:
        return Labels([example for one in those for example in of(*one)], folders=["x"])

    return all_of


ASKED = Asked(0.1, 0.05, 0.1)


def maybe(labels: Labels, rules: list[Rule]) -> Calibration | None:
    try:
        return calibrate(labels, rules, ASKED)
    except UsageError:
        return None


def base(name: str) -> str:
    group = named(name)
    return name if group is None else group.rule


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(tables(), which_labels())
def test_a_table_that_was_written_rejects_what_was_rejected_and_keeps_its_order(
    labels: Callable[..., Labels], given_rules: list[dict[str, Any]], those: Any
) -> None:
    before = build_table(plugins(), given_rules)
    found = maybe(labels(those), [record.rule for record in before.records])
    if found is None:
        return
    text = rules_text(found)
    table_of(text)
    after = build_table(plugins(), [plain(rule) for rule in parse_rules(text, "here")])
    rules = iter(record.rule for record in after.records)
    for one in found.table:  # in the given order, and what labels do not tell of as it was
        if isinstance(one, RuleFit):
            while base((rule := next(rules)).name) == one.rule.name != rule.name:
                assert rule.priority == one.rule.priority
            assert (rule.name, rule.priority) == (one.rule.name, one.rule.priority)
        else:
            assert next(rules) == one.rule
    assert next(rules, None) is None
    order = [id(record.rule) for record in before.records]
    places = [order.index(id(one.rule)) for one in found.table]
    assert places == sorted(set(places))
    gone = {rule.name for one in found.rules for rule in one.given.made}
    for facts in FACTS:
        was, now = before.choose(facts), after.choose(facts)
        assert now.rejected or not was.rejected
        if was.rule is not None and now.rule is not None and not gone:
            assert base(now.rule.name) == base(was.rule.name)
            assert was.rejected == now.rejected


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(tables(), which_labels())
def test_calibrating_with_the_table_just_written_gives_it_again(
    labels: Callable[..., Labels], given_rules: list[dict[str, Any]], those: Any
) -> None:
    rules = [record.rule for record in build_table(plugins(), given_rules).records]
    found = maybe(labels(those), rules)
    if found is None:
        return
    text = rules_text(found)
    assert rules_text(calibrate(labels(those), table_of(text), ASKED)) == text
