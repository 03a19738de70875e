"""``mapgraft plugins check`` and ``new``, as a stranger uses them."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., subprocess.CompletedProcess[str]]
Place = Callable[..., Path]

NAME = "echo_cells"
METRIC = """
from mapgraft.contracts import Descriptor, Measurement, hookimpl

MAPGRAFT_CONTRACT = (1, 0)

class Gain:
    def track(self, comparison):
        return Tracker(comparison)

class Tracker:
    def __init__(self, comparison):
        self.comparison = comparison
        self.kept = None

    def update(self, step):
        own, donor = self.comparison.target.known(), self.comparison.donor.known()
        self.kept = {kept}Measurement("{name}", donor / own, "share", own, "higher")
        return self.kept

@hookimpl
def register_metrics(register):
    register(Descriptor("{name}", "{name}:Gain", "a gain"{more}))
"""
UNDRIVEN = """
from mapgraft.contracts import Descriptor, hookimpl

@hookimpl
def register_map_types(register):
    register(Descriptor("odours", "undriven:Odours", "what was smelt", observes={"smell": 1}))

@hookimpl
def register_matchers(register):
    register(Descriptor("sniff", "undriven:Sniff", "sniffs", accepts=("odours",)))
    register(Descriptor("snort", "undriven:Snort", "snorts", requires=("no_such_nose",), extra="nose"))
"""


@pytest.fixture(scope="module")
def package(mapgraft: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``plugins new`` writes."""
    folder = tmp_path_factory.mktemp("new") / "package"
    done = mapgraft(["plugins", "new", NAME, "--out", str(folder)])
    assert done.returncode == 0, done.stderr
    assert "pytest" in done.stdout
    return folder


@pytest.fixture(scope="module")
def installed_package(package: Path, pip_install: Place) -> Path:
    return pip_install(package)


def test_a_new_package_keeps_the_laws_as_it_stands(package: Path, installed_package: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error"],
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(installed_package)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:]
    assert " failed" not in done.stdout


def test_a_new_package_is_found_and_checked(installed_package: Path, mapgraft: Run) -> None:
    listed = json.loads(mapgraft(["plugins", "list", "--json"], [installed_package]).stdout)
    assert listed["broken"] == []
    assert {f"{NAME}", f"{NAME}_sum", f"{NAME}_shared"} <= {offered["name"] for offered in listed["offered"]}
    done = mapgraft(["plugins", "check", NAME, "--examples", "2", "--json"], [installed_package])
    assert done.returncode == 0, done.stdout
    said = json.loads(done.stdout)
    assert said["counts"]["broken"] == 0
    assert said["counts"]["kept"] > 45
    assert {row["thing"].split(",")[0] for row in said["outcomes"]} == {
        f"plugin {NAME}",
        f"map type {NAME}",
        f"fuser {NAME}_sum",
        f"metric {NAME}_shared",
    }


def test_nothing_is_overwritten(package: Path, mapgraft: Run) -> None:
    before = {path: path.read_bytes() for path in package.rglob("*") if path.is_file()}
    done = mapgraft(["plugins", "new", NAME, "--out", str(package)])
    assert done.returncode == 1
    assert done.stderr == (
        f"mapgraft: {package} is there already, and nothing is overwritten: choose another folder with --out\n"
    )
    assert {path: path.read_bytes() for path in package.rglob("*") if path.is_file() and path in before} == before


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("My-Maps", "found 'My-Maps': how about 'my_maps'?"),
        ("class", "no word of Python's, found 'class'"),
        ("2d", "found '2d'"),
        ("", "found ''"),
        ("../x", "found '../x': how about 'x'?"),
        ("occupancy_grid", "the name 'occupancy_grid' is taken"),
        ("correlation", "the name 'correlation' is taken"),
    ],
)
def test_a_bad_name_is_one_sentence(name: str, sentence: str, mapgraft: Run, tmp_path: Path) -> None:
    done = mapgraft(["plugins", "new", name, "--out", str(tmp_path / "x")])
    assert done.returncode == 2
    assert sentence in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_a_broken_law_is_told_with_its_counterexample(lay_out: Place, mapgraft: Run) -> None:
    text = METRIC.format(kept="self.kept or ", name="stale_gain", more="")
    done = mapgraft(["plugins", "check", "stale_gain", "--examples", "3"], [lay_out("stale_gain", text)])
    assert done.returncode == 1, done.stderr
    assert "broken           an updated tracker equals a fresh measurement" in done.stdout
    assert re.search(r"an_updated_tracker_equals_a_fresh_one: after \d observation\(s\) it measures", done.stdout)
    assert "[scene a room of" in done.stdout
    assert "kept             a measurement is what it says" in done.stdout
    assert done.stdout.splitlines()[-1] == "9 kept, 2 broken, 1 not tried"  # nor does it see a changed donor


def test_only_who_says_so_counts_what_observations_say(lay_out: Place, mapgraft: Run) -> None:
    """Whoever measures once and returns that for ever passes for nothing."""
    text = METRIC.format(kept="self.kept or ", name="deaf_gain", more=", stream=True")
    text = text.replace("self.kept = None", "self.kept = None\n        self.update(None)")
    done = mapgraft(["plugins", "check", "deaf_gain", "--examples", "3", "--json"], [lay_out("deaf_gain", text)])
    said = {row["law"]: (row["status"], row["why"]) for row in json.loads(done.stdout)["outcomes"]}
    untold = ("not tried", "in none of the scenes an observation made any difference to what it measures")
    assert said["an_updated_tracker_equals_a_fresh_one"] == untold
    status, why = said["a_changed_donor_is_measured"]
    assert status == "broken" and "registered anew it measures" in why


def test_a_good_metric_passes(lay_out: Place, mapgraft: Run) -> None:
    folder = lay_out("good_gain", METRIC.format(kept="", name="good_gain", more=""))
    done = mapgraft(["plugins", "check", "good_gain", "--examples", "2", "--json"], [folder])
    assert done.returncode == 0, done.stdout
    said = json.loads(done.stdout)
    assert said["counts"] == {"kept": 11, "broken": 0, "kept unexpectedly": 0, "expected failure": 0, "not tried": 1}
    (untried,) = [row for row in said["outcomes"] if row["status"] == "not tried"]
    assert untried["law"] == "concerns_are_honest" and untried["why"] == "its trackers are not local"


def test_what_cannot_be_tried_says_why(lay_out: Place, mapgraft: Run) -> None:
    done = mapgraft(["plugins", "check", "undriven", "--json"], [lay_out("undriven", UNDRIVEN)])
    said = {row["thing"]: row["why"] for row in json.loads(done.stdout)["outcomes"] if row["status"] == "not tried"}
    assert "odours observes smell" in said["map type odours"]
    assert "(Descriptor.laws)" in said["matcher sniff"]
    assert said["matcher snort"] == "needs no_such_nose: pip install 'mapgraft-undriven[nose]'"
    assert done.returncode == 1  # its factories are not there


def test_an_unknown_name_is_one_sentence(mapgraft: Run) -> None:
    done = mapgraft(["plugins", "check", "nobody"])
    assert done.returncode == 1
    assert "nothing installed is called 'nobody'" in done.stderr
    assert done.stderr.count("\n") == 1


def test_without_hypothesis_it_says_what_to_install(mapgraft: Run, tmp_path: Path) -> None:
    hidden = tmp_path / "hypothesis"
    hidden.mkdir()
    (hidden / "__init__.py").write_text("raise ModuleNotFoundError('hypothesis')\n")
    done = mapgraft(["plugins", "check", "standard"], [tmp_path])
    assert done.returncode == 1
    assert done.stderr == (
        "mapgraft: the conformance kit needs hypothesis and pytest: pip install 'mapgraft[testing]'\n"
    )
