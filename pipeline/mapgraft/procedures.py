"""Making the tools that a rule names, once each, so that they may remember what they have computed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import cast

from mapgraft.contracts import Acceptor, Conversion, Fuser, Layer, MapType, Matcher, Metric, Policy, Verifier
from mapgraft.decision import DecisionTable, Procedure, Rule
from mapgraft.errors import ConfigError, PluginError
from mapgraft.guard import Guard
from mapgraft.guarded import (
    GuardedAcceptor,
    GuardedConversion,
    GuardedFuser,
    GuardedMatcher,
    GuardedMetric,
    GuardedVerifier,
)
from mapgraft.guarded_map_type import KIND, GuardedMapType
from mapgraft.plugins import PluginKind, Plugins

MERGING = (
    "",
    "encode",
    "decode",
    "join",
    "view",
    "place",
    "absorb",
    "region",
    "known_region",
)  # asked of map types to merge
METHODS: Mapping[PluginKind, tuple[str, ...]] = {
    "map type": (
        "new_layer",
        "integrate",
        "view",
        "place",
        "absorb",
        "reset",
        "region",
        "known_region",
        "encode",
        "decode",
        "metadata",
        "structure",
        "messages",
        "files",
    ),
    "matcher": ("match",),
    "acceptor": ("accept",),
    "fuser": ("fuse",),
    "metric": ("track",),
    "verifier": ("verify",),
    "conversion": ("convert",),
    "policy": ("due",),
}


@dataclass(frozen=True, slots=True)
class Tools:
    """The plugins of one procedure, made with the rule's parameters.

    ``refines`` says that standing merges of it are registered anew: the rule wants it and the matcher is able to.
    """

    procedure: Procedure
    matcher: Matcher
    acceptor: Acceptor
    fuser: Fuser
    metrics: Mapping[str, Metric]
    verifier: Verifier
    refines: bool = False

    @property
    def rule(self) -> Rule:
        return self.procedure.rule


@dataclass(frozen=True, slots=True)
class Converter:
    """Conversions one after the other, each with the types it leads from and to; without any a layer stays itself."""

    hops: tuple[tuple[Conversion, MapType, MapType], ...]

    def __call__(self, layer: Layer) -> Layer:
        for conversion, source, target in self.hops:
            layer = conversion.convert(layer, source, target)
        return layer


def _parts(rule: Rule) -> list[tuple[PluginKind, str, Mapping[str, object]]]:
    """What a rule with a procedure needs: kind, name and parameters of each tool."""
    procedure = rule.procedure
    parts: list[tuple[PluginKind, str, Mapping[str, object]]] = [
        ("matcher", procedure.match.use, procedure.match.parameters),
        ("acceptor", procedure.accept.use, procedure.accept.parameters),
        ("fuser", procedure.fuse.use, procedure.fuse.parameters),
        ("verifier", procedure.verify.use, procedure.verify.parameters),
    ]
    return parts + [("metric", name, rule.metrics.get(name, {})) for name in procedure.metric_names]


@dataclass(slots=True)
class Workshop:
    """Makes tools, map types and conversions from the installed plugins.

    With ``watch`` somebody looks over the tools' shoulders: what it returns works in their place. All are guarded.
    ``further`` metrics are measured beside those of each rule, wherever something is accepted or verified.
    """

    plugins: Plugins
    watch: Callable[[Tools], Tools] | None = None
    guard: Guard = field(default_factory=Guard)
    further: tuple[str, ...] = ()
    _made: dict[tuple[PluginKind, str, str], object] = field(default_factory=dict)
    _map_types: dict[str, MapType] = field(default_factory=dict)

    def prepare(self, table: DecisionTable) -> None:
        """Make the tools of every rule now, so that a wrong parameter is found before anything is mapped.

        Raises ConfigError with the faults of all rules at once. Rules that name what is not installed are left alone.
        """
        faults: list[str] = []
        for record in table.records:
            if record.rule.reject is not None or record.lacking is not None:
                continue
            faults += [f"rule {record.rule.name!r}: {fault}" for fault in self._faults(record.rule)]
        if faults:
            raise ConfigError("\n".join(faults))

    def _faults(self, rule: Rule) -> list[str]:
        faults = []
        for kind, name, parameters in _parts(rule):
            try:
                self._tool(kind, name, parameters)
            except ConfigError as error:
                faults.append(str(error))
            except PluginError:
                continue  # broken, not wrongly configured: it is said when the rule comes up
        return faults

    def tools(self, rule: Rule) -> Tools:
        """The tools of a rule that has a procedure; raises PluginError or ConfigError when one cannot be made."""
        made = {(kind, name): self._tool(kind, name, parameters) for kind, name, parameters in _parts(rule)}
        procedure, guard = rule.procedure.measuring(self.further), self.guard
        for name in self.further:
            made["metric", name] = self._tool("metric", name, rule.metrics.get(name, {}))
        match, accept, fuse, verify = (
            part.use for part in (procedure.match, procedure.accept, procedure.fuse, procedure.verify)
        )
        tools = Tools(
            procedure,
            GuardedMatcher(match, cast("Matcher", made["matcher", match]), guard),
            GuardedAcceptor(accept, cast("Acceptor", made["acceptor", accept]), guard),
            GuardedFuser(fuse, cast("Fuser", made["fuser", fuse]), guard),
            {name: GuardedMetric(name, cast("Metric", made["metric", name]), guard) for name in procedure.metric_names},
            GuardedVerifier(verify, cast("Verifier", made["verifier", verify]), guard),
            rule.refine.every is not None and self.plugins.find("matcher", procedure.match.use).descriptor.uses_prior,
        )
        return tools if self.watch is None else self.watch(tools)

    def out_of_order(self, rule: Rule, own: str, other: str) -> str | None:
        """Why a rule cannot be used any more in this run for a receiver and a donor of these types.

        One of its plugins was set aside, or of the conversions that it takes, or a map type.
        """
        if rule.reject is not None or not self.guard.set_aside:
            return None
        meeting = rule.via or own
        ways = (self.plugins.way(*pair) or () for pair in ((own, meeting), (other, meeting), (other, own)))
        used = [(kind, name, "") for kind, name, _ in _parts(rule)]
        used += [("conversion", hop.conversion, "") for way in ways for hop in way]
        used += [(KIND, name, method) for name in dict.fromkeys((own, meeting, other)) for method in MERGING]
        return next((str(why) for one in used if (why := self.guard.refused(*one)) is not None), None)

    def _tool(self, kind: PluginKind, name: str, parameters: Mapping[str, object]) -> object:
        """One tool, made once for all rules that want it with the same parameters."""
        key = (kind, name, json.dumps(parameters, sort_keys=True, default=str))
        if key not in self._made:
            self._made[key] = self._make(kind, name, parameters)
        return self._made[key]

    def new_map_type(self, name: str, parameters: Mapping[str, object]) -> MapType:
        """A map type for one robot, with its parameters."""
        return GuardedMapType(cast("MapType", self._make("map type", name, parameters)), self.guard)

    def map_type(self, name: str) -> MapType:
        """A map type without parameters that belongs to nobody: for decoding what others sent, and to meet in."""
        if name not in self._map_types:
            self._map_types[name] = self.new_map_type(name, {})
        return self._map_types[name]

    def converter(self, source: MapType, target: MapType) -> Converter:
        """What turns layers of one type into layers of another, by as many conversions as it takes.

        Raises PluginError when none lead there.
        """
        way = self.plugins.way(source.name, target.name)
        if way is None:
            raise PluginError(
                f"there is no conversion from {source.name} to {target.name}: install a plugin that offers one"
            )
        types = [source, *(self.map_type(hop.target) for hop in way[:-1]), target]
        made = [
            GuardedConversion(
                hop.conversion, cast("Conversion", self._make("conversion", hop.conversion, {})), self.guard
            )
            for hop in way
        ]
        return Converter(tuple(zip(made, types, types[1:], strict=False)))

    def policy(self, name: str, parameters: Mapping[str, object]) -> Policy:
        return cast("Policy", self._make("policy", name, parameters))

    def _make(self, kind: PluginKind, name: str, parameters: Mapping[str, object]) -> object:
        made = self.plugins.make(kind, name, parameters)
        missing = [method for method in METHODS[kind] if not callable(getattr(made, method, None))]
        if missing:
            raise PluginError(f"the {kind} {name!r} breaks its contract: it has no method {', '.join(missing)}")
        return made
