"""How far a replay is: the share of data time, which is known before the first observation."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

import mapgraft
from mapgraft.commands import progress
from mapgraft.job import as_config
from mapgraft_recordings import demo_files


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What a person at a terminal would see."""
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=120)
    monkeypatch.setattr(progress, "remarks", lambda: console)
    return screen


def test_the_span_is_told_before_anything_is_replayed():
    seen: list[tuple[int, int]] = []
    files, config, _ = demo_files()
    settings = {**as_config(config).model_dump(mode="json"), "mission": {"start_s": 5.0, "end_s": 12.0}}
    result = mapgraft.run(files, settings, opened=lambda *span: seen.append(span))
    assert seen == [(result.start_ns + 5_000_000_000, result.start_ns + 12_000_000_000)]


def test_the_bar_shows_share_rate_and_merges(terminal):
    files, config, _ = demo_files()
    with progress.ProgressSink(quiet=False) as bar:
        mapgraft.run(files, config, sinks=[bar], opened=bar.spans)
    shown = terminal.getvalue()
    for part in ("starting (kernels compile on first use)", "replaying", "scans, ", "100%", "8 merged, 2 reverted"):
        assert part in shown


def test_a_quiet_bar_says_nothing(terminal):
    with progress.ProgressSink(quiet=True) as bar:
        bar.spans(0, 10)
    assert terminal.getvalue() == ""


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What stands in a file that stderr goes to."""
    written = io.StringIO()
    monkeypatch.setattr(progress, "remarks", lambda: Console(file=written, width=40))
    return written


def test_where_no_terminal_is_one_line_says_what_has_begun(log):
    with progress.ProgressSink(quiet=False) as bar:
        assert log.getvalue() == ""  # whoever is refused hears of nothing else
        bar.spans(0, 12_000_000_000)
    assert log.getvalue() == f"mapgraft: replaying 12.0 s ({progress.COMPILING})\n"


def test_what_is_counted_says_once_how_many_there_are(log):
    with progress.counting("pairs (kernels compile on first use)", "pairs", quiet=False) as count:
        for done in range(3):
            count(done, 2_000)
    assert log.getvalue() == f"mapgraft: 2,000 pairs to do ({progress.COMPILING})\n"


def test_a_log_that_wants_quiet_stays_empty(log):
    with progress.ProgressSink(quiet=True) as bar, progress.counting("", "pairs", quiet=True) as count:
        bar.spans(0, 12_000_000_000)
        count(0, 2)
    assert log.getvalue() == ""
