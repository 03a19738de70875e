"""A robot of a mission that carries a spinning lidar in the place of its planar one, as ROS 2 messages."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mapgraft.config import Section
from mapgraft_recordings.buildings.spatial import SpinningLidar, turn_of
from mapgraft_recordings.mission import Mission
from mapgraft_recordings.simulator.messages import Message, header, static_message, tf_message
from mapgraft_recordings.simulator.simulation import Reading, Robot, simulate

_SALT = 0x3D
_STEPS_PER_M = 256.0  # what a point is rounded to: 4 mm, and numbers that pack well
_FLOAT32 = 7  # sensor_msgs/PointField
_FIELDS = [{"name": name, "offset": 4 * i, "datatype": _FLOAT32, "count": 1} for i, name in enumerate("xyz")]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class SpinningPlan(Section):
    """A spinning lidar as data. It turns once for every ``scans_per_turn`` scans of the planar lidar it replaces."""

    rings: Annotated[int, Field(ge=2)]
    columns: Annotated[int, Field(ge=8)]
    field_of_view_deg: tuple[Annotated[float, Field(gt=-80)], Annotated[float, Field(lt=80)]]
    range_m: Positive
    height_m: Positive
    noise_sigma_m: Annotated[float, Field(ge=0)] = 0.015
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0
    scans_per_turn: Annotated[int, Field(ge=1)] = 1
    poses_per_pose: Annotated[int, Field(ge=1)] = 1  # one of so many poses is recorded

    @property
    def lidar(self) -> SpinningLidar:
        low, high = map(math.radians, self.field_of_view_deg)
        return SpinningLidar(
            self.rings, self.columns, low, high, self.range_m, self.noise_sigma_m, self.dropout, self.height_m
        )


def spinning_messages(mission: Mission, robot: Robot, plan: SpinningPlan) -> Iterator[Message]:
    """What one robot of a mission records with a spinning lidar: ``/tf_static``, ``/tf`` and ``/<robot>/points``.

    It drives, believes and starts its turns as it does with the planar lidar. Points come organised, rows being rings,
    with NaN where nothing came back.
    """
    rng = np.random.default_rng(np.random.SeedSequence([mission.seed, zlib.crc32(robot.name.encode()), _SALT]))
    world, lidar = mission.world, plan.lidar
    yield static_message(robot.name, "lidar", lidar.T_base_sensor)
    poses = scans = 0
    for reading in simulate(world, [robot], mission.seed, mission.duration_s):
        if reading.ranges_m is None:
            poses += 1
            if poses % plan.poses_per_pose == 0:
                yield tf_message(reading)
            continue
        scans += 1
        if scans % plan.scans_per_turn == 0:
            points = turn_of(lidar, reading.T_world_base, world.segments, world.segment_tops_m, world.ceiling_m, rng)
            yield _points(reading, points)


def _points(reading: Reading, points_m: NDArray[np.float32]) -> Message:
    rings, columns = points_m.shape[:2]
    rounded = np.round(points_m * np.float32(_STEPS_PER_M)) / np.float32(_STEPS_PER_M)
    fields: Mapping[str, object] = {
        "header": header(reading.stamp_ns, f"{reading.robot}/lidar"),
        "height": rings,
        "width": columns,
        "fields": _FIELDS,
        "is_bigendian": False,
        "point_step": 12,
        "row_step": 12 * columns,
        "data": np.ascontiguousarray(rounded.astype("<f4")).reshape(-1).view(np.uint8),
        "is_dense": False,
    }
    return Message(f"/{reading.robot}/points", "sensor_msgs/msg/PointCloud2", reading.stamp_ns, fields)
