"""Line segments: the map type, its matcher, fuser, metrics, conversions and rules; nothing is imported unasked.

Other plugins make layers of it with ``mapgraft_lines.segments.from_segments``.
"""

from __future__ import annotations

from mapgraft.contracts import SCAN, Descriptor, Register, hookimpl

LINES, GRID = "line_segments", "occupancy_grid"


@hookimpl
def register_map_types(register: Register) -> None:
    register(
        Descriptor(
            LINES,
            "mapgraft_lines.map_type:LineSegments",
            "walls as straight segments with covariance, from planar scans, grids or ready-made segments",
            observes={SCAN: 10, LINES: 50},
        )
    )


@hookimpl
def register_fusers(register: Register) -> None:
    register(
        Descriptor(
            "line_union",
            "mapgraft_lines.union:LineUnion",
            "the donor's segments beside the receiver's, linked where they lie on one wall",
            accepts=(LINES,),
        )
    )
