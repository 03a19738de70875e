"""The rules of the paper as a decision table, to compare with."""

from __future__ import annotations

from importlib.resources import files

from mapgraft.decision import DecisionTable, build_table, parse_rules
from mapgraft.plugins import Plugins


def paper_rules(plugins: Plugins) -> DecisionTable:
    """The decision table of Andersone 2021: one rule, for two occupancy grids."""
    text = files("mapgraft.evaluation").joinpath("paper.yaml").read_text(encoding="utf-8")
    rules = parse_rules(text, "of the paper")
    return build_table(plugins, [rule.model_dump(mode="json", exclude_unset=True) for rule in rules])
