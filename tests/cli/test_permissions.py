"""Files and folders that are closed to whoever asks for them: one sentence, and the exit code of the command."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from mapgraft.cli import invoke
from mapgraft_recordings import demo_files

_LINUX_CAPABILITY_VERSION_3 = 0x20080522
_PASSING_MODES = 1 << 1 | 1 << 2  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH: by these root passes by what modes say


@pytest.fixture
def closed(tmp_path: Path) -> Iterator[Path]:
    """A folder that may not be entered, with a recording in it; also for root, whom modes hold meanwhile."""
    libc, header = ctypes.CDLL(None, use_errno=True), (ctypes.c_uint32 * 2)(_LINUX_CAPABILITY_VERSION_3, 0)
    sets = (ctypes.c_uint32 * 6)()  # twice: effective, permitted, inheritable
    assert libc.capget(header, sets) == 0
    effective = sets[0]
    folder = tmp_path / "closed"
    folder.mkdir()
    shutil.copy(demo_files()[0][0], folder / "a.mcap")
    folder.chmod(0)
    sets[0] = effective & ~_PASSING_MODES
    assert libc.capset(header, sets) == 0
    yield folder
    sets[0] = effective
    assert libc.capset(header, sets) == 0
    folder.chmod(0o755)


def _said(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    code = invoke([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("mapgraft: ") and err.count("\n") == 1
    return code, err


@pytest.mark.parametrize("command", [["info"], ["run", "-o", "out"], ["convert"], ["evaluate"]])
def test_a_recording_that_may_not_be_read_is_named(closed, tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    shutil.copy(demo_files()[0][0], "b.mcap")
    Path("b.mcap").chmod(0)
    last = ["x.mcap"] if command == ["convert"] else []
    for path in (closed / "a.mcap", closed, Path("b.mcap")):
        code, sentence = _said(capsys, *command, path, *last)
        assert code == 1
        assert f"{path} may not be read by this user: check the permissions of it and of its folders" in sentence


def test_beside_others_it_is_left_out_and_told(closed, capsys):
    assert invoke(["info", str(closed / "a.mcap"), str(demo_files()[0][1])]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "a.mcap may not be read by this user: check the permissions of it and of its folders: it is left out" in out


def test_maps_and_files_that_only_the_configuration_names(closed, tmp_path, capsys):
    code, sentence = _said(capsys, "match", closed / "a.yaml", closed / "b.yaml")
    assert code == 1 and "a.yaml may not be read by this user" in sentence
    config = tmp_path / "c.yaml"
    config.write_text(f"robots: {{a: {{files: ['{closed}/a.mcap']}}}}")
    code, sentence = _said(capsys, "info", "-c", config, demo_files()[0][1])
    assert code == 1 and "a.mcap may not be read by this user" in sentence


@pytest.mark.parametrize("command", [["report"], ["revert"], ["plugins", "new", "foo", "-o"]])
def test_what_else_is_asked_of_a_closed_folder_is_no_internal_error(closed, capsys, command):
    last = ["a.b.1"] if command == ["revert"] else []
    code, sentence = _said(capsys, *command, closed / "out", *last)
    assert code in (1, 2)
    assert "this user" in sentence and "internal error" not in sentence
