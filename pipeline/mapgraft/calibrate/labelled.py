"""Examples as thresholds see them: numbers of the first hypothesis, whether it is right, and what was seen later."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from mapgraft.calibrate.groups import Group, told
from mapgraft.calibrate.units import UNIT_COLUMNS, Unit, unit_of
from mapgraft.errors import UsageError
from mapgraft.examples.reading import ExampleFolder, ExampleKey, last_words_on, plain

By = Literal["truth", "persons", ""]
HELD_BACK: Final = "test"  # the split that nothing is ever fitted on
BOTH: Final = "+"  # between the names of two buildings
_COLUMNS: Final = (
    *UNIT_COLUMNS,
    *("split", "environment", "receiver_type", "donor_type", "receiver_resolution_m", "donor_resolution_m"),
    *("receiver_quality", "donor_quality", "reversal", "rule", "matcher", "verdict", "state", "chosen", "evidence"),
    *("rivals", "history", "truth", "truth_final", "overlap", "truth_overlap"),
)


@dataclass(frozen=True, slots=True)
class Look:
    """What verification measured anew at one time, by name; ``observations`` are those of the receiver since the merge.

    What is not told was not measured again: it is as it was.
    """

    observations: int
    numbers: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Labelled:
    """One attempt that had a hypothesis.

    ``numbers`` are those of the matcher's first hypothesis, and ``right`` says whether that is right, None where nobody
    knows; ``contested`` that persons disagree. ``unit`` is what can be taken for independent in its building: the same
    two maps are one, however often they were matched (``units.unit_of``). Where the first hypothesis was merged
    ``looks`` are what was seen of it, and ``right_later`` says whether it lies right in the end; ``reverted`` that it
    was taken out, after which nobody looked, ``confirmed`` that it was and stayed.
    """

    unit: Unit
    environment: str
    group: Group
    matcher: str
    numbers: Mapping[str, float]
    right: bool | None
    by: By
    contested: bool = False
    looks: Sequence[Look] = ()
    right_later: bool | None = None
    reverted: bool = False
    confirmed: bool = False
    quality: float | None = None
    overlap: float | None = None

    @property
    def buildings(self) -> tuple[str, ...]:
        """The buildings of the two maps: one, or two of pairs that do not belong together."""
        return tuple(self.environment.split(BOTH))


@dataclass(slots=True)
class Labels:
    """The examples of some datasets, and what was counted while they were read."""

    examples: list[Labelled] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    annotators: Counter[str] = field(default_factory=Counter)
    folders: list[str] = field(default_factory=list)

    @property
    def labelled(self) -> list[Labelled]:
        """Those of which somebody knows whether they are right, or of which persons disagree."""
        return [example for example in self.examples if example.right is not None or example.contested]

    @property
    def buildings(self) -> list[str]:
        """All buildings there are labels from, by name."""
        return sorted({name for example in self.labelled for name in example.buildings})


def read_labels(paths: Iterable[Path], *, without: Sequence[str] = (), held_back: bool = False) -> Labels:
    """The examples of output folders and datasets; ``without`` names buildings that are left out.

    What a dataset has put aside for testing is not read unless ``held_back`` says so, from wherever it comes: neither
    the same example in another folder, nor another one of the same two maps. An example that several folders hold is
    read once, with what was said of it in any of them. Raises UsageError when a folder cannot be read, there is no
    example, or none is of a building that is to be left out.
    """
    folders = [ExampleFolder(path) for path in paths]
    labels, seen = Labels(folders=[folder.path.name for folder in folders]), set[ExampleKey]()
    words, aside = _said(folders), set() if held_back else _put_aside(folders)
    buildings = set[str]()
    for folder in folders:
        for row in plain(folder.rows(list(_COLUMNS))).to_pylist():
            buildings.update(row["environment"].split(BOTH))
            key = ExampleKey(row["run_id"], row["example_id"])
            if key in seen:
                labels.counts["repeated"] += 1
                continue
            seen.add(key)
            if key in aside or unit_of(row) in aside:
                labels.counts["held back for testing"] += 1
            elif set(row["environment"].split(BOTH)) & set(without):
                labels.counts["left out by name"] += 1
            else:
                _add(labels, row, words.get(key, {}))
    if unknown := sorted(set(without) - buildings):
        raise UsageError(
            f"no example is of {', '.join(map(repr, unknown))}, which is to be left out: the buildings are "
            f"{', '.join(sorted(buildings)) or 'none'}"
        )
    if again := len(labels.examples) - len({(example.group.rule, example.unit) for example in labels.examples}):
        labels.counts["of the same two maps as another"] = again
    if not labels.examples:
        why = ", ".join(f"{count} {what}" for what, count in sorted(labels.counts.items()))
        raise UsageError(
            f"no attempt with a hypothesis was found in {', '.join(labels.folders)}"
            f"{f' ({why})' if why else ''}: run or evaluate with --examples"
        )
    return labels


def _said(folders: Sequence[ExampleFolder]) -> dict[ExampleKey, dict[str, str]]:
    """The last word of every annotator on every example, in whichever folder it was said."""
    words: dict[ExampleKey, dict[str, str]] = {}
    for (key, annotator), word in last_words_on(folders).items():
        words.setdefault(key, {})[annotator] = word.label
    return words


def _put_aside(folders: Sequence[ExampleFolder]) -> set[tuple[str, ...]]:
    """What is for testing only: keys of examples, and units."""
    aside: set[tuple[str, ...]] = set()
    for folder in folders:
        for row in plain(folder.rows([*UNIT_COLUMNS, "split"])).to_pylist():
            if row.get("split") == HELD_BACK:
                aside |= {ExampleKey(row["run_id"], row["example_id"]), unit_of(row)}
    return aside


def _add(labels: Labels, row: Mapping[str, Any], words: Mapping[str, str]) -> None:
    """Count a row, and keep it when it had a hypothesis."""
    numbers = _first(row)
    if numbers is None:
        labels.counts["without hypothesis"] += 1
        return
    labels.annotators.update(words.keys())
    right, by, contested = _judged(row.get("truth"), words)
    later, *_ = _judged(row.get("truth_final") or row.get("truth"), words)
    if row["chosen"]:
        labels.counts["another than the first hypothesis was judged"] += 1
        right, contested = (False, False) if right else (None, False)
    if contested:
        labels.counts["persons disagree"] += 1
    if by == "truth" and any((said == "right") != right for said in words.values() if said in ("right", "wrong")):
        labels.counts["a person contradicts the truth"] += 1
    labels.counts["by " + by if by else "unlabelled"] += 1
    watched = row["verdict"] == "provisional" and not row["chosen"]  # the first hypothesis itself
    labels.examples.append(
        Labelled(
            unit=unit_of(row),
            environment=row["environment"],
            group=_group(row),
            matcher=row["matcher"],
            numbers=numbers,
            right=right,
            by=by,
            contested=contested,
            looks=_looks(row.get("history") or ()) if watched else (),
            right_later=later if watched else None,
            reverted=watched and row["state"] == "reverted",
            confirmed=watched and row["state"] == "confirmed",
            quality=_lower(row.get("receiver_quality"), row.get("donor_quality")),
            overlap=row.get("truth_overlap") if row.get("truth_overlap") is not None else row.get("overlap"),
        )
    )


def _judged(truth: str | None, words: Mapping[str, str]) -> tuple[bool | None, By, bool]:
    """Whether something is right, who says so, and whether persons disagree: truth before persons, who must agree."""
    if truth in ("right", "wrong"):
        return truth == "right", "truth", False
    said = {word for word in words.values() if word in ("right", "wrong")}
    if not said:
        return None, "", False
    return (None, "persons", True) if len(said) > 1 else (said == {"right"}, "persons", False)


def _first(row: Mapping[str, Any]) -> dict[str, float] | None:
    """The numbers of the matcher's first hypothesis."""
    if row["chosen"] is None or not row["rule"]:
        return None
    told_of = row["evidence"] if row["chosen"] == 0 else [r for r in row["rivals"] if r["hypothesis"] == 0]
    numbers = {entry["name"]: entry["value"] for entry in told_of}
    return {name: math.nan if value is None else value for name, value in numbers.items()} or None


def _group(row: Mapping[str, Any]) -> Group:
    """The group of a row; a rule that a calibration has made is the one that it was made of."""
    group = Group(
        row["rule"],
        row["receiver_type"],
        row["donor_type"],
        row["reversal"],
        told(row["receiver_resolution_m"]),
        told(row["donor_resolution_m"]),
        resolutions=True,
    )
    base = next((name for step in group.coarser if (name := step.base_of(group.rule)) is not None), group.rule)
    return replace(group, rule=base)


def _looks(history: Iterable[Mapping[str, Any]]) -> list[Look]:
    """Looks in their order; where one moment tells a number twice it was looked at twice."""
    looks: list[Look] = []
    told: dict[str, float] = {}
    at = None
    for entry in history:
        if (entry["stamp"], entry["observations"]) != at or entry["metric"] in told:
            at, told = (entry["stamp"], entry["observations"]), {}
            looks.append(Look(entry["observations"], told))
        told[entry["metric"]] = math.nan if entry["value"] is None else entry["value"]
    return looks


def _lower(*values: float | None) -> float | None:
    given = [value for value in values if value is not None]
    return min(given) if given else None
