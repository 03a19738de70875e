"""Maps of point landmarks for mapgraft: what is offered, and where it is; nothing is imported before it is used."""

from __future__ import annotations

from importlib import resources

from mapgraft.contracts import SCAN, Descriptor, Register, RegisterRules, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
LANDMARKS, GRID = "point_landmarks", "occupancy_grid"


@hookimpl
def register_map_types(register: Register) -> None:
    register(
        Descriptor(
            LANDMARKS,
            "mapgraft_landmarks.map_type:PointLandmarks",
            "poles, columns and trunks in planar scans, as counted sightings",
            observes={SCAN: 1},
        )
    )


@hookimpl
def register_matchers(register: Register) -> None:
    register(
        Descriptor(
            "constellation",
            "mapgraft_landmarks.constellation:Constellation",
            "pairs of landmarks of equal distance vote for a pose",
            accepts=(LANDMARKS,),
        )
    )


@hookimpl
def register_fusers(register: Register) -> None:
    register(
        Descriptor(
            "landmark_union",
            "mapgraft_landmarks.union:LandmarkUnion",
            "the donor's sightings beside the receiver's",
            accepts=(LANDMARKS,),
        )
    )


@hookimpl
def register_metrics(register: Register) -> None:
    register(
        Descriptor(
            "landmark_agreement",
            "mapgraft_landmarks.agreement:LandmarkAgreement",
            "share of the landmarks in the jointly seen place that both maps have",
            accepts=(LANDMARKS,),
        )
    )


@hookimpl
def register_conversions(register: Register) -> None:
    register(
        Descriptor(
            "point_landmarks_to_occupancy_grid",
            "mapgraft_landmarks.grid_conversion:GridConversion",
            "sightings become hits, looks become misses",
            accepts=(LANDMARKS,),
            gives=GRID,
            requires=("mapgraft_grid",),
        )
    )


@hookimpl
def register_rules(register: RegisterRules) -> None:
    rules = resources.files("mapgraft_landmarks") / "rules.yaml"
    register("landmarks", rules.read_text(encoding="utf-8"))
