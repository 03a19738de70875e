"""A robot's own word on where it was: the paths that its mapper publishes anew after closing a loop."""

from __future__ import annotations

from collections.abc import Iterator

from mapgraft.contracts import RecordingError
from mapgraft.contracts.sources import RawMessage, ReadFaults, Source
from mapgraft.correction import Correction
from mapgraft.recording.poses.rigid import Pose7, believable, compose
from mapgraft.recording.robots.payloads import poses_in
from mapgraft.recording.robots.plan import RobotPlan
from mapgraft.recording.timeline.intake import Limits


def corrections(
    plan: RobotPlan, shift_ns: int, T_anchor_map: Pose7 | None, limits: Limits, faults: ReadFaults
) -> Iterator[Correction]:
    """The corrections of one robot in time order, each when its message was recorded.

    What cannot be used is counted. Raises RecordingError when a file cannot be read any more.
    """
    if plan.corrections is None:
        return
    source, topic = plan.corrections.source, plan.corrections.topic
    to_robot_ns = plan.times.offset_ns
    for raw in source.messages([topic]):
        if plan.window is not None and not plan.window.holds(raw.log_ns):
            continue
        stamp_ns = raw.log_ns + to_robot_ns + shift_ns + plan.clock_offset_ns
        early = limits.start_ns is not None and stamp_ns < limits.start_ns
        if early or (limits.end_ns is not None and stamp_ns >= limits.end_ns):
            continue
        poses = _poses(plan, source, raw, faults)
        if T_anchor_map is not None:
            poses = {recorded_ns: compose(T_anchor_map, pose) for recorded_ns, pose in poses.items()}
        if poses:
            yield Correction(plan.name, stamp_ns, tuple(sorted(poses)), tuple(poses[ns] for ns in sorted(poses)))


def _poses(plan: RobotPlan, source: Source, raw: RawMessage, faults: ReadFaults) -> dict[int, Pose7]:
    """The poses of one path by their stamps; of several at one stamp the last."""
    topic = raw.channel.topic
    try:
        records = poses_in(source, raw)
    except RecordingError as error:
        faults.add("pose_undecodable", str(error), topic=topic)
        return {}
    poses: dict[int, Pose7] = {}
    map_frame = plan.poses.map_frame
    for record in records:
        pose = believable(record.xyz_m, record.xyzw)
        if pose is None:
            sentence = f"a pose at {record.stamp_ns / 1e9:.3f} s is not finite, or its quaternion has no length"
            faults.add("pose_invalid", sentence, topic=topic)
        elif record.frame not in ("", map_frame) and not map_frame.endswith(f"/{record.frame}"):
            sentence = f"a corrected pose lies in the frame {record.frame!r}, not in {map_frame!r}: it is left out"
            faults.add("correction_frame", sentence, topic=topic)
        else:
            poses[record.stamp_ns] = pose
    return poses
