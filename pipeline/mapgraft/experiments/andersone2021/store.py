"""The experiment's merges as Parquet tables, in the schemas of ``mapgraft_schemas``."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence

import pyarrow as pa
import pyarrow.parquet as pq

from mapgraft.evaluation.drawing import Window
from mapgraft.experiments.andersone2021.outcome import Experiment, Kept, Merge
from mapgraft.outputs.tables import Row, rows_table


def parquet_files(experiment: Experiment) -> dict[str, bytes]:
    """``merges.parquet``, ``evidence.parquet``, ``verdicts.parquet`` and ``times.parquet``: file name → content.

    All but the last are the same for the same recording and settings.
    """
    merges = sorted(experiment.merges, key=lambda merge: (merge.combination.name, merge.number))
    rows: Mapping[str, Sequence[Row]] = {
        "merges": [_merge_row(merge, kept) for merge in merges for kept in _in_order(merge)],
        "evidence": sorted(
            (row for merge in merges for row in _evidence_rows(merge)),
            key=lambda row: (row["merge"], row["strategy"], row["moment"], row["name"]),
        ),
        "verdicts": sorted((_verdict_row(merge) for merge in merges), key=lambda row: str(row["merge"])),
        "times": sorted(
            (_time_row(merge, kept) for merge in merges for kept in _in_order(merge)),
            key=lambda row: (row["merge"], row["strategy"]),
        ),
    }
    return {f"{name}.parquet": _file(rows_table(f"experiment_{name}", made)) for name, made in rows.items()}


def _in_order(merge: Merge) -> Iterator[Kept]:
    return (merge.by[strategy] for strategy in sorted(merge.by))


def _merge_row(merge: Merge, kept: Kept) -> Row:
    exactness, left = kept.exactness, kept.leftovers
    return {
        "merge": merge.name,
        "combination": merge.combination.name,
        "own_resolution_m": merge.combination.own_m,
        "other_resolution_m": merge.combination.other_m,
        "draw": merge.number,
        "recording": merge.plan.receiver.course.recording,
        **_window("receiver", merge.plan.receiver),
        **_window("donor", merge.plan.donor),
        "right": merge.right,
        "overlap": merge.overlap,
        "error_m": merge.error_m,
        "error_deg": merge.error_deg,
        "x_m": merge.T_receiver_donor.x_m,
        "y_m": merge.T_receiver_donor.y_m,
        "yaw_rad": merge.T_receiver_donor.yaw_rad,
        "score": merge.score,
        "strategy": kept.strategy,
        "initial_similarity": kept.initial["similarity"],
        "end_similarity": kept.end["similarity"],
        "initial_distance": kept.initial["distance"],
        "end_distance": kept.end["distance"],
        "exact": exactness.exact,
        "cells_reset": exactness.cells_reset,
        "cells_contaminated": exactness.cells_contaminated,
        "cells_lost": exactness.cells_lost,
        "known": left.known,
        "lost": left.lost,
        "alien": left.alien,
        "changed": left.changed,
        "touched": left.touched,
        "identical": left.identical,
    }


def _window(side: str, window: Window) -> Row:
    return {f"{side}_robot": window.course.robot, f"{side}_first": window.first}


def _evidence_rows(merge: Merge) -> Iterator[dict[str, str | float]]:
    seen = {"rules": (merge.watched.initial, merge.watched.end)}
    seen |= {strategy: (kept.initial, kept.end) for strategy, kept in merge.by.items()}
    for strategy, moments in seen.items():
        for moment, numbers in zip(("initial", "end"), moments, strict=True):
            for name, value in numbers.items():
                yield {"merge": merge.name, "strategy": strategy, "moment": moment, "name": name, "value": value}


def _verdict_row(merge: Merge) -> Row:
    watched = merge.watched
    return {"merge": merge.name, "rule": watched.rule, "action": watched.action, "reason": watched.reason}


def _time_row(merge: Merge, kept: Kept) -> dict[str, str | float]:
    cost = kept.cost
    return {
        "merge": merge.name,
        "strategy": kept.strategy,
        "update_s": cost.update_s,
        "view_s": cost.view_s,
        "compared_s": cost.compared_s,
        "revert_s": kept.revert_s,
    }


def _file(table: pa.Table) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(table, buffer, version="2.6", compression="zstd", compression_level=3)
    return buffer.getvalue()
