"""Made-up examples: scores of buildings that are alike or not, in memory and as the tables that others write."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mapgraft.calibrate import Labelled
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Look
from mapgraft.decision import Rule, build_table
from mapgraft.plugins import load_plugins
from mapgraft_schemas.tables import arrow_schema, table

RULE = "grids of any resolution"
Make = Callable[..., list[Labelled]]
WriteFolder = Callable[..., Path]


def _group(own_m: float = 0.07, other_m: float = 0.07) -> Group:
    return Group(RULE, "occupancy_grid", "occupancy_grid", "ledger", own_m, other_m, resolutions=True)


@pytest.fixture(scope="session")
def group() -> Callable[..., Group]:
    """A group of grids, by the resolutions of receiver and donor."""
    return _group


def _looks(rng: np.random.Generator, right: bool, start: float) -> list[Look]:
    """A test that goes down for right merges and up for wrong ones."""
    wrong, agreed, looks = start, 0.0, []
    for number in range(5):
        numbers = {"verifier.log_odds_wrong": wrong, "news.agreed": agreed, "news.against": 0.5}
        looks.append(Look(10 * number, numbers | {"news.agreed_m": 0.5 * agreed, "posterior": 0.99}))
        agreed += 4.0
        wrong += float(rng.normal(-2.0 if right else 2.0, 1.0))
    return looks


@pytest.fixture(scope="session")
def made() -> Make:
    """Examples of one building: right ones score normally about 4, wrong ones about ``wrong_at``."""

    def make(
        building: str,
        count: int,
        seed: int,
        *,
        wrong_at: float = 0.0,
        share: float = 0.3,
        of: Group | None = None,
        watched: bool = False,
    ) -> list[Labelled]:
        rng = np.random.default_rng([seed, count])
        out = []
        for number in range(count):
            right = bool(rng.random() < share)
            score = float(rng.normal(4.0 if right else wrong_at, 1.0))
            numbers = {
                "posterior": 1.0 / (1.0 + np.exp(-score)),
                "posterior.log_odds": score,
                "score": 100.0 * np.exp(0.3 * score + rng.normal()),
                "kappa": float(np.tanh(0.2 * score + 0.3 * rng.normal())),
                "noise": float(rng.normal()),
                "paths": 0.0,
            }
            example = Labelled(
                unit=(building, str(number)),
                environment=building,
                group=of or _group(),
                matcher="correlation",
                numbers=numbers,
                right=right,
                by="truth",
                looks=_looks(rng, right, -score) if watched else (),
                right_later=right if watched else None,
                quality=float(rng.uniform(0.3, 0.9)),
                overlap=float(rng.uniform(0.0, 1.0)),
            )
            out.append(example)
        return out

    return make


@pytest.fixture(scope="session")
def installed() -> list[Rule]:
    """The rules of the installed decision table."""
    return [record.rule for record in build_table(load_plugins()).records]


@pytest.fixture
def write_folder(tmp_path: Path) -> WriteFolder:
    """Writes examples as an evaluation or a run does, or as a dataset that is published."""

    def write(
        name: str,
        examples: Sequence[Labelled],
        *,
        words: Sequence[Mapping[str, str]] = (),
        split: str = "",
        truth: bool = True,
        rows: Callable[[dict[str, Any]], dict[str, Any]] = lambda row: row,
    ) -> Path:
        kind = "dataset" if split else "examples"
        schema = arrow_schema(kind)
        filled = []
        for number, example in enumerate(examples):
            row = {column.name: _nothing(column.type) for column in table(kind).columns}
            row |= _row(number, example, truth)
            if split:
                row |= {"run_id": f"run-{name}", "labels": _words(words[number] if words else {})}
            filled.append(rows(row))
        folder = tmp_path / name / "examples" / (f"split={split}" if split else f"run_id=run-{name}")
        folder.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.Table.from_pylist(filled, schema=schema), folder / "part-00000-00000000.parquet")
        return tmp_path / name

    return write


def _nothing(kind: str) -> Any:
    if kind.startswith("fixed_size_list"):
        return [float("nan")] * int(kind.rpartition("[")[2].rstrip("]"))
    return [] if kind.startswith("list") else None


def _row(number: int, example: Labelled, truth: bool) -> dict[str, Any]:
    told = {True: "right", False: "wrong", None: None}
    at = example.group
    return {
        "position": number,
        "example_id": f"{number}.judged",
        "environment": example.environment,
        "recording": example.environment,
        "receiver": "receiver",
        "donor": "donor",
        "receiver_type": at.receiver_type,
        "donor_type": at.donor_type,
        "receiver_resolution_m": at.own_m,
        "donor_resolution_m": at.other_m,
        "receiver_quality": example.quality,
        "donor_quality": 0.95,
        "reversal": at.reversal,
        "rule": at.rule,
        "matcher": example.matcher,
        "verdict": "provisional",
        "state": "provisional",
        "chosen": 0,
        "evidence": [{"name": name, "value": value} for name, value in example.numbers.items()],
        "history": [
            {"stamp": look.observations, "observations": look.observations, "metric": n, "value": v, "support": 1}
            for look in example.looks
            for n, v in look.numbers.items()
        ],
        "truth": told[example.right] if truth else None,
        "truth_final": told[example.right_later] if truth else None,
        "truth_overlap": example.overlap,
    }


def _words(said: Mapping[str, str]) -> list[dict[str, Any]]:
    nothing = {"reason": "", "labelled_at": 0, "elapsed_s": None, "x_m": None, "y_m": None, "yaw_rad": None}
    fields = {field.name for field in arrow_schema("dataset").field("labels").type.value_type}
    words = [{"annotator": name, "label": label, **nothing} for name, label in said.items()]
    return [{key: value for key, value in word.items() if key in fields} for word in words]
