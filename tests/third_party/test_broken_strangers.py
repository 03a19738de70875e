"""A stranger's faults are reported, and everybody else goes on."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from mapgraft.contracts import CONTRACT

Run = Callable[..., subprocess.CompletedProcess[str]]
Place = Callable[..., Path]

HEALTHY = """
from mapgraft.contracts import Descriptor, hookimpl

@hookimpl
def register_matchers(register):
    register(Descriptor("healthy", "healthy:Healthy", "does its work"))
"""
BROKEN_IMPORT = "import a_module_that_nobody_has_installed\n"
MISSPELT_HOOK = """
from mapgraft.contracts import Descriptor, hookimpl

@hookimpl
def register_matchers(register):
    register(Descriptor("half", "misspelt:Half", "is not registered either"))

@hookimpl
def register_metrix(register):
    pass
"""
TAKEN_NAME = """
from mapgraft.contracts import Descriptor, hookimpl

@hookimpl
def register_acceptors(register):
    register(Descriptor("thresholds", "taken:Thresholds", "a name that is taken"))
"""
OTHER_CONTRACT = """
from mapgraft.contracts import Descriptor, hookimpl

@hookimpl
def register_metrics(register):
    register(Descriptor("old", "outdated:Old", "of long ago", api=(0, 9)))
"""
BAD_RULES = """
from mapgraft.contracts import hookimpl

@hookimpl
def register_rules(register):
    register("odd", "- {name: odd, when: {own.type: x}, macth: {use: carpin}}")
"""
LATE_FAILURE = """
from mapgraft.contracts import Descriptor, hookimpl

@hookimpl
def register_matchers(register):
    register(Descriptor("late", "late_parts:Matcher", "fails when it is used"))
"""


@pytest.fixture(scope="module")
def listed(lay_out: Place, mapgraft: Run) -> dict[str, list[dict[str, str]]]:
    """What ``plugins list --json`` says with all of them installed at once."""
    strangers = {
        "healthy": HEALTHY,
        "broken": BROKEN_IMPORT,
        "misspelt": MISSPELT_HOOK,
        "taken": TAKEN_NAME,
        "outdated": OTHER_CONTRACT,
        "rules": BAD_RULES,
        "late": LATE_FAILURE,
    }
    done = mapgraft(["plugins", "list", "--json"], [lay_out(name, text) for name, text in strangers.items()])
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    said: dict[str, list[dict[str, str]]] = json.loads(done.stdout)
    return said


@pytest.mark.parametrize(
    ("plugin", "sentence"),
    [
        ("broken", "No module named 'a_module_that_nobody_has_installed'"),
        ("misspelt", "register_metrix"),
        ("taken", "'thresholds', which standard has"),
        ("outdated", "was written for contract 0.9"),
        ("rules", "macth"),
    ],
)
def test_a_fault_is_reported(listed: dict[str, list[dict[str, str]]], plugin: str, sentence: str) -> None:
    (fault,) = [fault for fault in listed["broken"] if fault["plugin"] == plugin]
    assert sentence in fault["reason"]
    assert (fault["distribution"], fault["version"]) == (f"mapgraft-{plugin}", "0.1")


def test_a_misspelt_hook_names_the_right_ones(listed: dict[str, list[dict[str, str]]]) -> None:
    (fault,) = [fault for fault in listed["broken"] if fault["plugin"] == "misspelt"]
    assert "register_metrics" in fault["reason"]


def test_nothing_of_a_broken_plugin_is_registered(listed: dict[str, list[dict[str, str]]]) -> None:
    broken = {fault["plugin"] for fault in listed["broken"]}
    assert broken == {"broken", "misspelt", "taken", "outdated", "rules"}
    assert not [offered for offered in listed["offered"] if offered["plugin"] in broken]


def test_everybody_else_goes_on(listed: dict[str, list[dict[str, str]]]) -> None:
    names = {offered["name"] for offered in listed["offered"]}
    assert {"healthy", "late", "occupancy_grid", "thresholds"} <= names


def test_a_stranger_cannot_take_a_name_of_ours_by_coming_first(lay_out: Place, mapgraft: Run) -> None:
    listed = json.loads(mapgraft(["plugins", "list", "--json"], [lay_out("earlier", TAKEN_NAME)]).stdout)
    assert [fault["plugin"] for fault in listed["broken"]] == ["earlier"]


def test_a_person_is_told_too(lay_out: Place, mapgraft: Run) -> None:
    done = mapgraft(["plugins", "list"], [lay_out("broken", BROKEN_IMPORT)])
    assert done.returncode == 0
    assert "broken: broken (mapgraft-broken)" in done.stdout
    assert "occupancy_grid" in done.stdout


def test_what_fails_when_used_fails_with_a_sentence(lay_out: Place, mapgraft: Run) -> None:
    done = mapgraft(["plugins", "show", "late"], [lay_out("late", LATE_FAILURE)])
    assert done.returncode == 1
    assert "the matcher 'late' of late cannot be loaded" in done.stderr
    assert "late_parts" in done.stderr
    assert "Traceback" not in done.stderr


def test_strangers_can_be_left_out(lay_out: Place, mapgraft: Run) -> None:
    folders = [lay_out("healthy", HEALTHY), lay_out("broken", BROKEN_IMPORT)]
    without = json.loads(mapgraft(["plugins", "list", "--json", "--no-plugin", "broken"], folders).stdout)
    assert without["broken"] == []
    assert "healthy" in {offered["name"] for offered in without["offered"]}
    own = {"MAPGRAFT_DISABLE_PLUGIN_AUTOLOAD": "1"}
    alone = json.loads(mapgraft(["plugins", "list", "--json"], folders, own).stdout)
    assert alone["broken"] == []
    assert {offered["distribution"] for offered in alone["offered"]} == {"mapgraft"}


DECLARES = """
from mapgraft.contracts import Descriptor, hookimpl

MAPGRAFT_CONTRACT = {version}

@hookimpl
def register_matchers(register):
    register(Descriptor("{name}", "{name}_parts:Matcher", "declares its contract"))
"""
RENAMED_SINCE = "from mapgraft.contracts import SomethingOfLater\n"


def test_a_plugin_for_another_contract_is_told_in_one_sentence(lay_out: Place, mapgraft: Run) -> None:
    strangers = {
        "fits": DECLARES.format(version="(1, 0)", name="fits"),
        "older": DECLARES.format(version="(0, 7)", name="older"),
        "newer": DECLARES.format(version="(1, 999)", name="newer"),
        "nonsense": DECLARES.format(version="'1.0'", name="nonsense"),
        "renamed": RENAMED_SINCE,
    }
    done = mapgraft(["plugins", "list", "--json"], [lay_out(name, text) for name, text in strangers.items()])
    said = json.loads(done.stdout)
    reasons = {fault["plugin"]: fault["reason"] for fault in said["broken"]}
    here = ".".join(map(str, CONTRACT))
    assert reasons.keys() == strangers.keys() - {"fits"}
    assert reasons["older"] == f"older was written for contract 0.7, this mapgraft has {here}: update the plugin"
    assert reasons["newer"] == f"newer was written for contract 1.999, this mapgraft has {here}: update mapgraft"
    assert reasons["nonsense"].endswith("as MAPGRAFT_CONTRACT = (1, 0), found '1.0'")
    assert "'SomethingOfLater'" in reasons["renamed"]
    assert reasons["renamed"].endswith(f"it was written for another contract than {here}: update one of the two")
    assert "fits" in {offered["name"] for offered in said["offered"]}


def test_two_plugins_of_one_name_are_told_apart(lay_out: Place, mapgraft: Run) -> None:
    first = lay_out("twin", HEALTHY.replace("healthy", "twin").replace('"twin"', '"one"'))
    other = lay_out("twin_again", HEALTHY.replace("healthy", "twin_again"))
    entry_points = other / "mapgraft_twin_again-0.1.dist-info" / "entry_points.txt"
    entry_points.write_text("[mapgraft]\ntwin = twin_again\n")
    said = json.loads(mapgraft(["plugins", "list", "--json"], [first, other]).stdout)
    (fault,) = said["broken"]
    sentence = "there is a plugin 'twin' of mapgraft-twin already: uninstall one of the two"
    assert fault["reason"] == f"{sentence} (pip uninstall mapgraft-twin_again)"
    assert {"one"} <= {offered["name"] for offered in said["offered"]}


def test_an_extra_that_is_not_installed_is_told_in_one_sentence(lay_out: Place, mapgraft: Run) -> None:
    missing = HEALTHY.replace('"does its work")', '"lacks", requires=("no_such_module_here",), extra="fancy")')
    folder = lay_out("healthy", missing)
    (row,) = [
        row
        for row in json.loads(mapgraft(["plugins", "list", "--json"], [folder]).stdout)["offered"]
        if row["name"] == "healthy"
    ]
    assert row["missing"] == "needs no_such_module_here: pip install 'mapgraft-healthy[fancy]'"
    listed = mapgraft(["plugins", "list"], [folder], {"COLUMNS": "300"}).stdout
    assert "pip install 'mapgraft-healthy[fancy]'" in listed
