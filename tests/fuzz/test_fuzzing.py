"""A short run of every harness: sound inputs, damaged ones, and arbitrary bytes raise sentences and nothing else.

``python tests/fuzz/run.py HARNESS --executions N`` is the long one.
"""

from __future__ import annotations

import random

import fuzz_mcap
import pytest
from fuzz_mutations import mutated
from fuzz_stock import SEEDS
from fuzz_targets import HARNESSES, Harness, Run, bounded
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

EXAMPLES = {
    "mcap": 300,
    "bag": 250,
    "db3": 250,
    "carmen": 250,
    "cdr": 400,
    "config": 250,
    "decision": 150,
    "layer": 300,
    "message": 300,
    "network": 300,
}
SHORT = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}


@pytest.fixture(autouse=True)
def _yaml_as_usual(monkeypatch: pytest.MonkeyPatch) -> None:
    """What harnesses change of the YAML library for speed is undone behind them."""
    monkeypatch.setattr(YAML, "official_plug_ins", YAML.official_plug_ins)


def test_every_harness_has_seeds_and_examples():
    assert set(HARNESSES) == set(SEEDS) == set(EXAMPLES)


@pytest.mark.parametrize("name", sorted(HARNESSES))
def test_strangers_bytes_raise_sentences_only(name: str):
    harness = HARNESSES[name]
    sound = [data[: harness.max_bytes] for data in SEEDS[name]()]
    with bounded(harness):
        run = harness.build()
        for data in sound:
            run(data)
        _damaged(run, sound, EXAMPLES[name], harness)
        _arbitrary(run, EXAMPLES[name] // 2)


def _damaged(run: Run, sound: list[bytes], examples: int, harness: Harness) -> None:
    @seed(1)
    @settings(max_examples=examples, **SHORT)
    @given(chance=st.integers(0, 2**32))
    def check(chance: int) -> None:
        run(mutated(sound, random.Random(chance), harness.damage)[: harness.max_bytes])

    check()


def _arbitrary(run: Run, examples: int) -> None:
    @seed(2)
    @settings(max_examples=examples, **SHORT)
    @given(data=st.binary(max_size=400))
    def check(data: bytes) -> None:
        run(data)

    check()


def test_what_is_taken_apart_and_put_together_is_the_same_file():
    for data in SEEDS["mcap"]():
        items = fuzz_mcap.taken_apart(data[1:])
        assert fuzz_mcap.taken_apart(fuzz_mcap.assembled(items)) == items
