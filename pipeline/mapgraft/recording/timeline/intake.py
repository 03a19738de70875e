"""One robot's payloads on their way to become observations: which count, when they were, and where they belong."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import GRID_MESSAGE, Observation, RecordingError, Scan
from mapgraft.contracts.sources import Source
from mapgraft.recording.poses.lookup import Placed, TreePoses, beams_in_motion
from mapgraft.recording.poses.rigid import IDENTITY, Pose7, compose, from_transform, to_transform
from mapgraft.recording.poses.tf import Missing
from mapgraft.recording.robots.clocks import INDEX_STEP_NS
from mapgraft.recording.robots.payloads import Opened, Payloads, Read
from mapgraft.recording.robots.plan import RobotPlan
from mapgraft.recording.timeline.feeds import PoseFile
from mapgraft.recording.timeline.jumps import JumpWatch
from mapgraft.recording.timeline.tally import Tally
from mapgraft.recording.timeline.topic import Topic

LONGEST_SWEEP_NS = 1_000_000_000
"""No planar lidar turns slower than once a second: a longer sweep comes from a wrong ``time_increment``."""

_EARTH_M = 2.1e7
"""Maps may lie in coordinates of a country or of UTM; those are nowhere larger."""

_IN_PLACE = Placed(IDENTITY, IDENTITY)


class Limits(NamedTuple):
    """Which observations are wanted: ``start_ns`` included, ``end_ns`` excluded on the mission's timeline.

    With ``places_only`` they come without their payloads, which saves decoding them. What lies farther than
    ``extent_m`` from a robot's first observation is left out: one far point must not make a map of the whole world.
    """

    start_ns: int | None = None
    end_ns: int | None = None
    every: int = 1
    places_only: bool = False
    extent_m: float = math.inf


class Waiting(NamedTuple):
    """A payload that waits for its pose; sorts by time, then by robot, topic and order of reading."""

    stamp_ns: int  # on the mission's timeline
    robot: int
    topic: int
    number: int
    log_ns: int
    robot_ns: int  # by the robot's own clock, as its poses are stamped
    opened: Opened
    intake: Intake


class Intake:
    """Takes in one robot's payloads and gives its observations.

    ``order`` breaks ties between robots. ``poses`` is None where each scan brings its own pose, or none is needed;
    ``T_anchor_map`` moves everything into the robot's own map frame; ``shift_ns`` is added to the robot's stamps.
    """

    def __init__(
        self,
        plan: RobotPlan,
        order: int,
        payloads: Payloads,
        poses: TreePoses | None,
        pose_file: PoseFile | None,
        *,
        shift_ns: int,
        T_anchor_map: Pose7 | None,
        limits: Limits,
        tally: Tally,
    ) -> None:
        self.plan = plan
        self._poses = poses
        self._pose_file = pose_file
        self._order = order
        self._payloads = payloads
        self._shift_ns = shift_ns + plan.clock_offset_ns
        self._T_anchor_map = T_anchor_map
        self._limits = limits
        self._topics = [
            Topic(
                seen.topic,
                seen.kind,
                seen.frame,
                plan.poses.sensors.get(seen.topic, seen.frame),
                tally.of(plan.name, seen.topic, seen.kind),
                plan.times,
            )
            for seen in plan.payloads
        ]
        self._first_xy: tuple[float, float] | None = None
        self._jumps = JumpWatch(plan.max_speed_m_s)
        self._order_of = {topic.name: k for k, topic in enumerate(self._topics)}

    def take(self, source: Source, read: Read) -> Waiting | None:
        """A message of one of the robot's payload topics; None when it is not wanted, which is tallied."""
        k = self._order_of[read.channel.topic]
        topic = self._topics[k]
        number = topic.met
        topic.met += 1
        topic.tally.read += 1
        window, times, limits = self.plan.window, self.plan.times, self._limits
        if window is not None and not window.holds(number * INDEX_STEP_NS if times.clock == "index" else read.log_ns):
            topic.tally.outside += 1
            return None
        opened = self._opened(topic, source, read)
        if opened is None:
            return None
        robot_ns = topic.time(number, read, opened)
        if robot_ns is None:
            return None
        stamp_ns = robot_ns + self._shift_ns
        early = limits.start_ns is not None and stamp_ns < limits.start_ns
        if early or (limits.end_ns is not None and stamp_ns >= limits.end_ns):
            topic.tally.outside += 1
            return None
        topic.wanted += 1
        if topic.kind != GRID_MESSAGE and (topic.wanted - 1) % limits.every:
            topic.tally.thinned += 1
            return None
        return Waiting(stamp_ns, self._order, k, number, read.log_ns, robot_ns, opened, self)

    def standing(self, source: Source) -> list[Waiting]:
        """The ready maps that hold when the mission starts: of each topic the last one recorded before."""
        start_ns, plan = self._limits.start_ns, self.plan
        if start_ns is None or plan.window is not None or plan.times.clock == "index":
            return []
        robot_ns = start_ns - self._shift_ns
        found = []
        for k, topic in enumerate(self._topics):
            before_ns = robot_ns - plan.times.offset_ns - 1
            maps = source.messages([topic.name], None, before_ns) if topic.kind == GRID_MESSAGE else ()
            for raw in deque(maps, maxlen=1):
                topic.tally.read += 1
                if opened := self._opened(topic, source, raw):
                    found.append(Waiting(start_ns, self._order, k, -1, raw.log_ns, robot_ns, opened, self))
        return found

    def _opened(self, topic: Topic, source: Source, read: Read) -> Opened | None:
        try:
            return self._payloads.open(source, read)
        except RecordingError as error:
            topic.tally.drop("undecodable", read.log_ns, str(error))
            return None

    def settled(self, waiting: Waiting, patience_ns: int) -> bool:
        """Whether waiting longer would tell no more about the payload's pose.

        Another file with poses is read up to the payload, and further by the patience where poses are missing.
        """
        if self._poses is None:
            return True
        topic = self._topics[waiting.topic]
        frame = self._poses.base_frame if topic.kind == GRID_MESSAGE else topic.frame(waiting.opened)
        until_ns = waiting.robot_ns + max(_sweep(waiting.opened), 0)
        if self._pose_file is not None:
            self._pose_file.read_until(self._poses, frame, until_ns, patience_ns)
        return self._poses.settled(frame, until_ns)

    def drop(self, waiting: Waiting, cause: str, why: str) -> None:
        """Tally a payload that cannot become an observation."""
        self._topics[waiting.topic].tally.drop(cause, waiting.robot_ns, why)

    def observe(self, waiting: Waiting) -> Observation | None:
        """The observation, or None when its pose or its content is missing, which is tallied."""
        topic, opened = self._topics[waiting.topic], waiting.opened
        if topic.kind == GRID_MESSAGE:
            placed: Placed | Missing = self._place_map(topic, waiting)
        else:
            placed = self._place(topic, waiting)
        if isinstance(placed, Missing):
            topic.tally.drop(placed.cause, waiting.robot_ns, placed.sentence)
            return None
        try:
            payload = self._payload(topic, waiting, placed)
        except RecordingError as error:
            topic.tally.drop("undecodable", waiting.robot_ns, str(error))
            return None
        if isinstance(payload, Missing):
            topic.tally.drop(payload.cause, waiting.robot_ns, payload.sentence)
            return None
        T_map_base, T_map_sensor = placed
        if (far := self._too_far(T_map_sensor)) is not None:
            topic.tally.drop("far_away", waiting.robot_ns, far)
            return None
        if topic.kind != GRID_MESSAGE and not self._stays(topic, waiting, T_map_base):
            return None
        topic.tally.used += 1
        if self._T_anchor_map is not None:
            T_map_base = compose(self._T_anchor_map, T_map_base)
            T_map_sensor = compose(self._T_anchor_map, T_map_sensor)
        return Observation(
            self.plan.name,
            waiting.stamp_ns,
            opened.stamp_ns if self.plan.times.clock == "index" else waiting.robot_ns,
            opened.frame or topic.name,
            topic.kind,
            payload,
            to_transform(T_map_sensor),
            to_transform(T_map_base),
        )

    def _stays(self, topic: Topic, waiting: Waiting, T_map_base: Pose7) -> bool:
        """Whether an observation is to be used for all that its pose jumps or not, which is tallied."""
        why, used = self._jumps.judge(waiting.robot_ns, T_map_base)
        if why:
            (topic.tally.notice if used else topic.tally.drop)("pose_jump", waiting.robot_ns, why)
        return used

    def _too_far(self, T_map_sensor: Pose7) -> str | None:
        """Why an observation lies too far from the robot's first, or None."""
        x, y = T_map_sensor[0], T_map_sensor[1]
        if self._first_xy is None:
            if math.hypot(x, y) > _EARTH_M:
                return f"its pose lies {math.hypot(x, y):.6g} m from the origin of its frame, farther than any place"
            self._first_xy = (x, y)
            return None
        away_m = math.hypot(x - self._first_xy[0], y - self._first_xy[1])
        if away_m <= self._limits.extent_m:
            return None
        return (
            f"its pose lies {away_m:.6g} m from the robot's first: raise limits.extent_m ({self._limits.extent_m:g}) "
            "if the robot went so far"
        )

    def _place(self, topic: Topic, waiting: Waiting) -> Placed | Missing:
        opened = waiting.opened
        if self._poses is None:
            return opened.placed or Missing("pose_invalid", "the scan's own pose is not finite")
        placed = self._poses.at(topic.frame(opened), waiting.robot_ns)
        if opened.T_frame_sensor is not None and not isinstance(placed, Missing):
            T_frame_sensor = from_transform(opened.T_frame_sensor)
            return Placed(placed.T_map_base, compose(placed.T_map_sensor, T_frame_sensor))
        return placed

    def _place_map(self, topic: Topic, waiting: Waiting) -> Placed:
        """A ready map lies in its own frame; where the body was is known only where the recording tells."""
        if self._poses is None:
            return _IN_PLACE
        placed = self._poses.at(self._poses.base_frame, waiting.robot_ns)
        return _IN_PLACE if isinstance(placed, Missing) else Placed(placed.T_map_base, IDENTITY)

    def _payload(self, topic: Topic, waiting: Waiting, placed: Placed) -> object:
        """The payload; of a scan in motion with its beams placed, or why they cannot be."""
        opened = waiting.opened
        beams = self._beams(topic, waiting, placed) if opened.sweep_ns and self._poses is not None else None
        if isinstance(beams, Missing):
            return beams
        if self._limits.places_only:
            return None
        payload = opened.content()
        if beams is None or not isinstance(payload, Scan):
            return payload
        return Scan(payload.directions, payload.ranges_m, payload.hits, beams)

    def _beams(self, topic: Topic, waiting: Waiting, placed: Placed) -> NDArray[np.float64] | Missing | None:
        """Where the sensor was at each beam; None where it stood still or the beams' times cannot be true."""
        sweep_ns = _sweep(waiting.opened)
        if not sweep_ns:
            topic.tally.sweeps_ignored += 1
            return None
        last = self._place(topic, waiting._replace(robot_ns=waiting.robot_ns + sweep_ns))
        if isinstance(last, Missing):
            return last
        return beams_in_motion(placed.T_map_sensor, last.T_map_sensor, waiting.opened.beams)


def _sweep(opened: Opened) -> int:
    """The time from the first to the last beam, 0 where it cannot be true."""
    return opened.sweep_ns if abs(opened.sweep_ns) <= LONGEST_SWEEP_NS else 0
