"""Floor plans of buildings as somebody may have drawn them: walls only, some of them wrong."""

from __future__ import annotations

import math

import numpy as np

from mapgraft_recordings.buildings.building import Building
from mapgraft_recordings.buildings.shapes import Outline, Segments, edges, turned

_SALT = 0xF1A7
_MISSING = 0.04  # share of the walls that were built after the plan was drawn
_ADDED = 0.02  # share of walls that were drawn and not built, of those that were
_MOVED = 0.08  # share of the walls that stand elsewhere than they were drawn
_MOVED_M = 0.25
_STRETCH = 0.006  # how much longer one side of the drawing is
_SKIPPED_M = 0.35  # smaller pieces (door frames, pilasters) are not drawn


def plan_of(building: Building, seed: int) -> Segments:
    """The walls (m, 4) as drawn, in the building's frame: no furniture, no door leaves, glass as walls.

    Of the walls 4 % are missing, 8 % lie up to a quarter of a metre off, 2 % stand only in the plan, and the whole is
    stretched by some tenths of a percent. The same building and seed give the same plan.
    """
    rng = np.random.default_rng(np.random.SeedSequence([building.seed, seed, _SALT]))
    drawn = []
    panes = [np.array([[x0, y0], [x1, y1]]) for x0, y0, x1, y1 in building.glass]
    for outline in (*building.walls, *panes):
        if np.ptp(outline, axis=0).max() < _SKIPPED_M or rng.random() < _MISSING:
            continue
        if rng.random() < _MOVED:
            outline = outline + rng.uniform(-_MOVED_M, _MOVED_M) * _across(outline)
        drawn.append(outline)
        if rng.random() < _ADDED:
            drawn.append(turned(outline - outline.mean(axis=0), math.pi / 2) + outline.mean(axis=0))
    stretch = 1.0 + _STRETCH * rng.uniform(-1.0, 1.0, 2)
    middle = np.vstack(drawn).mean(axis=0)
    return edges((outline - middle) * stretch + middle for outline in drawn)


def _across(outline: Outline) -> np.ndarray:
    """The unit vector across the longer side of an outline."""
    centred = outline - outline.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    across: np.ndarray = vectors[:, 0]
    return across
