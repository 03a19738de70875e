"""Where a robot's poses come from: the tree of frames, the scans themselves, a topic, or another file; and why."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from mapgraft.config import PosesConfig
from mapgraft.contracts import GRID_MESSAGE, ConfigError
from mapgraft.contracts.sources import CARMEN_LASER_SCAN, CARMEN_ODOMETRY
from mapgraft.recording.decoding.poses import CARMEN_MAP, CARMEN_ODOM
from mapgraft.recording.naming import is_base, is_map, is_odom, is_wish, is_world
from mapgraft.recording.poses.frames import Drift, Frames, Roles, roles_of
from mapgraft.recording.poses.rigid import angle_of, compose, inverse
from mapgraft.recording.robots.glimpse import Glimpse, SeenPayload, SeenPoses
from mapgraft.recording.robots.trees import Tree, tree_of

PATH = "nav_msgs/msg/Path"
_NAMES_SHOWN = 10
_SAME_M, _SAME_RAD = 0.01, 0.01  # odometry that agrees with the scans' poses this well is where they come from
DRIFT_TEXT: dict[Drift, str] = {
    "corrected": "corrected poses",
    "slam": "SLAM or localization",
    "odometry": "raw odometry, the map will be smeared",
    "unknown": "of unknown quality",
    "none": "",
}


@dataclass(frozen=True, slots=True)
class PosePlan:
    """How to find the pose of each payload of one robot.

    ``tree``: look up ``map_frame`` → ``base_frame`` → sensor in the tree, where ``topic`` (if any) tells the edge above
    the base. ``per_scan``: each scan brings its own pose. ``none``: there is no way; ``text`` says why.
    ``sensors`` maps each payload topic to its frame's name in the tree. ``from_file`` tells whether ``topic`` is in the
    other file.
    """

    method: Literal["tree", "per_scan", "none"]
    drift: Drift
    text: str
    tree: Tree
    sensors: Mapping[str, str]
    map_frame: str = ""
    base_frame: str = ""
    topic: SeenPoses | None = None
    from_file: bool = False
    remarks: tuple[str, ...] = ()


def choose_poses(
    own: Sequence[Glimpse],
    other: Glimpse | None,
    payloads: Sequence[SeenPayload],
    namespace: Sequence[str],
    config: PosesConfig,
) -> PosePlan:
    """The pose source of a robot with these sensor payloads; configuration goes before everything found.

    ``other`` is the glimpse of ``config.file``. Raises ConfigError for a topic or frame that does not exist.
    """
    frames = {payload.frame for payload in payloads}
    tree = tree_of(own, other, namespace, frames, config.prefix, config.parents)
    sensors = {payload.topic: _in_tree(payload.frame, tree, namespace, config) for payload in payloads}
    ask = _Question(own, other, tuple(payloads), tree, sensors, config)
    if all(payload.kind == GRID_MESSAGE for payload in payloads):
        return _of_body(ask)
    if config.topic is not None:
        return _by_topic(ask, _configured_topic(ask, config.topic))
    if other is not None and not tree.other:
        return _by_topic(ask, _only_topic(other))
    options = _OPTIONS if other is None else _OPTIONS_WITH_FILE
    found = (plan for option in options if (plan := option(ask)) is not None)
    return next(found, PosePlan("none", "none", _why_none(ask), tree, sensors))


@dataclass(frozen=True, slots=True)
class _Question:
    own: Sequence[Glimpse]
    other: Glimpse | None
    payloads: tuple[SeenPayload, ...]
    tree: Tree
    sensors: Mapping[str, str]
    config: PosesConfig

    @property
    def topics(self) -> list[SeenPoses]:
        """Topics of poses that were reached, in the files that may tell poses."""
        glimpses = [self.other] if self.other is not None else list(self.own)
        return [seen for g in glimpses for seen in g.poses if _is_trajectory(seen)]


def _is_trajectory(seen: SeenPoses) -> bool:
    """Whether a topic tells, message by message, where a robot was: neither wishes, nor paths, nor scans with poses."""
    return not is_wish(seen.topic) and seen.channel.message_type not in (CARMEN_LASER_SCAN, PATH)


def _in_tree(frame: str, tree: Tree, namespace: Sequence[str], config: PosesConfig) -> str:
    """The sensor frame's name in the tree, which may have the robot's prefix before it."""
    frames = tree.frames
    for prefix in ("", config.prefix or "", "/".join(namespace) + "/"):
        if prefix + frame in frames:
            return prefix + frame
    return frame


def _tree_with_map(ask: _Question) -> PosePlan | None:
    plan = _tree_of_any_kind(ask)
    return plan if plan is not None and plan.drift == "slam" else None


def _tree_of_any_kind(ask: _Question) -> PosePlan | None:
    frames, config = ask.tree.frames, ask.config
    sensor = next((frame for frame in ask.sensors.values() if frame in frames), None)
    if sensor is None:
        return None
    roles = roles_of(frames, sensor)
    for name, frame in (("map_frame", config.map_frame), ("base_frame", config.base_frame)):
        if frame is not None and frame not in frames:
            known = ", ".join(frames.names()[:_NAMES_SHOWN])
            raise ConfigError(f"there is no frame {frame!r} as poses.{name} asks for: the recording has {known}")
    if config.map_frame is not None:
        drift: Drift = "odometry" if is_odom(config.map_frame) else (roles.drift if roles.map_frame else "unknown")
        roles = Roles(config.map_frame, roles.base_frame, drift)
    if not roles.map_frame:
        return None
    if ask.other is not None and not set(frames.path(roles.map_frame, sensor) or []) & set(ask.tree.other_edges):
        return None  # the other file's word would not count
    base = config.base_frame or roles.base_frame
    way = " → ".join(dict.fromkeys([roles.map_frame, *_between(ask, roles.map_frame, sensor), base, sensor]))
    where = f" of {ask.other.source.path.name}" if ask.other is not None else ""
    text = f"tf{where} ({way}): {DRIFT_TEXT[roles.drift]}"
    return PosePlan("tree", roles.drift, text, ask.tree, ask.sensors, roles.map_frame, base)


def _of_body(ask: _Question) -> PosePlan:
    """For a ready map, which needs no pose itself: where the robot's body was in it, if the tree tells."""
    frames = ask.tree.frames
    for map_frame in ask.sensors.values():
        for frame in frames.linked(map_frame) if map_frame in frames else ():
            if is_base(frame) and frames.path(map_frame, frame):
                return PosePlan("tree", "none", "", ask.tree, ask.sensors, map_frame, frame)
    return PosePlan("none", "none", "", ask.tree, ask.sensors)


def _between(ask: _Question, upper: str, lower: str) -> list[str]:
    return [edge.child for edge in ask.tree.frames.path(upper, lower) or []][:-1]


def _per_scan(ask: _Question) -> PosePlan | None:
    if not ask.payloads or any(p.channel.message_type != CARMEN_LASER_SCAN for p in ask.payloads):
        return None
    drift: Drift = "odometry" if _scans_follow_odometry(ask.own) else "corrected"
    text = f"the pose in each scan line: {DRIFT_TEXT[drift]}"
    frame = ask.payloads[0].frame
    return PosePlan("per_scan", drift, text, ask.tree, ask.sensors, CARMEN_MAP, frame)


def _scans_follow_odometry(own: Sequence[Glimpse]) -> bool:
    """Whether the scan lines have the poses of the odometry lines of their time: nobody corrected them."""
    seen = [poses for g in own for poses in g.poses]
    scans = {t.stamp_ns: pose for s in seen if s.frame == CARMEN_MAP for t, pose in zip(s.times, s.poses, strict=True)}
    lines = [s for s in seen if s.channel.message_type == CARMEN_ODOMETRY and s.frame == CARMEN_ODOM]
    moved = [
        compose(inverse(scans[t.stamp_ns]), pose)
        for s in lines
        for t, pose in zip(s.times, s.poses, strict=True)
        if t.stamp_ns in scans
    ]
    apart = [m for m in moved if math.hypot(m[0], m[1]) > _SAME_M or angle_of(m) > _SAME_RAD]
    return len(moved) > 2 and not apart


def _map_topic(ask: _Question) -> PosePlan | None:
    return _best_topic(ask, [seen for seen in ask.topics if is_map(seen.frame) or is_world(seen.frame)])


def _odometry_topic(ask: _Question) -> PosePlan | None:
    return _best_topic(ask, [seen for seen in ask.topics if seen.child or is_odom(seen.frame)])


def _any_topic(ask: _Question) -> PosePlan | None:
    return _best_topic(ask, ask.topics)


_Option = Callable[[_Question], PosePlan | None]
_OPTIONS: tuple[_Option, ...] = (
    _tree_with_map,
    _per_scan,
    _map_topic,
    _tree_of_any_kind,
    _odometry_topic,
    _any_topic,
)
_OPTIONS_WITH_FILE: tuple[_Option, ...] = (_tree_of_any_kind, _map_topic, _any_topic)


def _best_topic(ask: _Question, topics: list[SeenPoses]) -> PosePlan | None:
    """Of the topics that come often enough, the one with most messages."""
    often = [seen for seen in topics if _usual_gap_ns(seen) <= ask.config.max_gap_s * 1e9]
    if not often:
        return None
    return _by_topic(ask, min(often, key=lambda seen: (-(seen.channel.count or 0), seen.topic)))


def _usual_gap_ns(seen: SeenPoses) -> float:
    """The median time between two messages of the sample, which has holes."""
    stamps = sorted(stamped.stamp_ns for stamped in seen.times)
    gaps = sorted(b - a for a, b in pairwise(stamps))
    return float(gaps[len(gaps) // 2]) if gaps else float("inf")


def _by_topic(ask: _Question, seen: SeenPoses) -> PosePlan:
    """Poses from one topic: they replace whatever the tf tree says about the base."""
    base, unknown_mount = _base_of(ask, seen)
    map_frame = ask.config.map_frame or seen.frame or "map"
    from_file = ask.other is not None
    drift: Drift = "slam" if is_map(map_frame) or is_world(map_frame) else "odometry"
    if from_file and not seen.frame:
        drift = "unknown"
    where = seen.topic if seen.frame else "the trajectory"
    if ask.other is not None:
        where += f" in {ask.other.source.path.name}"
    if base is None:
        text = (
            f"nothing tells where the sensor {unknown_mount!r} sits on {seen.child!r}, whose poses {where} holds: say "
            f"poses.base_frame: {unknown_mount} if they are the sensor's own"
        )
        return PosePlan("none", "none", text, ask.tree, ask.sensors)
    text = f"{where} ({map_frame} → {base}): {DRIFT_TEXT[drift]}"
    remark = f"nothing tells where {base!r} is mounted: the poses of {where} are taken to be its own"
    remarks = (remark,) if unknown_mount else ()
    tree = ask.tree.without({base})
    return PosePlan("tree", drift, text, tree, ask.sensors, map_frame, base, seen, from_file, remarks)


def _base_of(ask: _Question, seen: SeenPoses) -> tuple[str | None, str]:
    """Whose poses a topic holds, and the sensor whose mount nobody tells (empty when it is told).

    Poses of a named frame that nothing links to the sensor are of no use (None); poses of nobody in particular are the
    sensor's own where there is no tree at all.
    """
    if ask.config.base_frame is not None:
        return ask.config.base_frame, ""
    frames, sensors = ask.tree.frames, list(ask.sensors.values())
    known = [frame for frame in sensors if frame in frames]
    if seen.child and (seen.child in sensors or any(seen.child in frames.linked(frame) for frame in known)):
        return seen.child, ""
    if known:
        return roles_of(frames, known[0]).base_frame, ""
    if not sensors:
        return seen.child or "base_link", ""
    return (None, sensors[0]) if seen.child else (sensors[0], sensors[0])


def _configured_topic(ask: _Question, topic: str) -> SeenPoses:
    glimpses = [ask.other] if ask.other is not None else list(ask.own)
    known = [seen for g in glimpses for seen in g.poses]
    for seen in known:
        if seen.topic == topic:
            return seen
    names = ", ".join(seen.topic for seen in known) or "none"
    where = glimpses[0].source.path.name if glimpses else "the recording"
    raise ConfigError(f"there is no topic of poses {topic!r} in {where} as poses.topic asks for: there are {names}")


def _only_topic(other: Glimpse) -> SeenPoses:
    wanted = [seen for seen in other.poses if _is_trajectory(seen)]
    if not wanted:
        raise ConfigError(f"{other.source.path.name} holds no poses, but poses.file names it: give another file")
    return min(wanted, key=lambda seen: (not is_map(seen.frame), -len(seen.times), seen.topic))


def _why_none(ask: _Question) -> str:
    """Why the poses of these payloads cannot be found, in a clause."""
    frames = ask.tree.frames
    if ask.other is not None:
        said = ", ".join(Frames(ask.tree.other_edges).names()[:_NAMES_SHOWN]) or "none"
        sensors = ", ".join(dict.fromkeys(ask.sensors.values()))
        name = ask.other.source.path.name
        return f"nothing links the sensor frame {sensors} to the frames of {name} (it has {said})"
    if not frames.names() and not ask.topics:
        return "the recording holds neither transforms nor poses; name a file that does with poses.file"
    for frame in ask.sensors.values():
        if frame not in frames:
            known = ", ".join(frames.names()[:_NAMES_SHOWN]) or "none"
            return f"no transform knows the sensor frame {frame!r} (known frames: {known})"
        root = frames.lineage(frame)[-1]
        return f"nothing links the sensor frame {frame!r} (below {root!r}) to a map or odometry frame"
    return "there is no sensor to find poses for"
