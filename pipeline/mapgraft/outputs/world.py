"""Where every robot's map frame lies in the common frame ``world``, so that a viewer can show all maps at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mapgraft.contracts import Transform
from mapgraft.outputs.standing import StandingMerge, chains_from, components

Box = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max in metres

GAP_M = 5.0  # between components, at least; half of a wide one's width, so that it can grow before it has to move
ROOM_M = 10.0  # to every side of a robot of which nothing is known yet


def lay_out(
    previous: Mapping[str, Transform], boxes_m: Mapping[str, Box | None], merges: Sequence[StandingMerge]
) -> dict[str, Transform]:
    """``T_world_map`` of every robot in ``boxes_m``, connected by merges or not.

    A robot that is connected lies where the chain of standing merges puts it, seen from the reference of its
    component, the robot whose name sorts first. The components stand side by side along x. The first one is never
    moved, a further one only when it would cover another one or was turned by a merge that stands no more: frames do
    not jump while maps grow. ``boxes_m`` are in the robots' own map frames, None where nothing is known.
    """
    parts = components(boxes_m, merges)
    inside = {part: chains_from(part[0], merges) for part in parts}
    boxes = {
        part: _united([_moved(chain.T_target_source, chain.scale, boxes_m.get(name)) for name, chain in chains.items()])
        for part, chains in inside.items()
    }
    references = _kept(previous, parts, boxes)
    right = max((placed_box(T, boxes[part])[2] for part, T in references.items()), default=0.0)
    for part in parts:
        if part not in references:
            box = boxes[part]
            left = right + max(GAP_M, (box[2] - box[0]) / 2.0)
            references[part] = Transform.planar(left - box[0], 0.0, 0.0)
            right = left + box[2] - box[0]
    return {
        name: references[part] @ chain.T_target_source for part in parts for name, chain in sorted(inside[part].items())
    }


def grown(box: Box | None, other: Box | None) -> Box | None:
    """The smallest box around both; None is no box."""
    if box is None or other is None:
        return box or other
    return _united([box, other])


def placed_box(T: Transform, box: Box | None) -> Box:
    """The upright box around a box that was moved by T; around some room when the box is not known."""
    return _moved(T, 1.0, box)


def _kept(
    previous: Mapping[str, Transform], parts: Sequence[tuple[str, ...]], boxes: Mapping[tuple[str, ...], Box]
) -> dict[tuple[str, ...], Transform]:
    """The components that stay where they are, with ``T_world_map`` of their references."""
    kept: dict[tuple[str, ...], Transform] = {}
    for part in parts:
        T = previous.get(part[0])
        if part is parts[0]:
            kept[part] = T if T is not None else Transform.identity()
        elif T is not None and (T.matrix[:3, :3] == np.eye(3)).all():
            box = placed_box(T, boxes[part])
            if not any(_covers(box, placed_box(other, boxes[name])) for name, other in kept.items()):
                kept[part] = T
    return kept


def _moved(T: Transform, scale: float, box: Box | None) -> Box:
    x0, y0, x1, y1 = box if box is not None else (-ROOM_M, -ROOM_M, ROOM_M, ROOM_M)
    corners = T.apply(scale * np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x0, y1, 0.0], [x1, y1, 0.0]]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _united(boxes: Sequence[Box]) -> Box:
    x0, y0, x1, y1 = zip(*boxes, strict=True)
    return min(x0), min(y0), max(x1), max(y1)


def _covers(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
