"""What is known of an example in the end: the truth, or else what persons say."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from mapgraft.contracts import Transform
from mapgraft.examples.labels_csv import SAME_M, SAME_RAD
from mapgraft.examples.reading import Word, transform_of
from mapgraft.outputs.tables import Row


def judged(example: Mapping[str, Any], words: Sequence[Word]) -> Row:
    """The columns that a dataset has beside those of the example; ``words`` are the last ones of every person.

    The truth goes before what persons say; of these it is what more of them say, right or wrong, else ``unsure``.
    """
    label, by = example["truth"], "truth"
    T = transform_of(example["truth_T"])
    if label is None and words:
        label, by = _majority(words), "persons"
    if T is None and example["truth_by"] is None:
        T = _place(words)
    return {
        "label": label,
        "label_by": by if label is not None else None,
        "labels": [_told(word) for word in sorted(words, key=lambda word: (word.annotator, word.said_ns))],
        "T_label": None if T is None else T.matrix,
    }


def _majority(words: Sequence[Word]) -> str:
    said = Counter(word.label for word in words)
    if said["right"] == said["wrong"]:
        return "unsure"
    return "right" if said["right"] > said["wrong"] else "wrong"


def _place(words: Sequence[Word]) -> Transform | None:
    """Where persons hold the donor's map to lie: the place in the middle of theirs; None where they contradict."""
    given = [word.T_receiver_donor for word in words if word.T_receiver_donor is not None and word.label != "unsure"]
    apart = [[a.difference(b) for b in given] for a in given]
    if any(shift_m > SAME_M or abs(turn_rad) > SAME_RAD for row in apart for shift_m, turn_rad in row):
        return None
    sums = [math.fsum(shift_m + abs(turn_rad) for shift_m, turn_rad in row) for row in apart]
    return given[sums.index(min(sums))] if given else None


def _told(word: Word) -> Row:
    T = word.T_receiver_donor
    return {
        "annotator": word.annotator,
        "label": word.label,
        "reason": word.comment or "",
        "x_m": None if T is None else T.x_m,
        "y_m": None if T is None else T.y_m,
        "yaw_rad": None if T is None else T.yaw_rad,
        "labelled_at": word.said_ns,
        "elapsed_s": word.elapsed_s,
    }
