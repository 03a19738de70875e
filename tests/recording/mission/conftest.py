"""Missions made on the spot: robots that drive, scan and publish poses the way the tests want."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from mapgraft.config import parse_config
from mapgraft.plugins import Plugins
from mapgraft.recording.mission import Mission, open_mission

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
EPOCH_S = 1_700_000_000


def nanoseconds(t_s: float) -> int:
    return EPOCH_S * 10**9 + round(t_s * 1e9)


class Recorder:
    """Collects messages and writes them as one ROS 2 MCAP; times are seconds after an epoch.

    ``log_s`` is the time of recording (default: the stamp); ``clock_s`` is added to the stamps in the headers.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.clock_s = 0.0
        self._messages: list[tuple[int, int, str, str, Any]] = []

    def scan(
        self,
        t_s: float,
        topic: str = "/scan",
        frame: str = "laser",
        ranges: Any = None,
        log_s: float | None = None,
        **fields: Any,
    ) -> None:
        values = np.asarray(np.full(8, 2.0) if ranges is None else ranges, np.float32)
        given = {
            "angle_min": -1.5,
            "angle_max": 1.5,
            "angle_increment": 3.0 / max(len(values) - 1, 1),
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": 0.05,
            "range_max": 30.0,
            "intensities": np.zeros(0, np.float32),
            **fields,
        }
        message = T["sensor_msgs/msg/LaserScan"](header=self._header(t_s, frame), ranges=values, **given)
        self._add(t_s if log_s is None else log_s, topic, message)

    def tf(
        self,
        t_s: float,
        parent: str,
        child: str,
        x: float = 0.0,
        y: float = 0.0,
        yaw: float = 0.0,
        *,
        upside_down: bool = False,
        topic: str = "/tf",
        log_s: float | None = None,
    ) -> None:
        turn = _turn(yaw, upside_down)
        vector = T["geometry_msgs/msg/Vector3"](x=x, y=y, z=0.0)
        transform = T["geometry_msgs/msg/Transform"](translation=vector, rotation=turn)
        stamped = T["geometry_msgs/msg/TransformStamped"](
            header=self._header(t_s, parent), child_frame_id=child, transform=transform
        )
        self._add(t_s if log_s is None else log_s, topic, T["tf2_msgs/msg/TFMessage"](transforms=[stamped]))

    def static(self, parent: str, child: str, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, **more: Any) -> None:
        topic = more.pop("topic", "/tf_static")
        self.tf(0.0, parent, child, x, y, yaw, topic=topic, **more)

    def odometry(
        self, t_s: float, frame: str, child: str, x: float, y: float, yaw: float, topic: str = "/odom"
    ) -> None:
        pose = T["geometry_msgs/msg/PoseWithCovariance"](pose=_pose(x, y, yaw), covariance=np.zeros(36))
        zero = T["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        twist = T["geometry_msgs/msg/TwistWithCovariance"](
            twist=T["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
        )
        message = T["nav_msgs/msg/Odometry"](
            header=self._header(t_s, frame), child_frame_id=child, pose=pose, twist=twist
        )
        self._add(t_s, topic, message)

    def pose(self, t_s: float, frame: str, x: float, y: float, yaw: float, topic: str) -> None:
        message = T["geometry_msgs/msg/PoseStamped"](header=self._header(t_s, frame), pose=_pose(x, y, yaw))
        self._add(t_s, topic, message)

    def grid(self, t_s: float, topic: str = "/map", frame: str = "map", cells: Sequence[int] = (0, 100, -1, 0)) -> None:
        header = self._header(t_s, frame)
        info = T["nav_msgs/msg/MapMetaData"](
            map_load_time=header.stamp, resolution=0.5, width=2, height=len(cells) // 2, origin=_pose(-1.0, -1.0, 0.0)
        )
        message = T["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=np.asarray(cells, np.int8))
        self._add(t_s, topic, message)

    def text(self, t_s: float, topic: str) -> None:
        self._add(t_s, topic, T["std_msgs/msg/String"](data="hello"))

    def drive(
        self,
        until_s: float,
        *,
        prefix: str = "",
        ns: str = "",
        tf: str = "/tf",
        from_s: float = 0.0,
        where: Callable[[float], tuple[float, float, float]] = lambda t: (0.5 * t, 0.1 * t, 0.05 * t),
        slam: bool = True,
        scans: bool = True,
        mount: bool = True,
    ) -> Recorder:
        """A robot with a tree map → odom → base_link → laser, poses at 20 Hz and scans at 5 Hz, off the poses' beat."""
        if mount:
            self.static(prefix + "base_link", prefix + "laser", 0.2, 0.0, 0.0, topic=tf + "_static")
        n = round((until_s - from_s) * 20)
        for k in range(n + 1):
            t = from_s + k / 20
            x, y, yaw = where(t)
            self.tf(t, prefix + "odom", prefix + "base_link", x, y, yaw, topic=tf)
            if slam:
                self.tf(t, prefix + "map", prefix + "odom", 1.0 + 0.01 * t, -2.0, 0.001 * t, topic=tf)
            if scans and k % 4 == 0 and k < n:
                self.scan(t + 0.017, ns + "/scan", prefix + "laser")
        return self

    def write(self) -> Path:
        with self.path.open("wb") as file:
            writer = Writer(file, chunk_size=1 << 14)
            writer.start(profile="ros2")
            channels: dict[str, int] = {}
            for log_ns, _, topic, name, message in sorted(self._messages, key=lambda m: m[:2]):
                if topic not in channels:
                    definition = STORE.generate_msgdef(name, ros_version=2)[0].encode()
                    schema = writer.register_schema(name, "ros2msg", definition)
                    channels[topic] = writer.register_channel(topic, "cdr", schema)
                writer.add_message(channels[topic], log_ns, bytes(STORE.serialize_cdr(message, name)), log_ns)
            writer.finish()
        return self.path

    def _header(self, t_s: float, frame: str) -> Any:
        stamp = T["builtin_interfaces/msg/Time"](*divmod(nanoseconds(t_s + self.clock_s), 10**9))
        return T["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    def _add(self, log_s: float, topic: str, message: Any) -> None:
        self._messages.append((nanoseconds(log_s), len(self._messages), topic, message.__msgtype__, message))


def _turn(yaw: float, upside_down: bool = False) -> Any:
    c, s = math.cos(yaw / 2), math.sin(yaw / 2)
    x, y, z, w = (c, s, 0.0, 0.0) if upside_down else (0.0, 0.0, s, c)
    return T["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _pose(x: float, y: float, yaw: float) -> Any:
    return T["geometry_msgs/msg/Pose"](position=T["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), orientation=_turn(yaw))


@pytest.fixture
def record(tmp_path: Path) -> Callable[[str], Recorder]:
    """``record("run")`` is a recorder that writes ``run.mcap``."""
    return lambda name="run": Recorder(tmp_path / f"{name}.mcap")


@pytest.fixture
def mission() -> Any:
    """``mission(paths, robots={...}, start=...)`` opens a mission; it is closed when the test is over."""
    opened: list[Mission] = []

    def open_(
        paths: Path | Sequence[Path],
        robots: Mapping[str, Any] | None = None,
        plugins: Plugins | None = None,
        limits: Mapping[str, Any] | None = None,
        **options: Any,
    ) -> Mission:
        files = [paths] if isinstance(paths, Path) else list(paths)
        config = parse_config({"robots": robots or {}, "mission": options, "limits": limits or {}})
        opened.append(open_mission(files, config, plugins=plugins))
        return opened[-1]

    yield open_
    for one in opened:
        one.close()
