"""What a recording itself tells about how its robots' map frames lie in one world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mapgraft.lives import base_name
from mapgraft.recording.poses.rigid import IDENTITY, Pose7, compose, inverse
from mapgraft.recording.robots.plan import RobotPlan
from mapgraft.recording.robots.trees import tf_namespace


def known_world(plans: Sequence[RobotPlan], T_anchor_map: Mapping[str, Pose7]) -> dict[str, Pose7]:
    """``T_world_map`` of the largest group of two or more robots whose map frames hang on one frame of one recording.

    The world is that frame. ``T_anchor_map`` are the virtual robots' own map frames, seen from the recording's. Robots
    whose map frame moves in the world or begins anew, or of which nothing is known, are absent.
    """
    worlds: dict[object, dict[str, Pose7]] = {}
    begun_anew = {base_name(plan.name) for plan in plans if plan.life > 1}
    for plan in plans:
        if plan.ready_maps or base_name(plan.name) in begun_anew:
            continue
        files = tuple(g.source.path for g in plan.glimpses)
        file = plan.pose_file.source.path if plan.pose_file is not None else None
        found = _in_root(plan)
        if found is None:
            continue
        root, namespace, T_root_map = found
        anchor = T_anchor_map.get(plan.name)
        T_world_map = T_root_map if anchor is None else compose(T_root_map, inverse(anchor))
        worlds.setdefault((files if file is None else (), file, root, namespace), {})[plan.name] = T_world_map
    together = [world for world in worlds.values() if len(world) > 1]
    return max(together, key=len, default={})


def _in_root(plan: RobotPlan) -> tuple[str, tuple[str, ...], Pose7] | None:
    """The root above a robot's map frame, the namespace of the transforms that tell it, and ``T_root_map``."""
    poses = plan.poses
    if poses.method == "per_scan":
        return poses.map_frame, (), IDENTITY
    frames = poses.tree.frames
    if poses.map_frame not in frames:  # told by a topic of poses alone
        return poses.map_frame, (poses.topic.topic if poses.topic else "",), IDENTITY
    root = frames.lineage(poses.map_frame)[-1]
    T_root_map = frames.constant(root, poses.map_frame)
    if T_root_map is None:
        return None
    topics = [edge.topic for edge in (*poses.tree.other_edges, *poses.tree.own_edges) if edge.parent == root]
    return root, min((tf_namespace(topic) for topic in topics), default=()), T_root_map
