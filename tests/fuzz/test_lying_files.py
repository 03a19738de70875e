"""Files whose messages are whole and whose indexes lie: all messages are read, or their number is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzz_mcap import WRONG, Chunk, Told, assembled
from fuzz_mcap_seeds import HEAD, scans_at

from mapgraft.recording.containers.mcap_file import McapSource

TIMES_S = (1, 2, 3, 4, 5, 6)


def _read(path: Path, told: Told, compression: str) -> tuple[list[int], list[int], int]:
    chunks = [Chunk(scans_at(times), compression) for times in (TIMES_S[:3], TIMES_S[3:5], TIMES_S[5:])]
    path.write_bytes(assembled([*HEAD, *chunks], told))
    with McapSource(path) as source:
        messages, scans = ([found.log_ns // 10**9 for found in read()] for read in (source.messages, source.scans))
        missing = sum(fault.count for fault in source.faults if fault.cause == "count_differs")
    path.unlink()
    return messages, scans, missing


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
@pytest.mark.parametrize("wrong", [None, *WRONG])
@pytest.mark.parametrize("sealed", [True, False])
def test_everything_is_read_whatever_lies(tmp_path: Path, compression: str, wrong: str | None, sealed: bool):
    lies = frozenset({wrong} if wrong else ())
    assert _read(tmp_path / "a.mcap", Told(crcs=sealed, wrong=lies), compression)[:2] == ([*TIMES_S], [*TIMES_S])
    unindexed = Told(crcs=sealed, message_indexes=False, wrong=lies)
    assert _read(tmp_path / "a.mcap", unindexed, compression)[:2] == ([*TIMES_S], [*TIMES_S])
    unlisted = Told(crcs=sealed, chunk_indexes=False, wrong=lies)
    messages, scans, missing = _read(tmp_path / "a.mcap", unlisted, compression)
    assert messages == [*TIMES_S]
    assert wrong == "count" or len(scans) + missing == len(TIMES_S)
