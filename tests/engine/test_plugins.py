"""Plugins are loaded apart from each other: what is wrong with one is said and harms no other."""

from __future__ import annotations

from types import ModuleType

import pytest

from mapgraft.contracts import ConfigError, Descriptor, PluginError, hookimpl
from mapgraft.plugins import Origin, Plugins, load_plugin

STRANGER = Origin("stranger", "stranger-package", "2.0")


def module_with(**functions) -> ModuleType:
    module = ModuleType("stranger")
    for name, function in functions.items():
        function.__name__ = name
        setattr(module, name, hookimpl(function))
    return module


def registering(*descriptors):
    def implementation(register):
        for descriptor in descriptors:
            register(descriptor)

    return implementation


def test_nothing_behind_a_descriptor_is_imported_by_listing():
    plugins = Plugins()
    far = Descriptor("far", "a.module.that.is.not.there:Thing", "lazy")
    load_plugin(plugins, module_with(register_metrics=registering(far)), STRANGER)
    assert plugins.of_kind("metric")[0].origin == STRANGER
    with pytest.raises(PluginError, match="the metric 'far' of stranger cannot be loaded: ModuleNotFoundError"):
        plugins.make("metric", "far")


def test_a_misspelt_hook_is_an_error_that_names_the_hooks():
    with pytest.raises(PluginError, match=r"register_metric.*the hooks are register_map_types"):
        load_plugin(Plugins(), module_with(register_metric=registering()), STRANGER)


def test_a_failing_hook_adds_nothing():
    def fails(register):
        raise RuntimeError("no luck")

    plugins = Plugins()
    good = registering(Descriptor("m", "beacons:Slide", "x"))
    with pytest.raises(RuntimeError):
        load_plugin(plugins, module_with(register_matchers=good, register_metrics=fails), STRANGER)
    assert not plugins.offered


def test_two_plugins_may_not_offer_the_same_thing(plugins):
    again = module_with(register_matchers=registering(Descriptor("slide", "beacons:Slide", "x")))
    with pytest.raises(PluginError, match="stranger offers the matcher 'slide', which beacons has"):
        load_plugin(plugins, again, STRANGER)


def test_an_unknown_name_says_which_there_are(plugins):
    with pytest.raises(PluginError, match="there is no verifier called 'at_mots': did you mean 'at_most'"):
        plugins.find("verifier", "at_mots")
    with pytest.raises(PluginError, match="installed are slide"):
        plugins.find("matcher", "zzz")


def test_a_misspelt_parameter_says_which_there_are(plugins):
    with pytest.raises(
        ConfigError, match="the verifier 'at_most' has no parameter 'limt': it has limit, confirm_after"
    ):
        plugins.make("verifier", "at_most", {"limt": 3})


def test_what_is_missing_is_listed_with_what_to_install():
    plugins = Plugins()
    needs = Descriptor("far", "beacons:Slide", "x", requires=("no_such_module", "no.such.thing"), extra="far")
    load_plugin(plugins, module_with(register_matchers=registering(needs)), STRANGER)
    assert plugins.of_kind("matcher")[0].missing == ("no_such_module", "no.such.thing")
    with pytest.raises(
        PluginError, match=r"needs no_such_module, no.such.thing: pip install 'stranger-package\[far\]'"
    ):
        plugins.make("matcher", "far")


@pytest.mark.parametrize(
    "broken",
    [
        lambda: Descriptor("", "a:b", "x"),
        lambda: Descriptor("a b", "a:b", "x"),
        lambda: Descriptor("a", "a.b", "x"),
        lambda: Descriptor("a", "a:b", "x", api=(2, 0)),
    ],
)
def test_a_descriptor_checks_itself(broken):
    with pytest.raises(PluginError):
        broken()
