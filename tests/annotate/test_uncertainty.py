"""How uncertain an outcome counts: from 0, certain, to 1."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.annotate.uncertainty import OPEN, probability, uncertainty

EVIDENCE = pa.list_(pa.struct([("name", pa.string()), ("value", pa.float64())]))


def table(rows: list[dict[str, Any]]) -> pa.Table:
    """Examples; what a row does not say is that of a merge that stands, by one rule and matcher, without evidence."""
    plain = {"rule": "grids", "matcher": "correlation", "verdict": "provisional", "state": "", "score": None}
    columns = {name: pa.array([row.get(name, value) for row in rows]) for name, value in plain.items()}
    columns["score"] = columns["score"].cast(pa.float64())
    told = [[{"name": name, "value": value} for name, value in row.get("evidence", {}).items()] for row in rows]
    return pa.table({**columns, "evidence": pa.array(told, EVIDENCE)})


def by_probability(p: float, **row: Any) -> float:
    return float(uncertainty(table([{"evidence": {"recall": 0.3, "posterior": p}, **row}]))[0])


def test_a_probability_is_most_uncertain_where_it_is_a_coin():
    assert [by_probability(p) for p in (0.0, 0.25, 0.5, 0.9, 1.0)] == pytest.approx([0.0, 0.5, 1.0, 0.2, 0.0])


@pytest.mark.parametrize("row", [{"verdict": "ambiguous"}, {"state": "reverted"}])
def test_where_the_robot_could_not_decide_or_decided_twice(row: dict[str, Any]):
    assert by_probability(1.0, **row) == OPEN
    assert by_probability(0.5, **row) == 1.0


def test_scores_are_ranked_about_where_merging_begins():
    """Of five scores the two highest were merged: what lies next to that boundary is the most uncertain."""
    verdicts = ["unmatched"] * 3 + ["provisional"] * 2
    scores = [0.1, 0.2, 0.3, 5.0, 7_000.0]
    found = uncertainty(table([{"score": s, "verdict": v} for s, v in zip(scores, verdicts, strict=True)]))
    assert found[2] == found[3] == found.max() == 1.0
    assert found[0] < found[1] < found[2] and found[4] < found[3]


def test_rules_with_scores_of_another_scale_are_ranked_each_by_itself():
    rows = [{"score": s, "verdict": v} for s, v in ((0.1, "unmatched"), (0.4, "provisional"), (0.9, "provisional"))]
    other = [{**row, "score": row["score"] * 1e6, "matcher": "carpin"} for row in rows]
    found = uncertainty(table(rows + other))
    assert found[:3].tolist() == found[3:].tolist() == uncertainty(table(rows)).tolist()


def test_without_any_number_an_attempt_is_no_puzzle():
    assert uncertainty(table([{"verdict": "rejected"}, {"score": math.nan}])).tolist() == [0.0, 0.0]


def test_no_examples():
    assert len(uncertainty(table([]))) == 0 and len(probability(table([])["evidence"])) == 0


numbers = st.none() | st.floats()
examples = st.fixed_dictionaries(
    {
        "score": numbers,
        "verdict": st.sampled_from(["rejected", "unmatched", "ambiguous", "provisional"]),
        "state": st.sampled_from(["", "provisional", "confirmed", "reverted"]),
        "rule": st.sampled_from(["one", "two", None]),
        "evidence": st.dictionaries(st.sampled_from(["posterior", "recall"]), numbers),
    }
)


@given(st.lists(examples, max_size=12))
def test_it_is_a_number_between_0_and_1_whatever_the_numbers(rows: list[dict[str, Any]]):
    found = uncertainty(table(rows))
    assert found.shape == (len(rows),)
    assert np.isfinite(found).all() and (found >= 0.0).all() and (found <= 1.0).all()


@given(st.lists(examples, max_size=12), st.randoms(use_true_random=False))
def test_the_order_of_the_rows_does_not_matter_where_scores_differ(rows: list[dict[str, Any]], random: Any):
    scored = [{**row, "score": float(n)} for n, row in enumerate(rows)]
    order = list(range(len(rows)))
    random.shuffle(order)
    assert uncertainty(table([scored[n] for n in order])).tolist() == uncertainty(table(scored))[order].tolist()
