"""A mission as data: which robots drive where, with which lidars; and what a seed varies of it."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from mapgraft.config import Section, read_mapping
from mapgraft_recordings.simulator.driving import Limits, Waypoint, dense_line
from mapgraft_recordings.simulator.lidar import Lidar, Mount
from mapgraft_recordings.simulator.simulation import Pose, Robot
from mapgraft_recordings.simulator.world import FloorPlan, World, build_world, checked

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

_SPEED_VARIES = 0.08  # share
_START_VARIES_M = 0.25
_START_YAW_VARIES_RAD = math.radians(25.0)
_MAP_ORIGIN_VARIES_M = 5.0


class MountPlan(Section):
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.2
    yaw_deg: float = 0.0
    upside_down: bool = False


class LidarPlan(Section):
    beams: Annotated[int, Field(ge=2)]
    field_of_view_deg: Annotated[float, Field(gt=0, le=360)]
    range_m: tuple[Positive, Positive]
    rate_hz: Positive
    noise_sigma_m: Annotated[float, Field(ge=0)] = 0.01
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0
    sweep_s: Annotated[float, Field(ge=0)] = 0.0
    mount: MountPlan = MountPlan()


class RobotPlan(Section):
    lidar: LidarPlan
    speed_m_s: Positive
    route: Annotated[list[tuple[float, float] | tuple[float, float, float]], Field(min_length=2)]


class MissionPlan(Section):
    """A whole mission file."""

    duration_s: Positive
    robots: dict[str, RobotPlan]


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """A mission with everything that a seed decides: ready to be simulated."""

    world: World
    robots: tuple[Robot, ...]
    seed: int
    duration_s: float

    @property
    def T_world_map(self) -> dict[str, Pose]:
        """The truth that no robot knows: where every robot's map frame lies."""
        return {robot.name: robot.T_world_map for robot in self.robots}


def load_mission_plan(path: Path) -> MissionPlan:
    """Read a mission file; raises ConfigError with all its faults."""
    return checked(MissionPlan, read_mapping(path), str(path))


def build_mission(floor: FloorPlan, plan: MissionPlan, seed: int) -> Mission:
    """Fill in what the seed varies: clutter, speeds, start poses, scan times, where each robot's map frame lies."""
    robots = tuple(_vary(name, robot, seed) for name, robot in plan.robots.items())
    ways = [dense_line(np.array([(p.x_m, p.y_m) for p in robot.route]), 0.1) for robot in robots]
    return Mission(build_world(floor, seed, np.vstack(ways)), robots, seed, plan.duration_s)


def _vary(name: str, plan: RobotPlan, seed: int) -> Robot:
    rng = np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(name.encode()), 0x5EED]))
    dx, dy = rng.uniform(-_START_VARIES_M, _START_VARIES_M, 2)
    turned = rng.uniform(-_START_YAW_VARIES_RAD, _START_YAW_VARIES_RAD)
    speed = plan.speed_m_s * (1.0 + rng.uniform(-_SPEED_VARIES, _SPEED_VARIES))
    origin = rng.uniform(-_MAP_ORIGIN_VARIES_M, _MAP_ORIGIN_VARIES_M, 2)
    map_yaw = rng.uniform(-math.pi, math.pi)
    scan_delay_s = round(float(rng.uniform(0.0, 1.0)) / plan.lidar.rate_hz, 3)
    route = [Waypoint(*point) for point in plan.route]
    start = Waypoint(route[0].x_m + float(dx), route[0].y_m + float(dy), route[0].wait_s)
    ahead = math.atan2(route[1].y_m - start.y_m, route[1].x_m - start.x_m)
    return Robot(
        name=name,
        lidar=_lidar(plan.lidar),
        route=(start, *route[1:]),
        limits=Limits(speed_m_s=float(speed)),
        start_yaw_rad=ahead + float(turned),
        scan_delay_s=scan_delay_s,
        T_world_map=(start.x_m + float(origin[0]), start.y_m + float(origin[1]), float(map_yaw)),
    )


def _lidar(plan: LidarPlan) -> Lidar:
    mount = plan.mount
    return Lidar(
        beams=plan.beams,
        field_of_view_rad=math.radians(plan.field_of_view_deg),
        range_min_m=plan.range_m[0],
        range_max_m=plan.range_m[1],
        rate_hz=plan.rate_hz,
        noise_sigma_m=plan.noise_sigma_m,
        dropout=plan.dropout,
        sweep_s=plan.sweep_s,
        mount=Mount(mount.x_m, mount.y_m, mount.z_m, math.radians(mount.yaw_deg), mount.upside_down),
    )
