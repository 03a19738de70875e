"""Readings as ROS 2 messages: scans, tf, static tf and odometry, with frames prefixed by the robot's name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mapgraft.contracts import Transform
from mapgraft_recordings.simulator.estimation import in_frame, inverse
from mapgraft_recordings.simulator.simulation import START_NS, Pose, Reading, Robot


class Message(NamedTuple):
    """A ROS 2 message: ``fields`` maps the field names of its type to plain values, arrays and nested mappings."""

    topic: str
    message_type: str
    stamp_ns: int
    fields: Mapping[str, object]


def ros_messages(robots: Sequence[Robot], readings: Iterable[Reading]) -> Iterator[Message]:
    """The readings as messages, after one ``/tf_static`` per robot.

    A reading without a scan becomes a ``/tf`` (map → odom → base_link) and an odometry message, one with a scan a
    ``/<robot>/scan``. Only what a robot knows is in them, never the truth.
    """
    by_name = {robot.name: robot for robot in robots}
    for robot in robots:
        yield static_message(robot.name, "laser", robot.lidar.mount.T_base_sensor)
    for reading in readings:
        if reading.ranges_m is None:
            yield tf_message(reading)
            yield _odometry(reading)
        else:
            yield _scan(by_name[reading.robot], reading)


def static_message(robot: str, sensor: str, T_base_sensor: Transform) -> Message:
    """Where a sensor sits on the robot's body."""
    translation = {"x": T_base_sensor.x_m, "y": T_base_sensor.y_m, "z": T_base_sensor.z_m}
    rotation = dict(zip("xyzw", T_base_sensor.quaternion_xyzw(), strict=True))
    transform = _stamped(START_NS, f"{robot}/base_link", f"{robot}/{sensor}", translation, rotation)
    return Message("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, {"transforms": [transform]})


def tf_message(reading: Reading) -> Message:
    """Where a robot believes to be: map → odom → base_link."""
    odom_base = np.array(reading.T_odom_base)
    map_odom = in_frame(np.array(reading.T_map_base), inverse(odom_base)[None])[0]
    name, stamp = reading.robot, reading.stamp_ns
    transforms = [
        _stamped(stamp, f"{name}/map", f"{name}/odom", *_planar(map_odom.tolist())),
        _stamped(stamp, f"{name}/odom", f"{name}/base_link", *_planar(reading.T_odom_base)),
    ]
    return Message("/tf", "tf2_msgs/msg/TFMessage", stamp, {"transforms": transforms})


def _odometry(reading: Reading) -> Message:
    position, orientation = _planar(reading.T_odom_base)
    fields = {
        "header": header(reading.stamp_ns, f"{reading.robot}/odom"),
        "child_frame_id": f"{reading.robot}/base_link",
        "pose": {"pose": {"position": position, "orientation": orientation}, "covariance": np.zeros(36)},
        "twist": {
            "twist": {
                "linear": {"x": reading.speed_m_s, "y": 0.0, "z": 0.0},
                "angular": {"x": 0.0, "y": 0.0, "z": reading.turn_rad_s},
            },
            "covariance": np.zeros(36),
        },
    }
    return Message(f"/{reading.robot}/odom", "nav_msgs/msg/Odometry", reading.stamp_ns, fields)


def _scan(robot: Robot, reading: Reading) -> Message:
    lidar = robot.lidar
    fields = {
        "header": header(reading.stamp_ns, f"{robot.name}/laser"),
        "angle_min": lidar.angle_min_rad,
        "angle_max": lidar.angle_min_rad + (lidar.beams - 1) * lidar.angle_increment_rad,
        "angle_increment": lidar.angle_increment_rad,
        "time_increment": lidar.time_increment_s,
        "scan_time": 1.0 / lidar.rate_hz,
        "range_min": lidar.range_min_m,
        "range_max": lidar.range_max_m,
        "ranges": reading.ranges_m,
        "intensities": np.empty(0, np.float32),
    }
    return Message(f"/{robot.name}/scan", "sensor_msgs/msg/LaserScan", reading.stamp_ns, fields)


def header(stamp_ns: int, frame_id: str) -> Mapping[str, object]:
    """A message's header."""
    return {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}, "frame_id": frame_id}


def _stamped(
    stamp_ns: int, frame: str, child: str, translation: Mapping[str, float], rotation: Mapping[str, float]
) -> Mapping[str, object]:
    return {
        "header": header(stamp_ns, frame),
        "child_frame_id": child,
        "transform": {"translation": translation, "rotation": rotation},
    }


def _planar(pose: Pose | Sequence[float]) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Position and quaternion of a planar pose, to a hundredth of a millimetre and a microradian."""
    x, y, yaw = pose
    half = math.remainder(yaw, 2.0 * math.pi) / 2
    position = {"x": round(x, 5), "y": round(y, 5), "z": 0.0}
    return position, {"x": 0.0, "y": 0.0, "z": round(math.sin(half), 7), "w": round(math.cos(half), 7)}
