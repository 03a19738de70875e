"""Trajectories in TUM format."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from mapgraft.errors import RecordingError
from mapgraft.recording.containers.tum_file import TumSource

LINES = """\
# stamp x y z qx qy qz qw
1663967375.548411329 1.5 2 0 0 0 0 1
1663967376.5 1.75 2 0 0 0 0.5 0.5

1663967376.25, 9, 9, 0, 0, 0, 0, 1
nonsense
1663967377 1 2 3
1663967378 nan 2 0 0 0 0 1
"""


def test_poses(tmp_path: Path) -> None:
    path = tmp_path / "run.tum"
    path.write_text(LINES)
    with TumSource(path) as source:
        assert [(c.topic, c.message_type, c.count) for c in source.channels] == [("trajectory", "tum/msg/Pose", 4)]
        messages = list(source.messages())
        poses = [source.decode(message) for message in messages]
        assert poses[0].stamp_ns == 1663967375_548411329  # exactly, although no float holds it
        assert poses[1].xyzw == (0.0, 0.0, 0.5, 0.5)
        assert [pose.valid for pose in poses] == [True, True, True, False]
        assert [m.log_ns - messages[0].log_ns for m in messages] == [0, 951588671, 951588671, 2451588671]
        assert (source.start_ns, source.end_ns) == (1663967375548411329, 1663967378000000000)
        assert {fault.cause: fault.count for fault in source.faults} == {"line_unreadable": 2, "lines_out_of_order": 1}
        window = source.messages(["trajectory"], 1663967376 * 10**9, 1663967377 * 10**9)
        assert [source.decode(m).xyz_m[0] for m in window] == [1.75, 9.0]
        assert list(source.messages(["other"])) == [] == list(source.scans())
        with pytest.raises(RecordingError, match="holds no scans"):
            source.decode_scan(messages[0])


def test_packed_and_empty(tmp_path: Path) -> None:
    packed = tmp_path / "run.tum.gz"
    packed.write_bytes(gzip.compress(LINES.encode()))
    assert len(list(TumSource(packed).messages())) == 4
    empty = tmp_path / "none.tum"
    empty.write_text("# only a comment\n")
    with pytest.raises(RecordingError, match="holds no pose"):
        TumSource(empty)
