"""What a robot tells of a little room: ready observations of every kind that comes with mapgraft."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mapgraft.contracts import CLOUD, CLOUD_MAP, GRID_MESSAGE, SCAN, Observation, Transform
from mapgraft.testing.clouds import look_around, points_of, raised
from mapgraft.testing.rooms import Room, look, ready_made

PERIOD_NS: Final = 100_000_000
_SIGHT_M: Final = 3.2  # of the first of several ready-made maps, and a metre more of each other: all see a wall

_Seen = tuple[object, Transform]  # the payload, and T_room_sensor
_SEEN: Final[dict[str, Callable[[Room, float, float, float, int], _Seen]]] = {
    SCAN: lambda room, x, y, yaw, step: (look(room, x, y, yaw), Transform.planar(x, y, yaw)),
    CLOUD: lambda room, x, y, yaw, step: (look_around(room, x, y, yaw), raised(Transform.planar(x, y, yaw))),
    GRID_MESSAGE: lambda room, x, y, yaw, step: (ready_made(room, x, y, _SIGHT_M + step), Transform.identity()),
    CLOUD_MAP: lambda room, x, y, yaw, step: (points_of(room, x, y, _SIGHT_M + step), Transform.identity()),
}
READY_KINDS: Final = tuple(_SEEN)
"""Kinds of observations that the kit can make by itself."""
SPATIAL_KINDS: Final = frozenset({CLOUD, CLOUD_MAP})
"""Those of them that tell heights."""


def observe(
    kind: str, room: Room, poses: list[tuple[float, float, float]], T_map_room: Transform, robot: str
) -> tuple[Observation, ...]:
    """What a robot sees from these poses (x, y, yaw) in the room, told in its own map frame."""
    made = []
    for step, (x, y, yaw) in enumerate(poses):
        payload, T_room_sensor = _SEEN[kind](room, x, y, yaw, step)
        T_map_base = T_map_room @ Transform.planar(x, y, yaw)
        stamp_ns = (step + 1) * PERIOD_NS
        T_map_sensor = T_map_room @ T_room_sensor
        made.append(Observation(robot, stamp_ns, stamp_ns, "sensor", kind, payload, T_map_sensor, T_map_base))
    return tuple(made)
