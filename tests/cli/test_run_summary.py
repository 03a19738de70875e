"""What run says of every merge at its end: the whole story in two lines, with numbers as persons write them."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from mapgraft.commands.summary import print_summary
from mapgraft.contracts import Transform
from mapgraft.events import Event, Kind
from mapgraft.job import Result

S = 1_000_000_000
STATES = {"merged": "provisional", "confirmed": "confirmed", "reverted": "reverted", "updated": "confirmed"}


def told(capsys: pytest.CaptureFixture[str], *kinds: tuple[Kind, float], by: str = "sequential") -> list[str]:
    """The lines on one merge, to which these things happened at these seconds."""
    events = [
        Event(n, round(at_s * S), kind, "a", "b", "a.b.1", STATES[kind], "the reason", by, T_receiver_donor=_T())
        for n, (kind, at_s) in enumerate(kinds)
    ]
    print_summary(_result(events))
    return capsys.readouterr().out.splitlines()[:2]


def _T() -> Transform:
    return Transform.planar(-0.0001, 1.0, -0.0001)


def _result(events: Sequence[Event]) -> Result:
    return Result("r1", None, events, {}, 0, {}, start_ns=0, lost=())


def test_a_merge_that_was_confirmed_and_reverted_all_the_same_is_told_with_both(capsys) -> None:
    lines = told(capsys, ("merged", 30), ("confirmed", 39.2), ("updated", 60), ("reverted", 90))
    assert lines[1] == "  confirmed at 39.2 s, reverted at 90.0 s: the reason"


def test_when_it_was_confirmed_does_not_move_with_what_comes_after(capsys) -> None:
    assert told(capsys, ("merged", 30), ("confirmed", 39.2), ("updated", 60))[1] == "  confirmed at 39.2 s"
    by = told(capsys, ("merged", 30), ("confirmed", 39.2), by="person ann")[1]
    assert by == "  confirmed at 39.2 s by person ann"


def test_what_nobody_was_sure_of(capsys) -> None:
    assert told(capsys, ("merged", 30), ("reverted", 90))[1] == "  reverted at 90.0 s: the reason"
    assert told(capsys, ("merged", 30))[1] == "  standing, not confirmed yet"


def test_nothing_lies_at_minus_nought(capsys) -> None:
    assert told(capsys, ("merged", 30))[0] == "a.b.1  made at 30.0 s, b at 0.00 m, 1.00 m, 0.0°"
