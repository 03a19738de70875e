"""Floor plans: map type, formats, conversions, matcher, fuser, metrics and rules; nothing is imported unasked."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mapgraft.contracts import GRID_MESSAGE, Descriptor, Register, RegisterRules, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
PLAN, GRID, LINES = "floor_plan", "occupancy_grid", "line_segments"
_EXTRA: Final = "floorplan"
_METRICS: Final = {
    "plan_posterior": ("PlanPosterior", "probability that a plan lies where a match puts it"),
    "plan_agreement": ("PlanAgreement", "share of the plan's walls that the robot has, of those it looked at"),
    "plan_deviations": (
        "PlanDeviations",
        "share of the plan's walls that stand elsewhere or nowhere, and each of them",
    ),
}
_TO_GRID: Final = ("PlanToGridLaws", "PlanOfUnknownScaleToGridLaws")
_TO_LINES: Final = ("PlanToLinesLaws", "PlanOfUnknownScaleToLinesLaws")


def _laws(*names: str) -> tuple[str, ...]:
    return tuple(f"mapgraft_floorplan.conformance:{name}" for name in names)


@hookimpl
def register_map_types(register: Register) -> None:
    register(
        Descriptor(
            PLAN,
            "mapgraft_floorplan.map_type:FloorPlanType",
            "walls as somebody drew them: a prior, nothing of it was observed",
            observes={PLAN: 50, GRID_MESSAGE: 5},
            laws=_laws("DrawnPlans"),
        )
    )


@hookimpl
def register_formats(register: Register) -> None:
    register(
        Descriptor(
            "plan_dxf",
            "mapgraft_floorplan.dxf_file:read",
            "plans from CAD: the lines of the model space, of all layers or of some",
            accepts=(".dxf",),
            gives=PLAN,
            requires=("ezdxf",),
            extra=_EXTRA,
        )
    )
    register(
        Descriptor(
            "plan_svg",
            "mapgraft_floorplan.svg_file:read",
            "plans as drawings: lines and outlines, with transforms",
            accepts=(".svg",),
            gives=PLAN,
            requires=("svgelements",),
            extra=_EXTRA,
        )
    )
    register(
        Descriptor(
            "plan_image",
            "mapgraft_floorplan.raster_file:read",
            "plans as images whose dark pixels are walls, with or without a known scale, or as map_server has them",
            accepts=tuple(f".plan{suffix}" for suffix in (".png", ".pgm", ".bmp", ".tif", ".tiff", ".yaml", ".yml")),
            gives=PLAN,
        )
    )


@hookimpl
def register_conversions(register: Register) -> None:
    for target, factory, what, laws in (
        (GRID, "grid_conversion:PlanToGrid", "walls drawn as occupied, rooms as free, all else unknown", _TO_GRID),
        (LINES, "lines_conversion:PlanToLines", "walls as segments seen once; nothing is free", _TO_LINES),
    ):
        name = f"{PLAN}_to_{target}"
        made = f"mapgraft_floorplan.{factory}"
        register(Descriptor(name, made, what, accepts=(PLAN,), gives=target, laws=_laws(*laws)))


@hookimpl
def register_matchers(register: Register) -> None:
    register(
        Descriptor(
            "plan_correlation",
            "mapgraft_floorplan.matcher:PlanCorrelation",
            "search over rotations, shifts and, where it is unknown, the scale of a plan on a robot's map",
            accepts=(GRID,),
            uses_prior=True,
        )
    )


@hookimpl
def register_fusers(register: Register) -> None:
    register(
        Descriptor(
            "plan_prior",
            "mapgraft_floorplan.prior_fuser:PlanPrior",
            "a plan as a prior: bounded log-odds that a few observations override, never an observation",
            laws=_laws("PriorsInGrids", "PriorsInLines"),
        )
    )


@hookimpl
def register_metrics(register: Register) -> None:
    for name, (what, about) in _METRICS.items():
        register(Descriptor(name, f"mapgraft_floorplan.metrics:{what}", about, accepts=(GRID,)))


@hookimpl
def register_rules(register: RegisterRules) -> None:
    register("floor plans", (Path(__file__).parent / "rules.yaml").read_text(encoding="utf-8"))
