"""What is known of an example in the end: the truth, or else what persons say."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from mapgraft.contracts import Transform
from mapgraft.examples.labels_csv import SAME_M, SAME_RAD
from mapgraft.examples.reading import Word, put_at, transform_of
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
        seen = transform_of(example["T_receiver_donor"])
        poses = [pose for word in words if word.label != "unsure" and (pose := _pose(word)) is not None]
        T = _place([put_at(seen, *pose) for pose in poses])
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


def _place(given: Sequence[Transform]) -> Transform | None:
    """Of the places where persons hold the donor's map to lie the one in the middle; None where they contradict."""
    apart = [[a.difference(b) for b in given] for a in given]
    if any(shift_m > SAME_M or abs(turn_rad) > SAME_RAD for row in apart for shift_m, turn_rad in row):
        return None
    sums = [math.fsum(shift_m + abs(turn_rad) for shift_m, turn_rad in row) for row in apart]
    return given[sums.index(min(sums))] if given else None


def _pose(word: Word) -> tuple[float, float, float] | None:
    """x, y and yaw of the transform that somebody holds for right; those that were published, where they were."""
    T = word.T_receiver_donor
    return None if T is None else word.pose or (T.x_m, T.y_m, T.yaw_rad)


def _told(word: Word) -> Row:
    x_m, y_m, yaw_rad = _pose(word) or (None, None, None)
    return {
        "annotator": word.annotator,
        "label": word.label,
        "reason": word.comment or "",
        "x_m": x_m,
        "y_m": y_m,
        "yaw_rad": yaw_rad,
        "labelled_at": word.said_ns,
        "elapsed_s": word.elapsed_s,
    }
