"""The laws of a plugin as a whole: that it can be listed lightly, and that what it offers is there."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import os
import subprocess
import sys
from typing import ClassVar, Final

from mapgraft.contracts.plugin import CONTRACT, DECLARED_IN
from mapgraft.decision import parse_rules
from mapgraft.errors import ConfigError, DecisionTableError, PluginError
from mapgraft.plugins import Offered, Origin, PluginKind, Plugins, load_plugin
from mapgraft.procedures import METHODS
from mapgraft.testing.laws import BrokenLawError, Drawing, Laws, law, require

_LONGEST_S: Final = 120
_LIST: Final = """
import importlib, json, sys
import mapgraft.contracts, mapgraft.plugins
before = set(sys.modules)
plugins = mapgraft.plugins.Plugins()
module = importlib.import_module(sys.argv[1])
mapgraft.plugins.load_plugin(plugins, module, mapgraft.plugins.Origin(sys.argv[1], sys.argv[1], ""))
print(json.dumps(sorted(set(sys.modules) - before)))
"""
_TYPED: Final[dict[PluginKind, tuple[str, ...]]] = {
    "map type": ("observes",),
    "conversion": ("accepts", "gives"),
    "reader": ("accepts",),
    "decoder": ("accepts", "gives"),
    "format": ("accepts", "gives"),
}
_FLAGS: Final[dict[str, PluginKind]] = {"uses_prior": "matcher", "needs_prior": "matcher", "stream": "metric"}
_FUNCTIONS: Final = ("reader", "decoder", "format")


class PluginLaws(Laws):
    """What a plugin's module promises; ``module`` is what its entry point names."""

    examples: ClassVar[int] = 1
    module: ClassVar[str] = ""

    @law("listing the plugin imports nothing of what it offers, nor what that requires")
    def test_listing_imports_none_of_it(self, drawing: Drawing) -> None:
        command = [sys.executable, "-c", _LIST, self.module]
        here = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        done = subprocess.run(command, capture_output=True, text=True, env=here, timeout=_LONGEST_S, check=False)
        require(done.returncode == 0, f"it cannot be listed: {(done.stderr.splitlines() or ['?'])[-1]}")
        imported = set(json.loads(done.stdout.splitlines()[-1]))
        behind = {offered.descriptor.factory.partition(":")[0] for offered in self._offered()} - {self.module}
        behind |= {name for offered in self._offered() for name in offered.descriptor.requires}
        early = sorted(behind & imported)
        require(not early, f"importing {self.module} imports {', '.join(early)}")

    @law("every factory can be loaded and takes only keywords that have a default")
    def test_factories_are_there(self, drawing: Drawing) -> None:
        plugins = self._plugins()
        for offered in self._offered():
            name, kind = offered.descriptor.name, offered.kind
            if offered.missing:
                continue
            try:
                factory = plugins.function(kind, name)
            except PluginError as error:
                raise BrokenLawError(str(error)) from error
            if kind in _FUNCTIONS:
                continue
            for parameter in inspect.signature(factory).parameters.values():
                where = f"parameter {parameter.name} of the {kind} {name}"
                require(parameter.kind in (parameter.KEYWORD_ONLY, parameter.VAR_KEYWORD), f"the {where} is no keyword")
                given = parameter.kind is parameter.VAR_KEYWORD or parameter.default is not parameter.empty
                require(given, f"the {where} has no default")

    @law("what a factory makes has the methods of its kind")
    def test_things_have_their_methods(self, drawing: Drawing) -> None:
        plugins = self._plugins()
        for offered in self._offered():
            if offered.missing or offered.kind in _FUNCTIONS:
                continue
            name = offered.descriptor.name
            try:
                made = plugins.make(offered.kind, name)
            except ConfigError:
                continue  # it needs a value that only a configuration can give, and says so
            lacking = [method for method in METHODS[offered.kind] if not callable(getattr(made, method, None))]
            require(not lacking, f"the {offered.kind} {name} has no {', '.join(lacking)}")

    @law("descriptors say in one line what a thing is, and whatever its kind needs")
    def test_descriptors_are_complete(self, drawing: Drawing) -> None:
        require(self._offered() or self._plugins().rules, f"{self.module} offers nothing at all")
        for offered in self._offered():
            descriptor, who = offered.descriptor, f"the {offered.kind} {offered.descriptor.name}"
            require(descriptor.summary.strip() and "\n" not in descriptor.summary, f"{who} has no summary of one line")
            lacking = [field for field in _TYPED.get(offered.kind, ()) if not getattr(descriptor, field)]
            require(not lacking, f"{who} does not say what it {' and '.join(lacking)}")
            require(not descriptor.extra or descriptor.requires, f"{who} names an extra but not what it requires")
            odd = [flag for flag, kind in _FLAGS.items() if getattr(descriptor, flag) and kind != offered.kind]
            require(not odd, f"{who} says {' and '.join(odd)}, which means nothing for a {offered.kind}")

    @law("the module says for which version of the contracts it was written")
    def test_the_contract_is_declared(self, drawing: Drawing) -> None:
        said = hasattr(importlib.import_module(self.module), DECLARED_IN)
        require(said, f"{self.module} does not say {DECLARED_IN} = {CONTRACT}")

    @law("its rules can be parsed")
    def test_rules_can_be_parsed(self, drawing: Drawing) -> None:
        for rules in self._plugins().rules:
            try:
                parse_rules(rules.text, rules.name)
            except DecisionTableError as error:
                raise BrokenLawError(f"the rules {rules.name}: {error}") from error

    def _plugins(self) -> Plugins:
        plugins = Plugins()
        load_plugin(plugins, importlib.import_module(self.module), Origin(self.module, self.module, ""))
        return plugins

    def _offered(self) -> list[Offered]:
        return [offered for _, offered in sorted(self._plugins().offered.items())]
