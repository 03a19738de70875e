"""Small files of legal messages that say as much as the limits allow: what a run takes of memory stays bounded."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from mapgraft.config import LimitsConfig

MOST_RESIDENT_MB = 1500
MOST_ADDRESSES_KB = 6 << 20  # kernels and threads ask for much that they never touch
STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
ORIGIN = T["geometry_msgs/msg/Pose"](
    T["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
)


def write(path: Path, topic: str, message: object) -> None:
    name = message.__msgtype__
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start("ros2")
        schema = writer.register_schema(name, "ros2msg", STORE.generate_msgdef(name, ros_version=2)[0].encode())
        writer.add_message(
            writer.register_channel(topic, "cdr", schema), 1, bytes(STORE.serialize_cdr(message, name)), 1
        )
        writer.finish()


def grid(width: int, height: int) -> object:
    info = T["nav_msgs/msg/MapMetaData"](T["builtin_interfaces/msg/Time"](0, 0), 0.05, width, height, ORIGIN)
    header = T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](1, 1), "map")
    return T["nav_msgs/msg/OccupancyGrid"](header, info, np.zeros(width * height, np.int8))


def run(path: Path, folder: Path) -> tuple[int, str, float]:
    """Exit code, what was said, and the most memory in MB that a run of its own process took."""
    command = [sys.executable, "-m", "mapgraft", "run", "-q", str(path), "-o", str(folder)]
    limited = ["/bin/sh", "-c", f'ulimit -v {MOST_ADDRESSES_KB}; exec "$@"', "sh", *command]
    with subprocess.Popen(limited, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, said, used.ru_maxrss / 1024


@pytest.mark.parametrize("width", [6300, 40_000])
def test_a_map_as_large_as_the_limits_allow(tmp_path: Path, width: int) -> None:
    path, cells = tmp_path / "a.mcap", LimitsConfig().grid_cells
    write(path, "/map", grid(width, cells // width))
    assert path.stat().st_size < 20_000
    code, said, resident_mb = run(path, tmp_path / "out")
    assert code == 0, said
    assert resident_mb < MOST_RESIDENT_MB
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_map_larger_than_that_is_refused(tmp_path: Path) -> None:
    path, cells = tmp_path / "a.mcap", LimitsConfig().grid_cells
    write(path, "/map", grid(20_000, cells // 20_000 + 1))
    code, said, resident_mb = run(path, tmp_path / "out")
    assert code != 0 and "raise limits.grid_cells (40,000,000)" in " ".join(said.split())
    assert resident_mb < MOST_RESIDENT_MB
