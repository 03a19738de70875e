"""How far raw odometry and corrected poses drift apart where a recording holds both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapgraft.config import PosesConfig
from mapgraft.contracts.sources import CARMEN_ODOMETRY
from mapgraft.recording.decoding.poses import CARMEN_ODOM
from mapgraft.recording.naming import is_odom, robot_namespace
from mapgraft.recording.poses.frames import Drift
from mapgraft.recording.poses.rigid import Pose7, angle_of, compose, inverse
from mapgraft.recording.robots.choice import PosePlan, choose_poses
from mapgraft.recording.robots.clocks import times_of
from mapgraft.recording.robots.plan import RobotPlan

SEGMENT_M = 10.0
_STEP_M = 0.05  # shorter steps are noise, not path

SMEAR_TEXT: dict[Drift, str] = {
    "corrected": "corrected poses: walls as sharp as the correction left them",
    "slam": "poses of SLAM or localization: walls as sharp as its own map",
    "odometry": "raw odometry: its error grows with the path, so walls seen again come out double",
    "unknown": "poses of unknown quality",
    "none": "a ready map: as sharp as it was made",
}


@dataclass(frozen=True, slots=True)
class Disagreement:
    """How far odometry and corrected poses of the same times disagree over pieces of path of ten metres.

    Medians and worst values over ``segments`` pieces, in metres and degrees per ten metres.
    """

    segments: int
    median_m: float
    worst_m: float
    median_deg: float
    worst_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Where a robot's base was: ``stamps_ns`` (n,) rising, and its poses in one frame."""

    stamps_ns: NDArray[np.int64]
    poses: Sequence[Pose7]

    @property
    def path_m(self) -> NDArray[np.float64]:
        """(n,) the length of the path up to each pose."""
        lengths, total, last = [], 0.0, self.poses[0] if self.poses else None
        for pose in self.poses:
            if last is not None and (step := math.hypot(pose[0] - last[0], pose[1] - last[1])) >= _STEP_M:
                total, last = total + step, pose
            lengths.append(total)
        return np.array(lengths)


def odometry_plan(plan: RobotPlan) -> RobotPlan | None:
    """The plan that reads the same payloads with raw odometry, None where there is none beside the poses used."""
    if plan.ready_maps or plan.poses.drift not in ("slam", "corrected", "unknown"):
        return None
    poses = _odometry_in_tree(plan) or _odometry_beside(plan)
    if poses is None:
        return None
    return replace(
        plan,
        poses=poses,
        pose_file=plan.pose_file if poses.tree.other else None,
        times=times_of(plan.glimpses, plan.payloads, poses, plan.times.wanted),
        anchored=False,
    )


def _odometry_in_tree(plan: RobotPlan) -> PosePlan | None:
    """The odometry below the map frame of the same tree."""
    poses = plan.poses
    if poses.method != "tree" or poses.topic is not None:
        return None
    path = poses.tree.frames.path(poses.map_frame, poses.base_frame) or []
    odom = next((edge.child for edge in path if is_odom(edge.child) and edge.child != poses.base_frame), None)
    return None if odom is None else replace(poses, map_frame=odom, drift="odometry")


def _odometry_beside(plan: RobotPlan) -> PosePlan | None:
    """Odometry elsewhere in the robot's own files: CARMEN's lines, another tree, or a topic."""
    seen = [poses for g in plan.glimpses for poses in g.poses]
    lines = next((s for s in seen if s.channel.message_type == CARMEN_ODOMETRY and s.frame == CARMEN_ODOM), None)
    if plan.poses.method == "per_scan":
        if lines is None:
            return None
        base = lines.child or "base_link"
        sensors = dict.fromkeys(plan.poses.sensors, base)  # the mount does not matter for how two paths disagree
        return PosePlan("tree", "odometry", "", plan.poses.tree, sensors, CARMEN_ODOM, base, lines)
    config = PosesConfig(max_gap_s=plan.max_gap_ns / 1e9)
    namespace = robot_namespace(plan.payloads[0].topic)
    poses = choose_poses(plan.glimpses, None, plan.payloads, namespace, config)
    return poses if poses.method == "tree" and poses.drift == "odometry" else None


def disagreement(corrected: Track, odometry: Track) -> Disagreement | None:
    """Compare both tracks at their common stamps over pieces of ten metres; None when the path is shorter.

    The error of a piece is what is left of the one relative motion after taking off the other.
    """
    stamps, in_corrected, in_odometry = np.intersect1d(
        corrected.stamps_ns, odometry.stamps_ns, assume_unique=False, return_indices=True
    )
    track = Track(stamps, [corrected.poses[k] for k in in_corrected])
    other = [odometry.poses[k] for k in in_odometry]
    lengths = track.path_m
    errors: list[tuple[float, float]] = []
    start = 0
    while start < len(stamps):
        end = int(np.searchsorted(lengths, lengths[start] + SEGMENT_M))
        if end >= len(stamps):
            break
        moved = compose(inverse(track.poses[start]), track.poses[end])
        said = compose(inverse(other[start]), other[end])
        left = compose(inverse(moved), said)
        scale = SEGMENT_M / (lengths[end] - lengths[start])
        errors.append((math.hypot(left[0], left[1]) * scale, math.degrees(angle_of(left)) * scale))
        start = int(np.searchsorted(lengths, lengths[start] + SEGMENT_M / 2))
    if not errors:
        return None
    metres, degrees = np.array(errors).T
    return Disagreement(
        len(errors), float(np.median(metres)), float(metres.max()), float(np.median(degrees)), float(degrees.max())
    )
