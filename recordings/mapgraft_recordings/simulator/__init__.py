"""A small planar world with lidars in it: floor plans as data, ray casting, driven robots, ROS 2 messages.

``simulate(world, robots, seed, duration_s)`` gives readings while they are asked for; ``observations`` turns them into
what the engine maps from, ``ros_messages`` into what a recording holds.
"""

from mapgraft_recordings.simulator.driving import Limits, Trajectory, Waypoint, drive
from mapgraft_recordings.simulator.estimation import OdometryError, SlamError
from mapgraft_recordings.simulator.lidar import Lidar, Mount
from mapgraft_recordings.simulator.messages import Message, ros_messages
from mapgraft_recordings.simulator.raycast import cast_fan, cast_rays, distance_to_walls, unit_vectors
from mapgraft_recordings.simulator.simulation import START_NS, Reading, Robot, observations, simulate, trajectory_of
from mapgraft_recordings.simulator.world import FloorPlan, World, build_world, load_plan, parse_plan

__all__ = [
    "START_NS",
    "FloorPlan",
    "Lidar",
    "Limits",
    "Message",
    "Mount",
    "OdometryError",
    "Reading",
    "Robot",
    "SlamError",
    "Trajectory",
    "Waypoint",
    "World",
    "build_world",
    "cast_fan",
    "cast_rays",
    "distance_to_walls",
    "drive",
    "load_plan",
    "observations",
    "parse_plan",
    "ros_messages",
    "simulate",
    "trajectory_of",
    "unit_vectors",
]
