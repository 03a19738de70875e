"""How acceptors and verifiers are used: their parameters, and what is measured for them, as the installed rules say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple, cast

from mapgraft.comparison import Compared, Sight
from mapgraft.contracts import Match, Metric, Step, Transform
from mapgraft.decision import Rule, build_table
from mapgraft.plugins import PluginKind, Plugins
from mapgraft.reversal import new_reversal
from mapgraft.testing.laws import NotTriedError
from mapgraft.testing.observing import observe
from mapgraft.testing.rooms import Room
from mapgraft.testing.supply import Supply, layer_of

_ROOM: Final = Room(6.0, 4.0, (1.5, 1.2), ((1.0, 1.0, 0.1), (4.0, 1.2, 0.1)))
_POSES: Final = [(2.5, 1.0, 0.0), (3.2, 1.6, 1.0)]


class Use(NamedTuple):
    """How one rule uses a judge: its parameters, and the metrics that it is given with their details' names."""

    rule: str
    parameters: dict[str, object]
    measured: dict[str, tuple[str, ...]]

    @property
    def evidence(self) -> tuple[str, ...]:
        """The matcher's numbers that the rule bounds."""
        bounded = self.parameters.get("evidence")
        return tuple(map(str, bounded)) if isinstance(bounded, Mapping) else ()


def judged_in_rules(plugins: Plugins, kind: PluginKind, name: str, supply_of: Callable[[str], Supply]) -> list[Use]:
    """Every use of an acceptor or verifier in a rule of the default table that can be tried, equal ones once."""
    uses: list[Use] = []
    for record in build_table(plugins).records:
        rule = record.rule
        if rule.reject is not None or record.lacking is not None:
            continue
        choice = rule.procedure.accept if kind == "acceptor" else rule.procedure.verify
        if choice.use != name:
            continue
        own = rule.via or rule.when.get("own.type")
        if not isinstance(own, str):
            continue
        try:
            measured = {name: _details(plugins, rule, name, supply_of(own)) for name in rule.procedure.metric_names}
        except NotTriedError:  # nobody can make maps of that type here
            continue
        use = Use(rule.name, dict(choice.parameters), measured)
        if all(use[1:] != other[1:] for other in uses):
            uses.append(use)
    return uses


def _details(plugins: Plugins, rule: Rule, name: str, supply: Supply) -> tuple[str, ...]:
    """The names of a metric's details, found out by measuring a little room."""
    metric = cast("Metric", plugins.make("metric", name, rule.metrics.get(name, {})))
    kind, here = supply.make_map_type(), Transform.identity()
    reversal = new_reversal("ledger", kind)
    for observation in observe(supply.kind, _ROOM, _POSES, here, "receiver"):
        reversal.observe(observation)
    donor = layer_of(supply.make_map_type(), observe(supply.kind, _ROOM, _POSES, here, "donor"))
    compared = Compared(kind, "own", here, Match(here, 1.0, 1.0), kind.place(donor, here), Sight(reversal, kind))
    return tuple(metric.track(compared).update(Step()).details)
