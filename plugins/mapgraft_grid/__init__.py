"""Occupancy grids: the map type, its matcher, fuser, metrics and rules."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mapgraft.contracts import GRID_MESSAGE, SCAN, Descriptor, Register, RegisterRules, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
_GRID = ("occupancy_grid",)
_EVIDENCE: Final = {
    "bayes_factor": ("bayes_factor:BayesFactor", "log Bayes factor: do both maps see the same, or what is unrelated?"),
    "contradiction": ("walls:Contradiction", "share of walls that stand in the other map's free space"),
    "kappa": ("walls:Kappa", "agreement of the cells beyond that of unrelated maps (Cohen's kappa)"),
    "margin": ("margin:Margin", "how far the match's score lies above that of the best other hypothesis"),
    "recall": ("walls:Recall", "share of walls that the other map has too"),
    "rays": ("traces:Rays", "share of both robots' beams that contradict the other map's walls and free space"),
    "paths": ("traces:Paths", "cells of the other map's walls that a robot drove through"),
    "posterior": ("posterior:Posterior", "probability that a match is right, from all evidence there is"),
    "news": ("news:News", "what the receiver has seen since the merge where it knew nothing before"),
}

_LAWS: Final = {"bayes_factor": ("mapgraft_grid.conformance:BayesFactorLaws",)}


@hookimpl
def register_map_types(register: Register) -> None:
    register(
        Descriptor(
            "occupancy_grid",
            "mapgraft_grid.map_type:OccupancyGrid",
            "hits and misses per cell, from planar scans or ready-made grids",
            observes={SCAN: 50, GRID_MESSAGE: 50},
        )
    )


@hookimpl
def register_matchers(register: Register) -> None:
    register(
        Descriptor(
            "carpin",
            "mapgraft_grid.carpin:Carpin",
            "Hough spectra for the rotation, axis spectra for the shift (Carpin 2008); any two resolutions",
            accepts=_GRID,
            laws=("mapgraft_grid.conformance:CarpinLaws",),
        )
    )
    register(
        Descriptor(
            "correlation",
            "mapgraft_grid.correlation:Correlation",
            "exhaustive search over rotations and shifts, walls and free space as evidence; any two resolutions",
            accepts=_GRID,
            uses_prior=True,
        )
    )


@hookimpl
def register_fusers(register: Register) -> None:
    register(
        Descriptor(
            "log_odds",
            "mapgraft_grid.log_odds:LogOdds",
            "adds the donor's log-odds 0 to 3 times, as the quality of both maps says window by window",
            accepts=_GRID,
        )
    )


@hookimpl
def register_metrics(register: Register) -> None:
    register(
        Descriptor(
            "similarity",
            "mapgraft_grid.similarity:Similarity",
            "share of equal cells among those that both maps know (the paper's SM)",
            accepts=_GRID,
        )
    )
    register(
        Descriptor(
            "distance",
            "mapgraft_grid.distance:Distance",
            "mean L1 distance between cells of the same class in both maps (the paper's modified DM)",
            accepts=_GRID,
        )
    )

    for name, what in _EVIDENCE.items():
        module, about = what
        register(
            Descriptor(
                name,
                f"mapgraft_grid.evidence.{module}",
                about,
                accepts=_GRID,
                stream=name == "news",
                laws=_LAWS.get(name, ()),
            )
        )


@hookimpl
def register_rules(register: RegisterRules) -> None:
    register("occupancy grids", (Path(__file__).parent / "rules.yaml").read_text(encoding="utf-8"))


@hookimpl
def register_formats(register: Register) -> None:
    register(
        Descriptor(
            "map_server",
            "mapgraft_grid.map_server:read",
            "grids as map_server saves them: an image and a YAML file beside it",
            accepts=(".yaml", ".yml"),
            gives=GRID_MESSAGE,
        )
    )
    register(
        Descriptor(
            "image",
            "mapgraft_grid.image_map:read",
            "grids as bare images in grays, with the side of a pixel told beside (resolution_m)",
            accepts=(".png", ".pgm", ".bmp", ".tif", ".tiff"),
            gives=GRID_MESSAGE,
        )
    )
