"""Drives through a building: scans where the robot moved or turned enough, placed by poses such as SLAM leaves them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import SCAN, Observation, Transform
from mapgraft.errors import ConfigError
from mapgraft_recordings.buildings.building import Building, Visit, first_visit, next_visit, standing
from mapgraft_recordings.buildings.motion import Wanderer, draw_habits
from mapgraft_recordings.buildings.planning import Ground, ground
from mapgraft_recordings.buildings.sensing import People, Sensor, as_scan, draw_sensor, sense
from mapgraft_recordings.buildings.shapes import Segments
from mapgraft_recordings.buildings.traits import KINDS
from mapgraft_recordings.simulator.simulation import START_NS

_SALT = 0xD81E
_SHUT_IN = 20  # hops without a way in a row
_CHANGE_SHARE = 0.15  # of the pauses between two hops, in buildings that change

Pose = tuple[float, float, float]  # x, y in metres, yaw in radians


@dataclass(frozen=True, slots=True)
class Pace:
    """A scan every ``every_m`` of way or ``every_rad`` of turning, whichever comes first."""

    every_m: float
    every_rad: float
    speed_m_s: float
    turn_rad_s: float


@dataclass(frozen=True, slots=True)
class PoseError:
    """What is wrong with corrected poses: a slow drift with a memory counted in scans, and a jitter of every scan."""

    drift_m: float
    drift_rad: float
    memory_scans: float
    jitter_m: float
    jitter_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One scan of a drive: when, from where in truth, and what was reported (n,)."""

    stamp_ns: int
    pose: Pose
    ranges_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A drive with its truth: ``poses`` (n, 3) as they were, ``believed`` (n, 3) as SLAM has them; building's frame."""

    sensor: Sensor
    sightings: tuple[Sighting, ...]
    poses: NDArray[np.float64]
    believed: NDArray[np.float64]


def drive(building: Building, seed: int, scans: int = 400) -> list[Observation]:
    """The observations of one drive, their poses as SLAM would have them, in the building's frame.

    The same building and seed give the same observations; longer drives begin like shorter ones but for changes of the
    building. Raises ConfigError where the building has no room to drive.
    """
    return observations(record(building, seed, scans))


def observations(made: Drive, robot: str = "robot") -> list[Observation]:
    """A drive as observations."""
    directions = made.sensor.directions()
    found = []
    for sighting, (x, y, yaw) in zip(made.sightings, made.believed.tolist(), strict=True):
        pose = Transform.planar(x, y, yaw)
        scan = as_scan(made.sensor, directions, sighting.ranges_m)
        found.append(Observation(robot, sighting.stamp_ns, sighting.stamp_ns, "scan", SCAN, scan, pose, pose))
    return found


def record(building: Building, seed: int, scans: int = 400) -> Drive:
    """One drive with its truth. Raises ConfigError where the building has no room to drive."""
    random = streams(building, seed)
    sensor = draw_sensor(random.sensor)
    sightings = tuple(_sightings(building, sensor, scans, random))
    poses = np.array([sighting.pose for sighting in sightings])
    return Drive(sensor, sightings, poses, drifted(poses, random.poses))


class Streams(NamedTuple):
    """Random numbers of one drive, apart for what should not disturb each other."""

    motion: np.random.Generator
    sensor: np.random.Generator
    poses: np.random.Generator
    world: np.random.Generator


def streams(building: Building, seed: int) -> Streams:
    """The random numbers of the drive of a seed through a building; ``world`` first draws how its doors stand."""
    root = np.random.SeedSequence([building.seed, KINDS.index(building.kind), seed, _SALT])
    return Streams(*(np.random.default_rng(child) for child in root.spawn(4)))


def _sightings(building: Building, sensor: Sensor, scans: int, random: Streams) -> Iterator[Sighting]:
    """Scans along the way, each from where the robot moved or turned enough since the one before."""
    traits = building.traits
    people = People(traits.people, random.world)
    for stop in stops(building, scans, random):
        seen = np.vstack((stop.solid, people.legs(stop.pose)))
        ranges_m = sense(sensor, stop.pose, seen, building.glass, traits.glass_reflects, random.sensor)
        yield Sighting(stop.stamp_ns, stop.pose, ranges_m)


class Stop(NamedTuple):
    """Where a drive looks around: when, from where in truth, and what stands around (m, 4)."""

    stamp_ns: int
    pose: Pose
    solid: Segments


def stops(building: Building, scans: int, random: Streams) -> Iterator[Stop]:
    """So many places along the way, each where the robot moved or turned enough since the one before."""
    pace = _draw_pace(random.motion)
    stamp_s, last = 0.0, None
    for pose, solid in _way(building, random.motion, random.world):
        if last is not None:
            moved, turned = math.dist(pose[:2], last[:2]), abs(math.remainder(pose[2] - last[2], 2.0 * math.pi))
            if moved < pace.every_m and turned < pace.every_rad:
                continue
            stamp_s += moved / pace.speed_m_s + turned / pace.turn_rad_s
        last = pose
        yield Stop(START_NS + round(stamp_s * 1e9), pose, solid)
        scans -= 1
        if not scans:
            return


def drifted(poses: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Poses (n, 3) as SLAM would have them."""
    return _believed(poses, _draw_error(rng), rng)


def _way(
    building: Building, motion_rng: np.random.Generator, world_rng: np.random.Generator
) -> Iterator[tuple[Pose, Segments]]:
    """True poses without end, each with what stands around; between two hops the building may change."""
    habits = draw_habits(motion_rng)
    rooms = [outline for _, outline in building.rooms]
    wanderer = Wanderer(rooms, habits, motion_rng)
    visit = first_visit(building, world_rng)
    solid, floor = _scene(building, visit, habits.robot_m)
    if not wanderer.start(floor):
        raise ConfigError(f"the {building.kind} of seed {building.seed} has no room to drive in")
    idle = 0
    while idle < _SHUT_IN:
        idle += 1
        for pose in wanderer.hop(floor):
            idle = 0
            yield pose, solid
        if building.traits.changes and world_rng.random() < _CHANGE_SHARE:
            after = next_visit(building, visit, building.traits.changes, world_rng)
            changed, ground_after = _scene(building, after, habits.robot_m)
            if wanderer.fits(ground_after):
                visit, solid, floor = after, changed, ground_after
    raise ConfigError(f"in the {building.kind} of seed {building.seed} the robot found no way on")


def _scene(building: Building, visit: Visit, robot_m: float) -> tuple[Segments, Ground]:
    solid = standing(building, visit)
    obstacles = np.vstack((solid, building.glass))
    return solid, ground(obstacles, [outline for _, outline in building.rooms], robot_m)


def _draw_pace(rng: np.random.Generator) -> Pace:
    """Most robots scan about every metre or 30 degrees, as those of many public logs; the others oftener."""
    sparse = rng.random() < 0.6
    return Pace(
        every_m=float(rng.uniform(0.85, 1.05) if sparse else rng.uniform(0.3, 0.85)),
        every_rad=math.radians(float(rng.uniform(25.0, 32.0) if sparse else rng.uniform(12.0, 30.0))),
        speed_m_s=float(rng.uniform(0.25, 0.8)),
        turn_rad_s=float(rng.uniform(0.3, 1.0)),
    )


def _draw_error(rng: np.random.Generator) -> PoseError:
    return PoseError(
        drift_m=float(rng.uniform(0.005, 0.035)),
        drift_rad=math.radians(float(rng.uniform(0.03, 0.35))),
        memory_scans=float(rng.uniform(10.0, 80.0)),
        jitter_m=float(rng.uniform(0.002, 0.025)),
        jitter_rad=math.radians(float(rng.uniform(0.03, 0.35))),
    )


def _believed(poses: NDArray[np.float64], error: PoseError, rng: np.random.Generator) -> NDArray[np.float64]:
    """True poses (n, 3) with a twice smoothed Gauss-Markov drift and a jitter."""
    kept = math.exp(-1.0 / error.memory_scans)
    fresh = rng.normal(0.0, 1.0, (2, *poses.shape))
    slow, drift = fresh[1, 0].copy(), np.empty_like(poses)
    for k in range(len(poses)):
        slow = kept * slow + math.sqrt(1.0 - kept * kept) * fresh[0, k]
        drift[k] = slow
    sizes = np.array([error.drift_m, error.drift_m, error.drift_rad])
    jitters = np.array([error.jitter_m, error.jitter_m, error.jitter_rad])
    believed: NDArray[np.float64] = poses + drift * sizes + fresh[1] * jitters
    return believed
