"""Sentences on what is doubtful about labels: disagreement, contradiction, and labels that are a choice."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from mapgraft.calibrate.labelled import Labels
from mapgraft.calibrate.likeness import KOLMOGOROV, unlike
from mapgraft.calibrate.scoring import UNFITTED, Score, single
from mapgraft.calibrate.watching import Limit


def remarks(
    labels: Labels, told: Sequence[str], known: Collection[str], scores: Sequence[tuple[str, Score]]
) -> list[str]:
    """What there is to say of labels.

    ``told`` names the rules they are of, ``known`` those that the table has, ``scores`` what thresholds are set on.
    """
    counts, said = labels.counts, []
    if unknown := [name for name in told if name not in known]:
        said.append(f"labels of rules that the decision table does not have were left out: {', '.join(unknown)}")
    if counts["persons disagree"]:
        said.append(
            f"of {counts['persons disagree']} examples persons disagree whether they are right: they count as wrong "
            "where that raises a threshold, and are left out otherwise"
        )
    if counts["a person contradicts the truth"]:
        said.append(f"persons contradict the truth of {counts['a person contradicts the truth']} examples: it was kept")
    if counts["held back for testing"]:
        said.append(f"{counts['held back for testing']} examples that the dataset holds back for testing were not read")
    if judged_other := counts["another than the first hypothesis was judged"]:
        said.append(
            f"of {judged_other} examples another than the first hypothesis was judged: where that was right the "
            "first was wrong, where it was wrong nobody knows"
        )
    if again := counts["of the same two maps as another"]:
        said.append(
            f"{again} examples are of the same two maps as another one of their rule, with other settings or another "
            "time: each two maps count once"
        )
    for rule, score in scores:
        if score == single(UNFITTED):
            said.append(
                f"no score of {rule!r} could be fitted on buildings of its own: thresholds are set on the matcher's own"
            )
        said += _selected(labels, rule, score)
    return said


def unwatched(rule: str, limits: Sequence[Limit]) -> list[str]:
    """A sentence where the new rules merge what the old ones did not: nobody knows how that would have been judged."""
    worst = max(limits, key=lambda limit: limit.unwatched, default=None)
    if worst is None or not worst.unwatched:
        return []
    lost = any(limit.unwatched and limit.value is None for limit in limits)
    return [
        f"{worst.unwatched} of {worst.labels} labelled hypotheses of {rule!r} that limits of confirmation and reversal "
        "hang on would be merged by the new rules and were not when the examples were made, so that nobody watched "
        "them: each counts as the worst"
        + (", and limits cannot be promised where there are too many of them" if lost else "")
        + "; collect examples by rules that merge all (mapgraft calibrate --collecting FILE, evaluate --rules FILE)"
    ]


def _selected(labels: Labels, rule: str, score: Score) -> list[str]:
    """A sentence where the labels are a choice that differs from the examples they are of."""
    here = [example for example in labels.examples if example.group.rule == rule]
    without = [example for example in here if example.right is None and not example.contested]
    if not without:
        return []
    labelled = [example for example in here if example.right is not None]
    of = f"{len(without)} of {len(here)} examples of the rule {rule!r} have no label"
    own = score.all(labelled)
    apart = unlike(score.all(without), own, own)
    if math.isnan(apart) or apart <= KOLMOGOROV * math.sqrt(1.0 / len(without) + 1.0 / len(labelled)):
        return [f"{of}; what is promised is promised of examples like the labelled ones"]
    return [
        f"{of}, and their scores differ from those of the labelled ones by {apart:.2f}: the labels are a choice, and "
        "what is promised is promised of examples chosen alike"
    ]
