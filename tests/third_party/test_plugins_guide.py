"""docs/plugins.md tells the truth: it names everything there is, and its code runs."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
import re
import subprocess
import sys
import tomllib
import typing
from collections.abc import Callable
from pathlib import Path

import beacons
import pytest

from mapgraft import contracts, hooks, testing
from mapgraft.comparison import Compared
from mapgraft.contracts import Comparison, Descriptor, MapType, Match, Metric, Step, Transform
from mapgraft.decision import Rule, parse_rules
from mapgraft.plugins import Origin, Plugins, load_plugin, load_plugins

GUIDE = Path(__file__).parents[2] / "docs" / "plugins.md"
TEXT = GUIDE.read_text(encoding="utf-8")
PROTOCOLS = [name for name in contracts.__all__ if getattr(getattr(contracts, name), "_is_protocol", False)]


def blocks(language: str) -> list[str]:
    """The code of that language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def first_plugin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The guide's first plugin as files."""
    folder = tmp_path_factory.mktemp("first")
    (folder / "donor_gain.py").write_text(blocks("python")[0], encoding="utf-8")
    (folder / "pyproject.toml").write_text(blocks("toml")[0], encoding="utf-8")
    return folder


def hook_names() -> list[str]:
    return [name for name, _ in inspect.getmembers(hooks, inspect.isfunction) if name.startswith("register_")]


@pytest.mark.parametrize("hook", hook_names())
def test_every_hook_has_a_row(hook: str) -> None:
    assert re.search(rf"^\| `{hook}` \|", TEXT, flags=re.MULTILINE)


def test_no_hook_is_made_up() -> None:
    assert set(re.findall(r"register_\w+", TEXT)) == set(hook_names())


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(Descriptor)])
def test_every_field_of_a_descriptor_is_told(field: str) -> None:
    assert re.search(rf"\b{field}\b", TEXT)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_protocol_and_method_is_told(protocol: str) -> None:
    assert f"`{protocol}`" in TEXT
    members = [name for name in vars(getattr(contracts, protocol)) if not name.startswith("_")]
    assert members
    assert [name for name in members if not re.search(rf"\b{name}\b", TEXT)] == []


def test_map_type_methods_are_told_with_their_arguments() -> None:
    told = dict(re.findall(r"`(\w+)\(([^`]*)\)`", TEXT[TEXT.index("| method |") : TEXT.index("The laws,")]))
    methods = {name: function for name, function in vars(MapType).items() if inspect.isfunction(function)}
    public = {name: function for name, function in methods.items() if not name.startswith("_")}
    assert set(told) == set(public)
    for name, function in public.items():
        parameters = [parameter for parameter in inspect.signature(function).parameters if parameter != "self"]
        assert not parameters or told[name].split(", ") == parameters


def test_the_first_plugin_is_installed_and_shown_as_told(
    first_plugin: Path,
    pip_install: Callable[[Path], Path],
    mapgraft: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    shown = mapgraft(["plugins", "show", "donor_gain"], [pip_install(first_plugin)])
    assert shown.returncode == 0, shown.stderr
    promised = blocks("console")[0].splitlines()
    assert promised[1] == "$ mapgraft plugins show donor_gain"
    assert shown.stdout.splitlines()[: len(promised) - 2] == promised[2:]


def test_the_first_plugin_measures(first_plugin: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert tomllib.loads(blocks("toml")[0])["project"]["entry-points"]["mapgraft"] == {"donor_gain": "donor_gain"}
    assert len([line for line in blocks("python")[0].splitlines() if line.strip()]) <= 21
    monkeypatch.syspath_prepend(first_plugin)
    plugins = Plugins()
    load_plugin(plugins, importlib.import_module("donor_gain"), Origin("donor_gain", "mapgraft-donor-gain", "0.1.0"))
    metric = typing.cast("Metric", plugins.make("metric", "donor_gain"))
    kind = beacons.Beacons()
    own, donor = kind.decode(b"[[1, 2], [3, 1]]"), kind.decode(b"[[1, 1], [2, 1], [7, 4]]")
    here = Match(Transform.identity(), 2.0, 1.0)
    compared: Comparison = Compared(kind, "own", Transform.identity(), here, donor, lambda: (own, kind.view(own)))
    measured = metric.track(compared).update(Step())
    assert (measured.value, measured.support, measured.sufficient) == (1.5, 2, True)
    nothing: Comparison = Compared(kind, "own", Transform.identity(), here, donor, lambda: (own, kind.view(None)))
    assert not metric.track(nothing).update(Step()).sufficient


def test_the_first_plugin_keeps_the_laws(
    first_plugin: Path,
    pip_install: Callable[[Path], Path],
    mapgraft: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    command = blocks("console")[1].splitlines()[1].removeprefix("$ mapgraft ").split()
    checked = mapgraft([*command, "--json"], [pip_install(first_plugin)])
    assert checked.returncode == 0, checked.stdout
    counts = json.loads(checked.stdout)["counts"]
    assert (counts["kept"], counts["broken"]) == (11, 0)


def test_the_test_of_the_guide_runs(first_plugin: Path) -> None:
    (first_plugin / "test_donor_gain.py").write_text(blocks("python")[1], encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_donor_gain.py"],
        cwd=first_plugin, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert "5 passed, 1 skipped" in done.stdout


def test_the_classes_of_laws_are_told() -> None:
    classes = {name for name in testing.__all__ if name.endswith("Laws") and name != "Laws"}
    assert set(re.findall(r"`(\w+Laws)`", TEXT)) == classes


def test_the_reference_of_the_hooks_is_up_to_date() -> None:
    written = subprocess.run([sys.executable, GUIDE.parent / "write_hooks.py", "--check"], check=False, timeout=120)
    assert written.returncode == 0, "run: python docs/write_hooks.py"


def test_the_life_of_a_map_type_names_every_method() -> None:
    told = TEXT[TEXT.index("## The life of a map type") : TEXT.index("## Units and frames")]
    methods = [name for name, made in vars(MapType).items() if inspect.isfunction(made) and not name.startswith("_")]
    assert [name for name in methods if not re.search(rf"\b{name}\b", told)] == []


def test_the_rule_fits_the_schema_and_names_what_there_is() -> None:
    (text,) = blocks("yaml")
    (rule,) = parse_rules(text, "docs/plugins.md")
    assert set(Rule.model_fields) >= {"match", "accept", "fuse", "verify", "reverse", "when", "via", "priority"}
    standard = load_plugins()
    assert standard.find("acceptor", rule.procedure.accept.use)
    assert standard.find("verifier", rule.procedure.verify.use)
    assert standard.find("matcher", "known_pose")
    assert {offered.descriptor.name for offered in standard.of_kind("policy")} >= {"every", "at"}


def test_every_python_block_is_tested() -> None:
    assert len(blocks("python")) == 2
