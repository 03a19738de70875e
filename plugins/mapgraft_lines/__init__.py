"""Line segments: the map type, its matcher, fuser, metrics, conversions and rules; nothing is imported unasked.

Other plugins make layers of it with ``mapgraft_lines.segments.from_segments``.
"""

from __future__ import annotations

from pathlib import Path

from mapgraft.contracts import SCAN, Descriptor, Register, RegisterRules, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
LINES, GRID = "line_segments", "occupancy_grid"
_METRICS = {
    "line_explained": ("walls:Explained", "share of the jointly known walls that both maps have"),
    "line_contradiction": ("walls:Contradiction", "share of walls that stand in the other map's free space"),
    "line_residual": ("walls:Residual", "how far walls are off those of the other map, in metres"),
    "line_posterior": ("posterior:LinePosterior", "probability that a match is right, from walls and free space"),
    "line_news": ("news:News", "what both maps have come to know of each other since the merge"),
}


def _laws(*names: str) -> tuple[str, ...]:
    return tuple(f"mapgraft_lines.conformance:{name}" for name in names)


@hookimpl
def register_map_types(register: Register) -> None:
    register(
        Descriptor(
            LINES,
            "mapgraft_lines.map_type:LineSegments",
            "walls as straight segments with covariance, from planar scans, grids or ready-made segments",
            observes={SCAN: 10, LINES: 50},
            laws=_laws("ScannedLines", "ReadySegments"),
        )
    )


@hookimpl
def register_matchers(register: Register) -> None:
    register(
        Descriptor(
            "line_association",
            "mapgraft_lines.line_association:LineAssociation",
            "pairs of walls vote for rotation and shift; explained length against walls in free space",
            accepts=(LINES,),
            uses_prior=True,
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


@hookimpl
def register_metrics(register: Register) -> None:
    for name, (where, what) in _METRICS.items():
        factory, stream = f"mapgraft_lines.evidence.{where}", name == "line_news"
        register(Descriptor(name, factory, what, accepts=(LINES,), stream=stream))


@hookimpl
def register_conversions(register: Register) -> None:
    register(
        Descriptor(
            "line_segments_to_occupancy_grid",
            "mapgraft_lines.lines_to_grid:LinesToGrid",
            "walls drawn as hits, free space as misses",
            accepts=(LINES,),
            gives=GRID,
            laws=_laws("LinesToGridLaws"),
        )
    )
    register(
        Descriptor(
            "occupancy_grid_to_line_segments",
            "mapgraft_lines.grid_to_lines:GridToLines",
            "occupied cells that lie on lines, and free space",
            accepts=(GRID,),
            gives=LINES,
            laws=_laws("GridToLinesLaws"),
        )
    )


@hookimpl
def register_formats(register: Register) -> None:
    register(
        Descriptor(
            "lines_geojson",
            "mapgraft_lines.geojson_file:read",
            "walls as lines in metres, with free space where the file has it (GeoJSON)",
            accepts=(".geojson",),
            gives=LINES,
        )
    )


@hookimpl
def register_rules(register: RegisterRules) -> None:
    register("line segments", (Path(__file__).parent / "rules.yaml").read_text(encoding="utf-8"))
