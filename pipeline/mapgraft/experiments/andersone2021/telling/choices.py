"""What the paper leaves open, and what was chosen: stated with every result."""

from __future__ import annotations

from dataclasses import dataclass

from mapgraft.evaluation.drawing import APART_NS, APART_SCANS
from mapgraft.evaluation.truth import RIGHT_DEG, RIGHT_M
from mapgraft.experiments.andersone2021.keeping import ROUNDS
from mapgraft.experiments.andersone2021.outcome import Experiment
from mapgraft.experiments.andersone2021.raster import FREE_TO, OCCUPIED_FROM
from mapgraft.experiments.andersone2021.telling.grounds import ENOUGH, LITTLE, MUCH, TRACES


@dataclass(frozen=True, slots=True)
class Choice:
    """Where the paper is silent or can be read in several ways, and what is done here."""

    about: str
    chosen: str


_CARPIN = Choice(
    "Carpin's matcher",
    "Hough spectra of both maps give rotations (4 hypotheses, each also 1° to either side), X- and Y-spectra the "
    "shifts (40 peaks per axis; the original takes one); at least a tenth of the smaller map must overlap.",
)


_CRITERIA = Choice(
    "what is little, similar, insignificant",
    f"The paper gives no numbers. For us ranges overlap little when at most {100 * LITTLE:g} % of the merges lie in "
    f"the range of both kinds, and are very similar from {100 * MUCH:g} % on; what a revert leaves is insignificant "
    f"below {100 * TRACES:g} % of the known cells; DM is about the same in one unit when it is closer "
    f"together there than in the other. With fewer than {ENOUGH} merges of a kind in a group (of all "
    "together: different draws) nothing is judged.",
)


def choices(experiment: Experiment) -> list[Choice]:
    """Every choice that somebody who repeats the paper would have to make, too."""
    matcher = [_CARPIN] if experiment.matcher == "carpin" else []
    return [*_of_the_pairs(experiment), *matcher, *_of_the_maps(), *_of_the_metrics(), *_of_the_costs(), _CRITERIA]


def _of_the_pairs(experiment: Experiment) -> list[Choice]:
    settings = experiment.settings
    apart = f"{APART_SCANS} scans or {APART_NS // 1_000_000_000} s"
    return [
        Choice(
            "when a merge is right",
            f"The donor's walls lie at most {RIGHT_M:g} m off on average, and at most {RIGHT_DEG:g}° turned, by the "
            "recording's own poses.",
        ),
        Choice(
            "which pairs",
            f"Two windows of {settings.scans} scans of one recording, drawn at random by seed {settings.seed}; "
            f"{settings.further} further scans of the receiver follow. Between the two lie at least {apart}. The same "
            "pairs are tried with every combination of resolutions, in the same order, and the first right and wrong "
            "ones that are accepted are kept. Pairs that share nothing are drawn, too: the table of what was drawn "
            "tells how much right and wrong merges share.",
        ),
        Choice(
            "where the map frames lie",
            "Each map has the frame of its first scan, turned at random: a matcher that stays near the identity finds "
            "nothing.",
        ),
        Choice(
            "acceptance",
            f"The first hypothesis of {experiment.matcher} with SM ≥ {experiment.similarity_min:g}; SM is measured "
            "between the receiver's own map and the donor's.",
        ),
    ]


def _of_the_maps() -> list[Choice]:
    return [
        Choice(
            "maps of different resolution",
            "The donor's cells are placed in the receiver's grid by their evidence, at the transform in fixed point. "
            "The receiver's grid is the unit of everything that is counted.",
        ),
        Choice(
            "how often the donor is applied",
            "0 to 3 times, by the difference of both maps' quality in windows of 2 m (our own estimate of quality, fit "
            "on simulated maps; the paper's is a neural network). Where it is applied 0 times it still fills what the "
            "receiver does not know.",
        ),
        Choice(
            "free, occupied, unknown",
            f"As map_server reads a map: occupied above a probability of 0.65, free below 0.196 ({OCCUPIED_FROM} and "
            f"{FREE_TO} % on its scale), unknown between.",
        ),
        Choice(
            "discarding the donor from a single map",
            "Cells that the donor changed and the robot has not updated itself, at any time, become unknown.",
        ),
    ]


def _of_the_metrics() -> list[Choice]:
    return [
        Choice(
            "DM",
            "In cells of the receiver's grid; both directions and both classes are summed (the paper's numbers fit "
            "that, not the mean). Cells that both maps know are measured; the nearest cell of the same class may lie "
            "anywhere in the other map.",
        ),
        Choice(
            "maps that share too little",
            "With less than 1 m² in common, or without a free or an occupied cell, a metric has no value, and the "
            "merge is left out of its average; tables say how many.",
        ),
        Choice(
            "further mapping",
            "The receiver alone goes on; the donor's map stays as it was at the merge. Poses are the recording's, so "
            "that a wrong merge cannot lead the robot astray.",
        ),
    ]


def _of_the_costs() -> list[Choice]:
    return [
        Choice(
            "what an update is",
            "Bringing the evidence of a scan in, and bringing the map up to date that the robot plans with. With two "
            "maps that is both maps' evidence and the merged map; their second map is made when metrics look at it, "
            "which is told separately.",
        ),
        Choice(
            "timing",
            "All ways of keeping a merge take turns on the same scans of the same pair, each scan beginning with "
            f"another one; of {ROUNDS} rounds the quickest counts. Metrics and verifiers are not timed.",
        ),
        Choice(
            "the ledger",
            "Keeps the receiver's and the donor's evidence apart and adds them where somebody looks. It is not in the "
            "paper.",
        ),
    ]
