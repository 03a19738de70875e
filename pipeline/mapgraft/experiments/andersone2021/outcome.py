"""What comes of the experiment, in plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mapgraft.config import ReversalName
from mapgraft.contracts import Exactness, Transform
from mapgraft.evaluation.drawing import PairPlan
from mapgraft.evaluation.statistics import Better
from mapgraft.experiments.andersone2021.settings import Combination, Settings

Numbers = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Cost:
    """What the further scans took together, in seconds: each scan is the quickest of several rounds.

    ``update_s`` is bringing the evidence in, ``view_s`` making the robot's map of it where something was touched, and
    ``compared_s`` making the map that metrics look at, where that is another one.
    """

    update_s: float
    view_s: float
    compared_s: float

    @property
    def mapped_s(self) -> float:
        """Updating with the map that the robot uses."""
        return self.update_s + self.view_s


@dataclass(frozen=True, slots=True)
class Leftovers:
    """A robot's map after the revert, held cell by cell against that of a robot that never merged.

    ``known`` are the cells that the latter knows; ``lost`` those of them that are unknown after the revert; ``alien``
    cells that are known after the revert and would not be; ``changed`` those that became free instead of occupied or
    the reverse; ``touched`` those of which either map shows another probability, all the former included. The map is
    ``identical`` when its layer has the very same bytes.
    """

    known: int
    lost: int
    alien: int
    changed: int
    touched: int
    identical: bool


@dataclass(frozen=True, slots=True)
class Kept:
    """How one way of keeping a merge did: the metrics right after the merge and after the further scans, by name.

    A detail of a metric is named ``metric.detail``. ``exactness`` is what the reversal itself says of its revert.
    """

    strategy: ReversalName
    initial: Numbers
    end: Numbers
    cost: Cost
    exactness: Exactness
    revert_s: float
    leftovers: Leftovers


@dataclass(frozen=True, slots=True)
class Watched:
    """What our own rules would have seen of the merge: the evidence at the merge and after the further scans.

    ``action`` is their verifier's last word, ``reason`` why. All empty where they would not have looked.
    """

    rule: str
    action: str
    reason: str
    initial: Numbers
    end: Numbers


@dataclass(frozen=True, slots=True, eq=False)
class Merge:
    """One accepted merge; ``number`` says which draw it was, ``error_m`` and ``error_deg`` how far it is off."""

    combination: Combination
    number: int
    plan: PairPlan
    right: bool
    overlap: float
    error_m: float
    error_deg: float
    T_receiver_donor: Transform
    score: float
    by: Mapping[ReversalName, Kept]
    watched: Watched

    @property
    def name(self) -> str:
        return f"{self.combination.name}/{self.number}"


@dataclass(frozen=True, slots=True)
class Search:
    """How many pairs were drawn for a combination, and what became of them.

    ``right`` and ``wrong`` count what was accepted, also beyond what was asked for, ``refused`` what the rule did not
    accept, ``unmatched`` pairs without any hypothesis.
    """

    combination: Combination
    drawn: int
    right: int
    wrong: int
    refused: int
    unmatched: int


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """Everything that came of it. ``better`` says which way each of our rules' numbers should go, where it is known.

    ``remarks`` are sentences about what is doubtful or could not be had. ``matcher`` and ``similarity_min`` are what
    the merges rest on.
    """

    settings: Settings
    matcher: str
    similarity_min: float
    merges: Sequence[Merge]
    searches: Sequence[Search]
    better: Mapping[str, Better]
    remarks: Sequence[str]
    elapsed_s: float
