"""Where robots saw each other: told on topics of the recording, or by a person."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from mapgraft.config import MeetingConfig, SightingsConfig
from mapgraft.contracts import RecordingError
from mapgraft.contracts.sources import RawMessage, ReadFaults, Source
from mapgraft.lives import base_name
from mapgraft.recording.decoding.records import PoseRecord
from mapgraft.recording.poses.rigid import Pose7, believable, compose, yaw_of
from mapgraft.recording.robots.payloads import poses_in
from mapgraft.recording.robots.plan import RobotPlan, S
from mapgraft.recording.timeline.intake import Limits
from mapgraft.rendezvous import Seen, Sighted
from mapgraft.rendezvous import believable as is_measured

_MOST_SIGMA_RAD = 1.0  # whoever is less sure of a heading tells none


def sightings(plan: RobotPlan, shift_ns: int, limits: Limits, faults: ReadFaults) -> Iterator[Sighted]:
    """All that one robot's topics tell of others, in the order of recording; what cannot be used is counted.

    Raises RecordingError when a file cannot be read any more.
    """
    by_topic = {told.topic: told for told in plan.sightings}
    lag_ns = shift_ns + plan.clock_offset_ns
    for glimpse in plan.glimpses if by_topic else ():
        for raw in glimpse.source.messages(sorted(by_topic)):
            if plan.window is not None and not plan.window.holds(raw.log_ns):
                continue
            told_ns = raw.log_ns + plan.times.offset_ns + lag_ns
            early = limits.start_ns is not None and told_ns < limits.start_ns
            if early or (limits.end_ns is not None and told_ns >= limits.end_ns):
                continue
            told = by_topic[raw.channel.topic]
            for record in _records(glimpse.source, raw, faults):
                seen = _seen(plan, record, told, raw.channel.topic, faults)
                if seen is not None:
                    by_header = plan.times.clock == "header" and record.stamp_ns > 0
                    seen_ns = record.stamp_ns + lag_ns if by_header else told_ns
                    yield Sighted(plan.name, told_ns, seen_ns, told.robot, seen)


def meetings(told: Sequence[MeetingConfig], plans: Sequence[RobotPlan], start_ns: int) -> list[Sighted]:
    """What a person knows of meetings, in the order of time; of a robot's lives the one of that time is meant."""
    found = []
    for one in told:
        stamp_ns = start_ns + round(one.at_s * S)
        lives = [plan for plan in plans if base_name(plan.name) == one.a]
        begun = [plan.name for plan in lives if plan.life == 1 or plan.range.first_ns <= stamp_ns]
        yaw_rad = math.nan if one.yaw_rad is None else one.yaw_rad
        seen = Seen(one.x_m, one.y_m, yaw_rad, one.sigma_m, one.sigma_yaw_rad)
        found.append(Sighted(begun[-1] if begun else one.a, stamp_ns, stamp_ns, one.b, seen))
    return sorted(found, key=lambda entry: entry.stamp_ns)


def _records(source: Source, raw: RawMessage, faults: ReadFaults) -> Sequence[PoseRecord]:
    try:
        return poses_in(source, raw)
    except RecordingError as error:
        faults.add("pose_undecodable", str(error), topic=raw.channel.topic)
        return ()


def _seen(plan: RobotPlan, record: PoseRecord, told: SightingsConfig, topic: str, faults: ReadFaults) -> Seen | None:
    """Where the other robot's base lay in this one's; None where the message does not tell."""
    pose = believable(record.xyz_m, record.xyzw)
    if pose is None:
        sentence = f"a pose at {record.stamp_ns / 1e9:.3f} s is not finite, or its quaternion has no length"
        faults.add("pose_invalid", sentence, topic=topic)
        return None
    T_base_frame = _mount(plan, record.frame)
    if T_base_frame is None:
        base = plan.poses.base_frame
        sentence = f"a sighting lies in the frame {record.frame!r}, which is not fixed to {base!r}: it is left out"
        faults.add("sighting_frame", sentence, topic=topic)
        return None
    pose = compose(T_base_frame, pose)
    sigma_m, sigma_yaw_rad = _sigmas(record, told)
    yaw_rad = math.nan if sigma_yaw_rad is None else yaw_of(pose)
    seen = Seen(pose[0], pose[1], yaw_rad, sigma_m, sigma_yaw_rad or _MOST_SIGMA_RAD)
    if not is_measured(seen):
        faults.add("pose_invalid", f"a sighting lies {math.hypot(*pose[:2]):.3g} m away", topic=topic)
        return None
    return seen


def _mount(plan: RobotPlan, frame: str) -> Pose7 | None:
    """Where a frame of the robot sits on its base; None where that is not known, or changes."""
    base, frames = plan.poses.base_frame, plan.poses.tree.frames
    named = [name for name in (frame, f"{base.rpartition('/')[0]}/{frame}") if name == base or name in frames]
    if not frame or base in named:
        return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return frames.constant(base, named[0]) if named and frames.path(base, named[0]) else None


def _sigmas(record: PoseRecord, told: SightingsConfig) -> tuple[float, float | None]:
    """Standard deviations as the message tells them, else as configured; None for a heading that is not known."""
    if record.covariance is None or not record.covariance[0] + record.covariance[7] > 0.0:
        return told.sigma_m, told.sigma_yaw_rad
    sigma_m = math.sqrt(max(record.covariance[0], record.covariance[7]))
    sigma_yaw_rad = math.sqrt(max(record.covariance[35], 0.0))
    is_known = 0.0 < sigma_yaw_rad <= _MOST_SIGMA_RAD
    return sigma_m, sigma_yaw_rad if is_known else told.sigma_yaw_rad
