"""A short run of every harness: sound inputs, damaged ones, and arbitrary bytes raise sentences and nothing else.

``python tests/fuzz/run.py HARNESS --executions N`` is the long one.
"""

from __future__ import annotations

import random

import pytest
from fuzz_mutations import mutated
from fuzz_seeds import SEEDS
from fuzz_targets import HARNESSES, Run
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

EXAMPLES = {"mcap": 250, "carmen": 250, "cdr": 400, "config": 250, "decision": 120, "layer": 200}
SHORT = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}


def test_every_harness_has_seeds_and_examples():
    assert set(HARNESSES) == set(SEEDS) == set(EXAMPLES)


@pytest.mark.parametrize("name", sorted(HARNESSES))
def test_strangers_bytes_raise_sentences_only(name: str):
    run, sound = HARNESSES[name].build(), SEEDS[name]()
    for data in sound:
        run(data)
    _damaged(run, sound, EXAMPLES[name], HARNESSES[name].max_bytes)
    _arbitrary(run, EXAMPLES[name] // 2)


def _damaged(run: Run, sound: list[bytes], examples: int, max_bytes: int) -> None:
    @seed(1)
    @settings(max_examples=examples, **SHORT)
    @given(chance=st.integers(0, 2**32))
    def check(chance: int) -> None:
        run(mutated(sound, random.Random(chance))[:max_bytes])

    check()


def _arbitrary(run: Run, examples: int) -> None:
    @seed(2)
    @settings(max_examples=examples, **SHORT)
    @given(data=st.binary(max_size=400))
    def check(data: bytes) -> None:
        run(data)

    check()
