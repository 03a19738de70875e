"""Recordings made on the spot, with every option that a recorder may choose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore


class Sample(NamedTuple):
    """One message to be written; ``schema`` is (name, encoding, text), or None for none."""

    topic: str
    encoding: str
    schema: tuple[str, str, bytes] | None
    log_ns: int
    data: bytes


class Scans:
    """Laser scans and their definitions, of either ROS."""

    name = "sensor_msgs/msg/LaserScan"

    def __init__(self, store: Typestore, ros: int) -> None:
        self.store, self.ros = store, ros
        encoding = "ros1msg" if ros == 1 else "ros2msg"
        name = "sensor_msgs/LaserScan" if ros == 1 else self.name
        self.schema = (name, encoding, store.generate_msgdef(self.name, ros_version=ros)[0].encode())

    def message(self, stamp_ns: int, ranges: Any, frame: str = "laser", **fields: Any) -> Any:
        types = self.store.types
        header = {"stamp": types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), "frame_id": frame}
        if self.ros == 1:
            header["seq"] = 7
        given = {
            "angle_min": -1.5,
            "angle_max": 1.5,
            "angle_increment": 0.01,
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": 0.1,
            "range_max": 30.0,
            "intensities": np.zeros(0, np.float32),
            **fields,
        }
        return types[self.name](
            header=types["std_msgs/msg/Header"](**header), ranges=np.asarray(ranges, np.float32), **given
        )

    def encoded(self, message: Any, *, little_endian: bool = True) -> bytes:
        if self.ros == 1:
            return bytes(self.store.serialize_ros1(message, self.name))
        return bytes(self.store.serialize_cdr(message, self.name, little_endian=little_endian))

    def sample(self, log_ns: int, topic: str = "/scan", beams: int = 40, seed: int | None = None) -> Sample:
        """A scan with noisy ranges, so that no two samples are equal."""
        ranges = np.random.default_rng(log_ns if seed is None else seed).uniform(0.2, 20.0, beams)
        data = self.encoded(self.message(log_ns - 5, ranges))
        return Sample(topic, "ros1" if self.ros == 1 else "cdr", self.schema, log_ns, data)


@pytest.fixture(scope="session")
def ros2_scans() -> Scans:
    return Scans(get_typestore(Stores.ROS2_HUMBLE), 2)


@pytest.fixture(scope="session")
def ros1_scans() -> Scans:
    return Scans(get_typestore(Stores.ROS1_NOETIC), 1)


WriteMcap = Callable[..., Path]


def _write_mcap(
    path: Path,
    chunks: Iterable[Sequence[Sample]],
    *,
    compression: str = "zstd",
    profile: str = "ros2",
    finish: bool = True,
    **options: Any,
) -> Path:
    kinds = {"": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 30, compression=kinds[compression], **options)
        writer.start(profile)
        schemas: dict[tuple[str, str, bytes], int] = {}
        channels: dict[tuple[str, str, int], int] = {}
        for chunk in chunks:
            for sample in chunk:
                if sample.schema is not None and sample.schema not in schemas:
                    schemas[sample.schema] = writer.register_schema(*sample.schema)
                key = (sample.topic, sample.encoding, 0 if sample.schema is None else schemas[sample.schema])
                if key not in channels:
                    channels[key] = writer.register_channel(*key, metadata={})
                writer.add_message(channels[key], sample.log_ns, sample.data, sample.log_ns)
            writer.flush()
        if finish:
            writer.finish()
    return path


@pytest.fixture
def write_mcap(tmp_path: Path) -> WriteMcap:
    """``write_mcap(chunks, **options)``: an MCAP file with these chunks of samples; ``name`` is the file's name."""

    def write(chunks: Iterable[Sequence[Sample]], *, name: str = "recording.mcap", **options: Any) -> Path:
        return _write_mcap(tmp_path / name, chunks, **options)

    return write


@pytest.fixture(scope="session")
def index_kinds() -> type[IndexType]:
    return IndexType
