"""How much of a recording is fetched when only part of it is wanted: ``python tests/bench/bench_ranges.py``.

A file of laser scans (1081 beams), odometry and a camera, with chunks of one topic each and with chunks of all topics.
No store is asked: bytes and requests are counted, each of which costs a store's latency once.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from mapgraft.config import Config, parse_config
from mapgraft.recording.containers.octets import RangedOctets
from mapgraft.recording.mission import open_mission

SCAN, ODOMETRY, CAMERA = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/CompressedImage"
BEAMS, RATE_HZ, IMAGE_BYTES = 1081, 10, 60_000
ROW = 50  # messages of a chunk


def write(path: Path, seconds: int, *, apart: bool) -> None:
    """Scans, odometry and a camera that nobody needs, each topic in chunks of its own (``apart``) or all mixed."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    noise = np.random.default_rng(0)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 30, compression=CompressionType.LZ4)
        writer.start("ros2")
        channels = {}
        for topic, kind in (("/scan", SCAN), ("/odom", ODOMETRY), ("/image", CAMERA)):
            text = store.generate_msgdef(kind, ros_version=2)[0].encode()
            schema = writer.register_schema(kind, "ros2msg", text)
            channels[topic] = writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": ""})
        for begin in range(0, seconds * RATE_HZ, ROW):
            rows = [(topic, n) for topic in channels for n in range(begin, begin + ROW)]
            for k, (topic, n) in enumerate(rows if apart else sorted(rows, key=lambda row: row[1])):
                stamp_ns = n * 10**9 // RATE_HZ
                data = bytes(store.serialize_cdr(*_message(store.types, topic, stamp_ns, noise)))
                writer.add_message(channels[topic], stamp_ns, data, stamp_ns)
                if k % ROW == ROW - 1:
                    writer.flush()
        writer.finish()


def _message(types: Any, topic: str, stamp_ns: int, noise: np.random.Generator) -> tuple[Any, str]:
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="odom" if topic == "/odom" else "laser")
    if topic == "/image":
        return types[CAMERA](header=header, format="jpeg", data=noise.integers(0, 256, IMAGE_BYTES, np.uint8)), CAMERA
    if topic == "/scan":
        ranges = noise.uniform(1, 9, BEAMS).astype(np.float32)
        fixed = {"angle_min": -2.3, "angle_max": 2.3, "angle_increment": 4.6 / (BEAMS - 1), "time_increment": 0.0}
        limits = {"scan_time": 0.1, "range_min": 0.1, "range_max": 30.0, "intensities": np.zeros(0, np.float32)}
        return types[SCAN](header=header, ranges=ranges, **fixed, **limits), SCAN
    point = types["geometry_msgs/msg/Point"](x=stamp_ns / 1e10, y=0.0, z=0.0)
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    none = np.zeros(36)
    pose = types["geometry_msgs/msg/PoseWithCovariance"](
        pose=types["geometry_msgs/msg/Pose"](position=point, orientation=turn), covariance=none
    )
    twist = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=none
    )
    return types[ODOMETRY](header=header, child_frame_id="laser", pose=pose, twist=twist), ODOMETRY


def fetched(path: Path, config: Config) -> tuple[int, int, int]:
    """Bytes and requests of a mission that is read to its end, and its observations."""
    with path.open("rb") as file:

        def read(begin: int, end: int) -> bytes:
            return os.pread(file.fileno(), end - begin, begin)  # several threads ask

        octets = RangedOctets(path.name, path.stat().st_size, read)
        with open_mission([path], config, octets={path: octets}) as mission:
            observations = sum(1 for _ in mission.observations())
        return octets.fetched_bytes, octets.requests, observations


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=300)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for apart in (True, False):
            path = Path(folder) / "mission.mcap"
            write(path, given.seconds, apart=apart)
            size = path.stat().st_size
            print(f"{size / 1e6:.0f} MB, scans and poses {_wanted(given.seconds) / 1e6:.0f} MB, chunks", end=" ")
            print("of one topic each" if apart else "of all topics")
            print("replayed     scans   fetched MB  of the file  requests")
            for share in (1.0, 0.25, 0.05):
                config = parse_config({"mission": {"end_s": share * given.seconds}})
                total, requests, observations = fetched(path, config)
                print(f"{share:8.0%}  {observations:8}  {total / 1e6:10.1f}  {total / size:11.1%}  {requests:8}")


def _wanted(seconds: int) -> float:
    return seconds * RATE_HZ * (4 * BEAMS + 100 + 720)


if __name__ == "__main__":
    main()
