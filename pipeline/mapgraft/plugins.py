"""Loading plugins, one at a time and apart from each other, and making what they offer."""

from __future__ import annotations

import difflib
import importlib.metadata
import importlib.util
import inspect
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import pluggy

from mapgraft import hooks
from mapgraft.contracts.plugin import CONTRACT, DECLARED_IN, PROJECT, UNDECLARED, Descriptor, require_contract
from mapgraft.errors import ConfigError, MapgraftError, PluginError

GROUP = OWN = "mapgraft"
NO_AUTOLOAD = "MAPGRAFT_DISABLE_PLUGIN_AUTOLOAD"

PluginKind = Literal[
    "map type",
    "matcher",
    "acceptor",
    "fuser",
    "metric",
    "verifier",
    "conversion",
    "policy",
    "reader",
    "decoder",
    "format",
]
HOOK_OF: dict[PluginKind, str] = {
    "map type": "register_map_types",
    "matcher": "register_matchers",
    "acceptor": "register_acceptors",
    "fuser": "register_fusers",
    "metric": "register_metrics",
    "verifier": "register_verifiers",
    "conversion": "register_conversions",
    "policy": "register_policies",
    "reader": "register_readers",
    "decoder": "register_decoders",
    "format": "register_formats",
}


class Origin(NamedTuple):
    """Which entry point of which distribution a thing came from."""

    plugin: str
    distribution: str
    version: str


class Hop(NamedTuple):
    """One conversion on the way from one map type to another: its name, and the map type that it gives."""

    conversion: str
    target: str


@dataclass(frozen=True, slots=True)
class Offered:
    """One descriptor with its kind and where it came from."""

    kind: PluginKind
    descriptor: Descriptor
    origin: Origin

    @property
    def missing(self) -> tuple[str, ...]:
        """The modules it needs that are not installed."""
        return tuple(name for name in self.descriptor.requires if not _importable(name))

    @property
    def remedy(self) -> str:
        """What to install when something is missing; empty when nothing is."""
        if not self.missing:
            return ""
        extra = self.descriptor.extra
        what = f"{self.origin.distribution}[{extra}]" if extra else " ".join(self.missing)
        return f"needs {', '.join(self.missing)}: pip install '{what}'"


@dataclass(frozen=True, slots=True)
class RuleText:
    name: str
    text: str
    origin: Origin


@dataclass(frozen=True, slots=True)
class Broken:
    origin: Origin
    reason: str


@dataclass(slots=True)
class Plugins:
    """What is installed. Nothing behind a descriptor is imported before ``make`` or ``function`` asks for it."""

    offered: dict[tuple[PluginKind, str], Offered] = field(default_factory=dict)
    rules: list[RuleText] = field(default_factory=list)
    broken: list[Broken] = field(default_factory=list)

    def of_kind(self, kind: PluginKind) -> list[Offered]:
        return [offered for (k, _), offered in sorted(self.offered.items()) if k == kind]

    def find(self, kind: PluginKind, name: str) -> Offered:
        """The descriptor of a name; raises PluginError that says which names there are."""
        if found := self.offered.get((kind, name)):
            return found
        names = [offered.descriptor.name for offered in self.of_kind(kind)]
        close = difflib.get_close_matches(name, names, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"installed are {', '.join(names) or 'none'}"
        if self.broken:
            hint += f" ({len(self.broken)} plugin(s) could not be loaded: see 'mapgraft plugins list')"
        raise PluginError(f"there is no {kind} called {name!r}: {hint}")

    def way(self, source: str, target: str) -> tuple[Hop, ...] | None:
        """The fewest conversions that lead from one map type to another, none for the same; None where none lead there.

        Of several ways of one length that whose conversions come first by name.
        """
        reached: dict[str, tuple[Hop, ...]] = {source: ()}
        fresh = [source]
        while fresh and target not in reached:
            further = []
            for name in fresh:
                for hop in self._hops(name):
                    if hop.target not in reached:
                        reached[hop.target] = (*reached[name], hop)
                        further.append(hop.target)
            fresh = further
        return reached.get(target)

    def _hops(self, source: str) -> list[Hop]:
        return [
            Hop(offered.descriptor.name, offered.descriptor.gives)
            for offered in self.of_kind("conversion")
            if source in offered.descriptor.accepts and offered.descriptor.gives and not offered.missing
        ]

    def function(self, kind: PluginKind, name: str) -> Callable[..., object]:
        """The factory behind a name, imported now; raises PluginError when it cannot be."""
        offered = self.find(kind, name)
        if offered.missing:
            raise PluginError(f"the {kind} {name!r} {offered.remedy}")
        module_name, _, attribute = offered.descriptor.factory.partition(":")
        try:
            found: object = importlib.import_module(module_name)
            for part in attribute.split("."):
                found = getattr(found, part)
        except Exception as error:  # a stranger's module may fail in any way
            raise PluginError(
                f"the {kind} {name!r} of {offered.origin.plugin} cannot be loaded: {type(error).__name__}: {error}"
            ) from error
        if not callable(found):
            raise PluginError(f"the {kind} {name!r}: {offered.descriptor.factory} is not callable")
        return found

    def make(self, kind: PluginKind, name: str, parameters: Mapping[str, object] | None = None) -> object:
        """Call the factory behind a name with its parameters.

        Raises ConfigError for a parameter that the factory does not have, PluginError when it cannot be loaded.
        """
        factory, given = self.function(kind, name), dict(parameters or {})
        known = inspect.signature(factory).parameters
        if not any(p.kind is inspect.Parameter.VAR_KEYWORD for p in known.values()):
            unknown = sorted(set(given) - set(known))
            if unknown:
                raise ConfigError(
                    f"the {kind} {name!r} has no parameter {', '.join(map(repr, unknown))}: "
                    f"it has {', '.join(known) or 'none'}"
                )
        try:
            return factory(**given)
        except TypeError as error:
            raise ConfigError(f"the {kind} {name!r} refused its parameters {given}: {error}") from error
        except MapgraftError:
            raise
        except Exception as error:  # a stranger's constructor may fail in any way
            raise PluginError(f"the {kind} {name!r} cannot be made: {type(error).__name__}: {error}") from error


def load_plugins(without: Collection[str] = ()) -> Plugins:
    """All installed plugins, mapgraft's own first, then by entry point; a broken one is noted and skipped.

    ``without`` names entry points to leave out. With MAPGRAFT_DISABLE_PLUGIN_AUTOLOAD set only mapgraft's own
    distribution is loaded.
    """
    plugins = Plugins()
    if unknown := sorted(set(without) - set(importlib.metadata.entry_points(group=GROUP).names)):
        names = ", ".join(sorted(importlib.metadata.entry_points(group=GROUP).names))
        raise PluginError(f"there is no plugin {', '.join(unknown)} to leave out: installed are {names}")
    found = [(_origin_of(entry_point), entry_point) for entry_point in importlib.metadata.entry_points(group=GROUP)]
    own_only = bool(os.environ.get(NO_AUTOLOAD))
    taken: dict[str, Origin] = {}
    for origin, entry_point in sorted(found, key=lambda pair: (pair[0].distribution != OWN, *pair[0], pair[1].value)):
        if entry_point.name in without or (own_only and origin.distribution != OWN):
            continue
        try:
            if other := taken.get(entry_point.name):
                raise PluginError(
                    f"there is a plugin {origin.plugin!r} of {other.distribution} already: uninstall one of the two "
                    f"(pip uninstall {origin.distribution})"
                )
            taken[entry_point.name] = origin
            load_plugin(plugins, entry_point.load(), origin)
        except Exception as error:  # one broken plugin must not take the others with it
            plugins.broken.append(Broken(origin, _reason(error)))
    return plugins


def _reason(error: Exception) -> str:
    """Why a plugin could not be loaded, in one sentence."""
    if isinstance(error, PluginError):
        return str(error)
    said = f"{type(error).__name__}: {error}"
    if isinstance(error, ImportError) and (error.name or "").startswith(f"{OWN}."):
        return f"{said}; it was written for another contract than {'.'.join(map(str, CONTRACT))}: update one of the two"
    return said


def load_plugin(plugins: Plugins, module: object, origin: Origin) -> None:
    """Add everything that one module registers; raises PluginError, and adds nothing, when something is wrong."""
    require_contract(origin.plugin, getattr(module, DECLARED_IN, UNDECLARED))
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(hooks)
    offered: dict[tuple[PluginKind, str], Offered] = {}
    rules: list[RuleText] = []
    try:
        manager.register(module, name=origin.plugin)
        manager.check_pending()
    except pluggy.PluginValidationError as error:
        raise PluginError(f"{origin.plugin}: {error}; the hooks are {', '.join(_hook_names())}") from error
    for kind, hook in HOOK_OF.items():
        getattr(manager.hook, hook)(register=_register(kind, origin, offered, plugins.offered))
    manager.hook.register_rules(register=lambda name, text: rules.append(RuleText(name, text, origin)))
    plugins.offered.update(offered)
    plugins.rules.extend(rules)


def _register(
    kind: PluginKind,
    origin: Origin,
    offered: dict[tuple[PluginKind, str], Offered],
    taken: Mapping[tuple[PluginKind, str], Offered],
) -> Callable[[Descriptor], None]:
    def register(descriptor: Descriptor) -> None:
        if not isinstance(descriptor, Descriptor):
            raise PluginError(f"{origin.plugin} registered a {type(descriptor).__name__}: register a Descriptor")
        key = (kind, descriptor.name)
        if other := taken.get(key) or offered.get(key):
            raise PluginError(
                f"{origin.plugin} offers the {kind} {descriptor.name!r}, which {other.origin.plugin} has: "
                "rename it, or leave one of the two out (--no-plugin)"
            )
        offered[key] = Offered(kind, descriptor, origin)

    return register


def _hook_names() -> Iterable[str]:
    return (*HOOK_OF.values(), "register_rules")


def _origin_of(entry_point: importlib.metadata.EntryPoint) -> Origin:
    distribution = entry_point.dist
    if distribution is None:
        return Origin(entry_point.name, entry_point.module, "unknown")
    return Origin(entry_point.name, distribution.name, distribution.version)


def _importable(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # the parent package is missing
        return False
