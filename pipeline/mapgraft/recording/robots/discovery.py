"""Robots without configuration: whose scans and maps a source holds, told by frames, by namespaces, or by the file."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mapgraft.contracts import GRID_MESSAGE
from mapgraft.recording.naming import (
    frame_prefix,
    is_costmap,
    robot_name,
    robot_namespace,
    told_apart,
)
from mapgraft.recording.poses.frames import roles_of
from mapgraft.recording.robots.glimpse import Glimpse, SeenPayload
from mapgraft.recording.robots.trees import tf_namespace, tree_of

_LONGEST_STEM = 80  # letters of a name before its number


@dataclass(frozen=True, slots=True)
class FoundRobot:
    """A robot as its recording shows it: its sensor payloads and ready maps, and what was passed over and why.

    ``frames`` are its sensors' frames and all above them, as far as a sample shows them.
    """

    name: str
    glimpse: Glimpse
    namespace: tuple[str, ...]
    sensors: tuple[SeenPayload, ...]
    maps: tuple[SeenPayload, ...]
    frames: frozenset[str] = frozenset()
    base_frame: str = ""
    unused: tuple[str, ...] = ()


def discover(glimpses: Sequence[Glimpse]) -> tuple[FoundRobot, ...]:
    """All robots of all sources; a name that several sources have becomes ``name@file``, one per session."""
    marks = told_apart([g.source.path for g in glimpses])
    per_source = [_robots_of(g, mark) for g, mark in zip(glimpses, marks, strict=True)]
    names = Counter(robot.name for robots in per_source for robot in robots)
    return tuple(
        replace(robot, name=f"{robot.name}@{mark}") if names[robot.name] > 1 else robot
        for robots, mark in zip(per_source, marks, strict=True)
        for robot in robots
    )


def _robots_of(g: Glimpse, mark: str) -> list[FoundRobot]:
    sensors = [seen for seen in g.payloads if seen.kind != GRID_MESSAGE]
    maps = [seen for seen in g.payloads if seen.kind == GRID_MESSAGE]
    robots = [_with_sensors(g, group) for group in _by_robot(g, sensors)]
    costs = tuple(f"{seen.topic} holds a planner's costs, not a map" for seen in maps if is_costmap(seen.topic))
    maps = [seen for seen in maps if not is_costmap(seen.topic)]
    robots, shared = _give_maps(robots, maps)
    if not robots:
        robots = [_with_maps(g, group) for group in _by_namespace(shared)]
        shared = []
    costs += tuple(f"{seen.topic} is a map of no robot in particular" for seen in shared)
    return [replace(robot, unused=(*robot.unused, *costs)) for robot in _named(mark, robots)]


_Home = tuple[str, tuple[str, ...]]  # a base frame, and the namespace of what tells of it


@dataclass(frozen=True, slots=True)
class _Body:
    """What is known about whose a sensor is: its base frame, and the namespace of the tf topic that tells it."""

    base_frame: str
    tf_namespace: tuple[str, ...]
    frames: frozenset[str]


def _body_of(g: Glimpse, seen: SeenPayload) -> _Body | None:
    namespace = robot_namespace(seen.topic)
    tree = tree_of([g], None, namespace, {seen.frame}, None)
    frames = tree.frames
    for prefix in ("", "/".join(namespace) + "/"):
        frame = prefix + seen.frame
        if frame in frames:
            roles = roles_of(frames, frame)
            lineage = frames.lineage(frame)
            path = frames.path(lineage[-1], frame) or []
            spaces = max((tf_namespace(edge.topic) for edge in path), key=len, default=())
            return _Body(roles.base_frame, spaces, frozenset(lineage))
    return None


def _by_robot(g: Glimpse, sensors: Sequence[SeenPayload]) -> list[list[tuple[SeenPayload, _Body | None]]]:
    """Sensors on one base belong to one robot; those of which no tree tells go by their topic's namespace."""
    groups: dict[_Home, list[tuple[SeenPayload, _Body | None]]] = {}
    loose: list[SeenPayload] = []
    for seen in sensors:
        body = _body_of(g, seen)
        if body is None:
            loose.append(seen)
        else:
            groups.setdefault((body.base_frame, body.tf_namespace), []).append((seen, body))
    homes = defaultdict[tuple[str, ...], set[_Home]](set)  # by namespace: a recording may have thousands of topics
    for key, group in groups.items():
        for seen, _ in group:
            homes[robot_namespace(seen.topic)].add(key)
    for seen in loose:
        namespace = robot_namespace(seen.topic)
        home = next(iter(homes[namespace])) if len(homes[namespace]) == 1 else ("", namespace)
        groups.setdefault(home, []).append((seen, None))
        homes[namespace].add(home)
    return list(groups.values())


def _with_sensors(g: Glimpse, group: Sequence[tuple[SeenPayload, _Body | None]]) -> FoundRobot:
    bodies = [body for _, body in group if body is not None]
    used, unused = _chosen([seen for seen, _ in group])
    frames = frozenset().union(*(body.frames for body in bodies)) if bodies else frozenset()
    base = bodies[0].base_frame if bodies else ""
    namespace = _shared_namespace([robot_namespace(seen.topic) for seen, _ in group])
    return FoundRobot("", g, namespace, used, (), frames, base, unused)


def _chosen(sensors: Sequence[SeenPayload]) -> tuple[tuple[SeenPayload, ...], tuple[str, ...]]:
    """One kind of payload, and one topic per sensor frame; the others with the reason why not."""
    kinds = sorted({seen.kind for seen in sensors}, key=lambda kind: (kind != "scan", kind))
    used: dict[str, SeenPayload] = {}
    unused = []
    for seen in sorted(sensors, key=lambda seen: (len(seen.topic), seen.topic)):
        if seen.kind != kinds[0]:
            unused.append(
                f"{seen.topic} holds a {seen.kind}: the robot is mapped from its {kinds[0]}s "
                f"(for the other way name it in robots.NAME.scans)"
            )
        elif seen.frame in used:
            unused.append(f"{seen.topic} is of the same sensor {seen.frame!r} as {used[seen.frame].topic}")
        else:
            used[seen.frame] = seen
    return tuple(sorted(used.values(), key=lambda seen: seen.topic)), tuple(unused)


def _shared_namespace(namespaces: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    shared = namespaces[0]
    for other in namespaces[1:]:
        n = next(
            (k for k, (a, b) in enumerate(zip(shared, other, strict=False)) if a != b), min(len(shared), len(other))
        )
        shared = shared[:n]
    return shared


def _give_maps(robots: Sequence[FoundRobot], maps: Sequence[SeenPayload]) -> tuple[list[FoundRobot], list[SeenPayload]]:
    """Give each map to the robot whose frames it is in, else to the one of its namespace, else to the only one."""
    given: dict[int, list[SeenPayload]] = {k: [] for k in range(len(robots))}
    with_frame, in_namespace = defaultdict[str, list[int]](list), defaultdict[tuple[str, ...], list[int]](list)
    for k, robot in enumerate(robots):
        in_namespace[robot.namespace].append(k)
        for frame in robot.frames:
            with_frame[frame].append(k)
    left = []
    for seen in maps:
        namespace = robot_namespace(seen.topic)
        frames = {seen.frame, "/".join((*namespace, seen.frame))}
        homes = sorted({k for frame in frames for k in with_frame.get(frame, ())})
        if len(homes) != 1:
            homes = in_namespace.get(namespace, []) if namespace else []
        if len(homes) != 1 and len(robots) == 1:
            homes = [0]
        if len(homes) == 1:
            given[homes[0]].append(seen)
        else:
            left.append(seen)
    return [_add_maps(robot, given[k]) for k, robot in enumerate(robots)], left


def _add_maps(robot: FoundRobot, maps: Sequence[SeenPayload]) -> FoundRobot:
    """The robot with the map topic of the plainest name; the others are said not to be used."""
    ordered = sorted(maps, key=lambda seen: (seen.topic.rpartition("/")[2] != "map", len(seen.topic), seen.topic))
    unused = tuple(f"{seen.topic} is another map beside {ordered[0].topic}" for seen in ordered[1:])
    return replace(robot, maps=tuple(ordered[:1]), unused=(*robot.unused, *unused))


def _by_namespace(maps: Sequence[SeenPayload]) -> list[list[SeenPayload]]:
    groups: dict[tuple[tuple[str, ...], str], list[SeenPayload]] = {}
    for seen in maps:
        groups.setdefault((robot_namespace(seen.topic), frame_prefix(seen.frame)), []).append(seen)
    return list(groups.values())


def _with_maps(g: Glimpse, maps: Sequence[SeenPayload]) -> FoundRobot:
    namespace = robot_namespace(maps[0].topic)
    return _add_maps(FoundRobot("", g, namespace, (), (), frozenset({maps[0].frame})), maps)


def _named(mark: str, robots: Sequence[FoundRobot]) -> list[FoundRobot]:
    """Names by namespace, else by the prefix of the frames, else by the file's ``mark``."""
    wishes = []
    for robot in robots:
        frame = robot.base_frame or min(robot.frames, default="")
        wishes.append((*robot.namespace[-1:], *filter(None, [frame_prefix(frame)]), mark))
    firsts = Counter(wish[0] for wish in wishes)
    taken, numbers, named = set[str](), Counter[str](), list[FoundRobot]()
    for robot, wish in zip(robots, wishes, strict=True):
        first = wish[0]
        plain = [robot_name(name) for name in (*wish, *filter(None, ["_".join(robot.namespace)]))]
        name = next((n for n in plain if n not in taken and firsts[n] == (n == first)), "")
        while not name:
            numbers[first] += 1
            numbered = f"{robot_name(first)[:_LONGEST_STEM]}_{numbers[first]}"  # a robot's name is cut where it is long
            name = numbered if numbered not in taken and not firsts[numbered] else ""
        taken.add(name)
        named.append(replace(robot, name=name))
    return named
