"""Disks that are really full: a small one in memory is mounted, where the machine lets us."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from mapgraft.cli import invoke
from mapgraft.errors import OutputError
from mapgraft.outputs.labels import label
from mapgraft.outputs.read_back import read_events
from mapgraft_recordings import demo_files

ROOMY_KB = 16_384


class Disk:
    """A disk of a size that can be changed while it is mounted."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def mount(self, *options: str) -> str:
        """What the machine says against it; empty where it is mounted."""
        command = ["mount", "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(self.path)]
        try:
            done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
        except OSError as error:
            return str(error)
        return "" if done.returncode == 0 else done.stderr.strip() or "mount failed"

    def resize(self, size_kb: int) -> None:
        assert self.mount("remount", f"size={size_kb}k") == ""

    def fill(self) -> None:
        """Leave no byte."""
        with (self.path / "filler").open("wb", buffering=0) as filler:
            try:
                while True:
                    filler.write(bytes(4096))
            except OSError:
                pass

    def names(self) -> set[str]:
        return {path.name for path in self.path.rglob("*") if path.is_file()} - {"filler", ".mapgraft.lock"}


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    made = Disk(tmp_path / "disk")
    made.path.mkdir()
    if refused := made.mount(f"size={ROOMY_KB}k"):
        pytest.skip(f"this machine lets nobody mount a disk in memory: {refused}")
    yield made
    subprocess.run(["umount", "-l", str(made.path)], check=True, timeout=60)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The sentence of a command that must fail."""
    assert invoke([*map(str, arguments)]) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


@pytest.mark.parametrize("size_kb", [40, 180])
def test_a_run_is_told_so_keeps_what_was_decided_and_goes_well_when_there_is_room(disk, capsys, size_kb):
    out, files = disk.path / "out", demo_files()[0][:2]
    command = ["run", "-q", "-o", out, "--end", "40", *files]
    disk.resize(size_kb)
    said = refused(capsys, *command)
    assert "cannot be written because the disk or the quota is full: make room and run again" in said
    assert all(name.endswith(".partial") for name in disk.names())
    for partial in out.glob("*.merge.mcap.partial"):
        read_events(partial)
    disk.resize(ROOMY_KB)
    assert invoke([*map(str, command)]) == 0
    assert "summary.json" in disk.names() and not any(name.endswith(".partial") for name in disk.names())


def test_a_label_is_there_or_not(disk):
    said = {"receiver": "a", "donor": "b", "verdict": "right"}
    label(disk.path, "r1", merge_id="a.b.1", **said)
    before = disk.names()
    disk.fill()
    with pytest.raises(OutputError, match="because the disk or the quota is full: make room"):
        label(disk.path, "r1", merge_id="a.b.2", **said)
    assert disk.names() == before
    (disk.path / "filler").unlink()
    label(disk.path, "r1", merge_id="a.b.2", **said)
    assert len(disk.names()) == len(before) + 1


@pytest.mark.parametrize("size_kb", [4, 200])
def test_a_conversion_leaves_nothing(disk, tmp_path, capsys, size_kb):
    log = tmp_path / "a.log"
    beams = " ".join(f"{2 + n / 7:.3f}" for n in range(180))
    log.write_text("".join(f"FLASER 180 {beams} {n} 0 0 {n} 0 0 {n} h {n + n / 13:.3f}\n" for n in range(4000)))
    disk.resize(size_kb)
    assert "cannot be written: No space left on device" in refused(capsys, "convert", log, disk.path / "a.mcap")
    assert disk.names() == set()


def test_matched_maps_are_written_whole_or_not_at_all(disk, tmp_path, capsys):
    image = np.full((60, 60), 254, np.uint8)
    image[10:50, 10:12] = image[10:12, 10:50] = 0
    plan = tmp_path / "plan.png"
    assert cv2.imwrite(str(plan), image)
    (disk.path / "out").mkdir()
    (disk.path / "out" / ".mapgraft.lock").touch()
    disk.fill()
    said = refused(capsys, "match", "--resolution", "0.1", plan, plan, "-o", disk.path / "out")
    assert "because the disk or the quota is full: make room" in said
    assert all(name.endswith(".partial") for name in disk.names())
