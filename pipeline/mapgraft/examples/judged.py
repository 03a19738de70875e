"""What is known of an example in the end: the truth, or else what persons say."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from mapgraft.contracts import Transform
from mapgraft.examples.reading import Word, put_at, transform_of
from mapgraft.outputs.tables import Row
from mapgraft.persons import SAME_PLACE_M, SAME_TURN_RAD, same_place

_WINDOW: Final = ("window_px_w", "window_px_h", "window_px_m", "window_x_m", "window_y_m")
KNOWN_OF: Final = ("example_id", "truth", "truth_by", "truth_T", "T_receiver_donor", *_WINDOW)
"""The columns of an example that ``judged`` reads."""


def judged(example: Mapping[str, Any], words: Sequence[Word]) -> Row:
    """The columns that a dataset has beside those of the example; ``words`` are the last ones of every person.

    The truth goes before what persons say; of these it is what more of them say, right or wrong, else ``unsure``. Where
    the donor's map really lies is told by those who say the same as most, and not where that contradicts what they say.
    """
    label, by = example["truth"], "truth"
    T = transform_of(example["truth_T"])
    if label is None and words:
        label, by = _majority(words), "persons"
    if T is None and example["truth_by"] is None:
        T = _place(_agreeing(example, words, label))
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


def _agreeing(example: Mapping[str, Any], words: Sequence[Word], label: str | None) -> list[Transform]:
    """The places given by those who say what counts: about what was judged where that is right, else another one."""
    poses = [pose for word in words if word.label == label != "unsure" and (pose := _pose(word)) is not None]
    seen = transform_of(example["T_receiver_donor"])
    places = [put_at(seen, *pose) for pose in poses]
    if seen is None:
        return places
    about_m = _middle(example, seen)
    return [T for T in places if same_place(seen, T, about_m) == (label == "right")]


def _middle(example: Mapping[str, Any], T_receiver_donor: Transform) -> tuple[float, float]:
    """The middle of what both maps know, in the donor's frame; its origin where nobody has looked."""
    window = [example[name] for name in _WINDOW]
    if not all(value is not None and math.isfinite(value) for value in window):
        return 0.0, 0.0
    w, h, px_m, x_m, y_m = window
    ((x, y),) = T_receiver_donor.inverse().apply(np.array([[x_m + 0.5 * w * px_m, y_m + 0.5 * h * px_m]])).tolist()
    return x, y


def _place(given: Sequence[Transform]) -> Transform | None:
    """Of the places where persons hold the donor's map to lie the one in the middle; None where they contradict."""
    apart = [[a.difference(b) for b in given] for a in given]
    if any(shift_m > SAME_PLACE_M or turn_rad > SAME_TURN_RAD for row in apart for shift_m, turn_rad in row):
        return None
    sums = [math.fsum(shift_m + turn_rad for shift_m, turn_rad in row) for row in apart]
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
