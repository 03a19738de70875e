"""How score, margin, SM and DM of Carpin's best hypothesis lie for right and wrong ones, on simulated maps.

    python tests/bench/choose_limits.py

Two robots map one floor, or two different floors, each in a frame of its own. Right is a hypothesis within 0.5 m and
5 degrees of the truth. Printed are what the default decision table says, quantiles (0, 5, 25, 50, 75, 95, 100 %) when
the receiver is half way, and how the same transform measures when it is done.
"""

from __future__ import annotations

import math

import numpy as np
from simulated_missions import in_frame, map_of, missions

from mapgraft.comparison import Compared
from mapgraft.contracts import Candidate, Match, Measurement, Step, Transform
from mapgraft.decision import parse_rules
from mapgraft_grid.carpin import Carpin
from mapgraft_grid.distance import Distance
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.quality import MODEL_FILE
from mapgraft_grid.similarity import Similarity
from mapgraft_standard.acceptance import Thresholds

SEED, WORLDS = 20_260_103, 60
RESOLUTIONS_M = ((0.05, 0.05), (0.07, 0.07), (0.07, 0.1), (0.1, 0.07), (0.05, 0.1))
RIGHT_M, RIGHT_RAD = 0.5, math.radians(5.0)


def candidate(grids: OccupancyGrid, layer: GridLayer, own: GridMap, donor: GridLayer, match: Match) -> Candidate:
    T = match.T_receiver_donor.snapped()
    placed = grids.place(donor, T)
    compared = Compared(grids, "own", T, match, placed, lambda: (layer, own))
    measured: list[Measurement] = [m.track(compared).update(Step()) for m in (Similarity(), Distance())]
    return Candidate(match, {m.name: m for m in measured})


def numbers_of(best: Candidate, own_m: float) -> list[float]:
    similarity, distance = best.measurements["similarity"], best.measurements["distance"]
    return [
        best.match.score,
        best.match.margin,
        similarity.value,
        distance.value / distance.details["limit"],
        similarity.details["overlap_m2"],
        similarity.details["occupied_agreement"] * own_m,
    ]


NAMES = ("score", "margin", "similarity", "distance/limit", "overlap m2", "equal wall m")
LATER = ("similarity, later", "distance/limit, later", "growth of support")


def main() -> None:
    table = {rule.name: rule for rule in parse_rules((MODEL_FILE.parent / "rules.yaml").read_text(), "of the package")}
    acceptor = Thresholds(**table["grids of any resolution"].procedure.accept.parameters)
    rows: dict[str, list[list[float]]] = {"right": [], "wrong": [], "unrelated": []}
    verdicts: dict[str, dict[str, int]] = {kind: {} for kind in rows}
    for number in range(WORLDS):
        rng = np.random.default_rng([SEED, number])
        scans = int(rng.integers(60, 200))
        own_scans, donor_scans = missions(rng, 2, scans)
        strange = missions(rng, 1, scans)[0]
        own_m, donor_m = RESOLUTIONS_M[number % len(RESOLUTIONS_M)]
        T_world_donor = Transform.planar(*rng.uniform(-5, 5, 2).tolist(), rng.uniform(-math.pi, math.pi))
        grids, layer, own = map_of(own_scans[: scans // 2], own_m)
        _, layer_later, own_later = map_of(own_scans, own_m)
        for related, theirs in ((True, donor_scans), (False, strange)):
            _, donor, view = map_of(in_frame(T_world_donor.inverse(), theirs), donor_m)
            made = [candidate(grids, layer, own, donor, match) for match in Carpin().match(own, view)]
            if not made:
                continue
            best = made[0]
            kind = _kind(best.match.T_receiver_donor, T_world_donor, donor_scans) if related else "unrelated"
            later = candidate(grids, layer_later, own_later, donor, best.match).measurements
            growth = later["similarity"].support / best.measurements["similarity"].support - 1.0
            ratio = later["distance"].value / later["distance"].details["limit"]
            rows[kind].append([*numbers_of(best, own_m), later["similarity"].value, ratio, growth])
            verdict = acceptor.accept(made).verdict
            verdicts[kind][verdict] = verdicts[kind].get(verdict, 0) + 1
    for kind, values in rows.items():
        print(f"{kind}: {len(values)}, verdicts {verdicts[kind]}")
        for name, column in zip((*NAMES, *LATER), np.array(values).T, strict=True):
            quantiles = np.nanquantile(np.minimum(column, 1e6), [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0])
            print(f"  {name:22}", " ".join(f"{q:9.3g}" for q in quantiles))


def _kind(found: Transform, truth: Transform, scans: list) -> str:
    spots = np.array([o.T_map_base.matrix[:2, 3] for o in scans])
    here = truth.inverse().apply(spots)
    off = np.hypot(*(found.apply(here) - spots).T).mean()
    turn = abs(math.remainder(found.yaw_rad - truth.yaw_rad, 2 * math.pi))
    return "right" if off <= RIGHT_M and turn <= RIGHT_RAD else "wrong"


if __name__ == "__main__":
    main()
