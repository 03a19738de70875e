"""A person's word on a merge or an attempt, kept beside the run whatever becomes of the run."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, get_args

from mapgraft.contracts import Transform
from mapgraft.outputs.parquet_log import write_rows
from mapgraft.outputs.tables import rows_table

Verdict = Literal["right", "wrong", "unsure", "withdrawn"]
NOBODY_NAMED = "person"  # as in the events


def label(
    out: Path,
    run_id: str,
    *,
    merge_id: str,
    receiver: str,
    donor: str,
    verdict: Verdict,
    by: str = "",
    reason: str = "",
    T_receiver_donor: Transform | None = None,
    T_corrected: Transform | None = None,
    elapsed_s: float | None = None,
    clock: datetime | None = None,
) -> str:
    """Append one row to ``labels/`` of an output folder, atomically; returns the part's name, relative to the folder.

    ``merge_id`` is the id of a merge or of an example. ``T_receiver_donor`` is the transform that was judged, with
    which the row means something also when the run is computed again and the id then belongs to another merge;
    ``T_corrected`` is where the person put the donor's map, if it was moved. ``clock`` is when it was said (with a
    time zone; default: now). Rows stay when the run is computed again. The last word of a person holds; ``withdrawn``
    takes back what the person said before.

    Raises OutputError when the folder cannot be written, ValueError for a verdict that is none.
    """
    if verdict not in get_args(Verdict):
        raise ValueError(f"a label is one of {', '.join(get_args(Verdict))}, found {verdict!r}")
    held = T_corrected or (T_receiver_donor if verdict == "right" else None)
    said_at = (clock or datetime.now(UTC)) - datetime(1970, 1, 1, tzinfo=UTC)
    row = {
        "merge_id": merge_id,
        "receiver": receiver,
        "donor": donor,
        "label": verdict,
        "annotator": by or NOBODY_NAMED,
        "T_receiver_donor_judged": None if T_receiver_donor is None else T_receiver_donor.matrix,
        "T_receiver_donor": None if held is None else held.matrix,
        "comment": reason,
        "labelled_at": ((said_at.days * 86_400 + said_at.seconds) * 1_000_000 + said_at.microseconds) * 1_000,
        "elapsed_s": elapsed_s,
    }
    return write_rows(out, "labels", run_id, rows_table("labels", [row]))
