"""Which transform a person's word on a merge goes with, and which one is labelled, when the merge was moved since."""

from __future__ import annotations

from pathlib import Path

from mapgraft.commands.hand import _transforms
from mapgraft.contracts import Transform
from mapgraft.events import Event
from mapgraft.outputs.parquet_log import write_rows
from mapgraft.outputs.tables import events_table

MADE, MOVED, ELSEWHERE = (Transform.planar(x, 0.0, 0.1) for x in (1.0, 1.2, 9.0))


def test_a_verdict_goes_with_where_a_merge_was_made_and_a_label_with_where_it_is_now(tmp_path: Path) -> None:
    told = [
        ("merged", "a.b.1", "provisional", MADE),
        ("verified", "a.b.1", "provisional", MADE),
        ("merged", "a.c.1", "provisional", ELSEWHERE),
        ("updated", "a.b.1", "provisional", MOVED),
        ("confirmed", "a.b.1", "confirmed", MOVED),
        ("reverted", "a.c.1", "reverted", ELSEWHERE),
    ]
    events = [
        Event(n, n, kind, "a", merge_id[2], merge_id=merge_id, state=state, T_receiver_donor=T)
        for n, (kind, merge_id, state, T) in enumerate(told)
    ]
    write_rows(tmp_path, "events", "r0123456789abcdef", events_table(events))
    expected = [T.matrix.ravel().tolist() for T in (MADE, MOVED)]
    assert list(_transforms(tmp_path, "a.b.1")) == expected
    assert list(_transforms(tmp_path, "a.c.1")) == [ELSEWHERE.matrix.ravel().tolist()] * 2
