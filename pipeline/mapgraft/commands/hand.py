"""``mapgraft revert``, ``confirm``, ``forbid``: a person's word on an earlier run, and the run made again with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import numpy as np

from mapgraft.commands.overrides import parse_pair
from mapgraft.commands.run import run_with_progress
from mapgraft.commands.summary import as_json_summary, print_summary
from mapgraft.config import Config, VerdictConfig
from mapgraft.console import print_json
from mapgraft.contracts import Transform
from mapgraft.decision import build_table
from mapgraft.errors import UsageError
from mapgraft.events import STANDING
from mapgraft.job import identify
from mapgraft.outputs.labels import label
from mapgraft.plugins import load_plugins
from mapgraft.remember import Remembered, recall


def pass_verdict(
    out: Path, merge_id: str, action: Literal["revert", "confirm"], by: str, reason: str, *, as_json: bool
) -> None:
    """Add a verdict to what the run remembers, and run again; raises UsageError when there is no such merge."""
    remembered = recall(out)
    receiver, donor = _check_merge(out, merge_id)
    made, seen = _transforms(out, merge_id)
    verdict = VerdictConfig(merge=merge_id, action=action, by=by, reason=reason, T_receiver_donor=made)
    others = [known for known in remembered.config.verdicts if known.T_receiver_donor != made]
    config = remembered.config.model_copy(update={"verdicts": [*others, verdict]})
    run_id = _again(out, remembered, config, as_json=as_json)
    label(
        out,
        run_id,
        merge_id=merge_id,
        receiver=receiver,
        donor=donor,
        verdict="wrong" if action == "revert" else "right",
        by=by,
        reason=reason,
        T_receiver_donor=Transform.from_matrix(np.reshape(seen, (4, 4))),
    )


def forbid_pair(out: Path, merge: str, *, as_json: bool) -> None:
    """Forbid the two robots of a merge, or a pair ``A,B``, and run again."""
    remembered = recall(out)
    pair = parse_pair("forbid", merge) if "," in merge else _check_merge(out, merge)
    forbidden = [*remembered.config.forbid, pair]
    _again(out, remembered, remembered.config.model_copy(update={"forbid": forbidden}), as_json=as_json)


def _check_merge(out: Path, merge_id: str) -> tuple[str, str]:
    """The receiver and donor of a merge that the run made."""
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    merges = {merge["merge_id"]: merge for merge in summary["merges"]}
    if merge_id not in merges:
        raise UsageError(f"{out} has no merge {merge_id!r}: it made {', '.join(merges) or 'none'}")
    return str(merges[merge_id]["receiver"]), str(merges[merge_id]["donor"])


def _transforms(out: Path, merge_id: str) -> tuple[list[float], list[float]]:
    """The transform at which a merge was made, and the one at which it was last, (16,) row-major each.

    A verdict goes with the first, because that is what comes up again when the run is made again; what the person
    sees and labels is the last: as the maps grow a merge is registered anew.
    """
    import pyarrow.compute as pc
    import pyarrow.dataset as ds

    wanted = (pc.field("merge_id") == merge_id) & pc.field("kind").isin(STANDING)
    table = ds.dataset(out / "events", partitioning="hive").to_table(["seq", "T_receiver_donor"], filter=wanted)
    rows = sorted(zip(table["seq"].to_pylist(), table["T_receiver_donor"].to_pylist(), strict=True))
    first, last = rows[0][1], rows[-1][1]
    return [float(number) for number in first], [float(number) for number in last]


def _again(out: Path, remembered: Remembered, config: Config, *, as_json: bool) -> str:
    """Run again and show what came of it; returns the run's id.

    Raises UsageError when the run would no longer be the same one: a person judged what they saw.
    """
    plugins = load_plugins()
    _, run_id = identify(remembered.files, config, plugins, build_table(plugins, config.rules))
    earlier = json.loads((out / "summary.json").read_text(encoding="utf-8"))["run_id"]
    if run_id != earlier:
        raise UsageError(
            f"the recordings, the configuration's files, mapgraft or its plugins have changed since {out} was made: "
            "run again into a new folder and judge that"
        )
    result = run_with_progress(remembered.files, config, out, plugins, quiet=as_json)
    if as_json:
        print_json(as_json_summary(result))
    else:
        print_summary(result)
    return result.run_id
