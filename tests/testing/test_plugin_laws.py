"""The laws of whole plugins: ours keep them, and each catches the module that breaks it."""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from pathlib import Path

import pytest

from mapgraft.plugins import GROUP, OWN
from mapgraft.testing import PluginLaws, examine, laws_of

POINTS = importlib.metadata.distribution(OWN).entry_points.select(group=GROUP)
MODULES = (*sorted(point.module for point in POINTS), "beacons")
HEAD = "from mapgraft.contracts import Descriptor, hookimpl\n{contract}"
METRIC = """
@hookimpl
def register_metrics(register):
    register(Descriptor("gain", "{module}_parts:Gain", "{summary}"{more}))
"""
PARTS = "class Gain:\n    def __init__(self, {parameters}): pass\n    def {method}(self, comparison): pass\n"
GOOD = {"summary": "a gain", "more": "", "parameters": "*, least=1.0", "method": "track", "head": "", "tail": ""}
GOOD["contract"] = "MAPGRAFT_CONTRACT = (1, 0)\n"
FAULTS = {
    "listing_imports_none_of_it": {"head": "import {module}_parts\n"},
    "factories_are_there": {"parameters": "*, least"},
    "things_have_their_methods": {"method": "follow"},
    "descriptors_are_complete": {"more": ', extra="more"'},
    "the_contract_is_declared": {"contract": ""},
    "rules_can_be_parsed": {
        "tail": '@hookimpl\ndef register_rules(register):\n    register("odd", "- {{nam: odd}}")\n'
    },
}


def laws_for(name: str) -> PluginLaws:
    made: PluginLaws = type("Laws", (PluginLaws,), {"module": name})()
    return made


@pytest.mark.parametrize("module", MODULES)
@pytest.mark.parametrize("law", list(laws_of(PluginLaws)), ids=lambda law: law.name)
def test_ours_keep_them(module: str, law) -> None:
    outcome = examine(laws_for(module), law)
    assert outcome.status == "kept", outcome.sentence


@pytest.mark.parametrize("broken", [None, *FAULTS])
def test_the_right_law_breaks(broken: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = f"faulty_{broken or 'not'}"
    given = {**GOOD, **FAULTS.get(broken or "", {})}
    text = given["head"] + HEAD + METRIC + given["tail"]
    (tmp_path / f"{module}.py").write_text(text.format(module=module, **given), encoding="utf-8")
    (tmp_path / f"{module}_parts.py").write_text(PARTS.format(**given), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    statuses = {law.name: examine(laws_for(module), law).status for law in laws_of(PluginLaws)}
    for name in (module, f"{module}_parts"):
        sys.modules.pop(name, None)
    assert {name for name, status in statuses.items() if status == "broken"} == ({broken} if broken else set())


@pytest.mark.parametrize("flag", ["uses_prior", "needs_prior"])
def test_what_a_descriptor_says_must_mean_something(flag: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (HEAD + METRIC).format(**{**GOOD, "more": f", {flag}=True", "module": f"odd_{flag}"})
    (tmp_path / f"odd_{flag}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    (complete,) = [law for law in laws_of(PluginLaws) if law.name == "descriptors_are_complete"]
    outcome = examine(laws_for(f"odd_{flag}"), complete)
    assert (outcome.status, outcome.sentence) == (
        "broken", f"the metric gain says {flag}, which means nothing for a metric"
    )  # fmt: skip


def test_every_law_has_its_fault() -> None:
    assert {law.name for law in laws_of(PluginLaws)} == set(FAULTS)
