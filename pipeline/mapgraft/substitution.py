"""Another matcher or another verifier in every rule of a decision table."""

from __future__ import annotations

from typing import Any

from mapgraft.config import Choice
from mapgraft.decision import DecisionTable, Rule, Verification, build_table
from mapgraft.errors import PluginError, UsageError
from mapgraft.plugins import PluginKind, Plugins


def substituted(
    table: DecisionTable, plugins: Plugins, *, matcher: str | None = None, verifier: str | None = None
) -> DecisionTable:
    """The table with this matcher and this verifier, where they are named, in every procedure.

    A matcher that a rule of the table uses comes with that rule's parameters (the procedure's own rule goes first), any
    other with its defaults. A verifier stays as it is where a procedure uses it, and else comes with its defaults and
    all metrics of the procedure: the limits of one rule mean little in another. Rules that name what is not installed
    are left out. Raises UsageError when there is no matcher or verifier of that name.
    """
    if matcher is None and verifier is None:
        return table
    _require(plugins, "matcher", matcher)
    _require(plugins, "verifier", verifier)
    rules = [record.rule for record in table.records if record.lacking is None]
    return build_table(plugins, [_changed(rule, rules, matcher, verifier) for rule in rules])


def _changed(rule: Rule, rules: list[Rule], matcher: str | None, verifier: str | None) -> dict[str, Any]:
    content = rule.model_dump(mode="json", exclude_unset=True)
    if rule.reject is not None:
        return content
    procedure = rule.procedure
    if matcher is not None:
        used = [r.match for r in (rule, *rules) if r.match is not None and r.match.use == matcher]
        content["match"] = (used[0] if used else Choice(use=matcher)).model_dump(mode="json", exclude_unset=True)
    if verifier is not None and procedure.verify.use != verifier:
        bare = Verification(use=verifier, metrics=list(procedure.metric_names), every=procedure.verify.every)
        content["verify"] = bare.model_dump(mode="json", exclude_unset=True)
    return content


def _require(plugins: Plugins, kind: PluginKind, name: str | None) -> None:
    if name is None:
        return
    try:
        plugins.find(kind, name)
    except PluginError as error:
        raise UsageError(str(error)) from None
