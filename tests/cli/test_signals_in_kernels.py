"""Runs that are signalled while a compiled kernel of a map type is at work, and do not hear of it before it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import slow_kernel

PROGRAM = """
from slow_kernel import kernel
from mapgraft.cli import main
from mapgraft_grid.map_type import OccupancyGrid

kernel(3)
calls, integrate = [], OccupancyGrid.integrate

def slow(self, layer, observation):
    calls.append(1)
    if len(calls) == 5:
        print("in the kernel", flush=True)
        kernel(600_000_000)
    return integrate(self, layer, observation)

OccupancyGrid.integrate = slow
main()
"""


@pytest.mark.parametrize(("number", "said"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "ended by SIGTERM")])
def test_no_map_is_published_as_if_nothing_had_been_said(tmp_path, number, said):
    command = [sys.executable, "-c", PROGRAM, "run", "-q", "-o", str(tmp_path / "out"), "--no-report", "--end", "9"]
    toys = {**os.environ, "PYTHONPATH": str(Path(slow_kernel.__file__).parent)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=toys)
    assert process.stdout is not None
    assert process.stdout.readline() == "in the kernel\n"
    time.sleep(0.1)
    process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    assert err.startswith(f"mapgraft: {said}; ")
    assert "Traceback" not in err
    assert not out
    assert not list((tmp_path / "out").glob("*.mcap"))
