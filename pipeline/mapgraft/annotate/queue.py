"""In which order examples are shown: first what a person's word tells most about.

The order is made of two parts, and of nothing random. Examples lie in a row that never changes: the environments take
turns, each with the example whose outcome is least certain first. And at every moment each example has a class for
the annotator who asks, by what others have said of it; of the lowest class that has any, the first in the row is shown.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.annotate.opened import Opened
from mapgraft.annotate.words import Words

SHARED_ONE_IN: Final = 5  # examples that two annotators are to judge, so that agreement can be told
DISPUTED, UNSEEN, UNDECIDED, SECOND, AGREED, WITHOUT, TRUE, SKIPPED = range(8)  # classes, the most informative first


class Queue:
    """The order of the opened examples."""

    def __init__(self, opened: Opened) -> None:
        self._row = standing_order(opened)
        self._open = np.ones(len(opened), np.bool_)
        self._without = np.array([not opened.has_place(n) for n in range(len(opened))], np.bool_)
        self._known = np.array([truth is not None for truth in opened.truth], np.bool_)
        self._shared = np.array([_is_shared(*key) for key in opened.keys], np.bool_)

    def next(
        self, words: Words, annotator: str, shown_to_others: Sequence[int] = (), skipped: Sequence[int] = ()
    ) -> int | None:
        """The example to show somebody, None when they have judged all.

        What others are looking at counts as seen. What somebody ``skipped`` comes last, the earliest skipped first.
        """
        open_ = self._open if annotator not in words.codes else self._open & (words.codes[annotator] == 0)
        if not open_.any():
            return None
        keys = self.classes(words, shown_to_others) * len(self._row) + self._row
        for place, n in enumerate(skipped):
            keys[n] = SKIPPED * len(self._row) + place
        keys[~open_] = np.iinfo(np.int64).max
        return int(keys.argmin())

    def classes(self, words: Words, shown_to_others: Sequence[int] = ()) -> NDArray[np.int64]:
        """The class of every example for an annotator who has said nothing of it, (n,)."""
        right, wrong, unsure = words.right, words.wrong, words.unsure
        looked = right + wrong + unsure
        for n in shown_to_others:
            looked[n] += 1
        choices = {
            TRUE: self._known,
            WITHOUT: self._without,
            DISPUTED: (right == wrong) & (right > 0),
            UNSEEN: (looked == 0) | (self._shared & (looked < 2)),
            UNDECIDED: (right + wrong == 0) & (unsure > 0),
            SECOND: right + wrong < 2,
        }
        chosen: NDArray[np.int64] = np.select(list(choices.values()), list(choices), AGREED)
        return chosen

    def leave_out(self, n: int) -> None:
        """Never show an example again: it cannot be read."""
        self._open[n] = False


def standing_order(opened: Opened) -> NDArray[np.int64]:
    """The position of every example in the row, (n,): environments take turns, the least certain of each first."""
    uncertain = opened.uncertainty
    by_environment = sorted(range(len(opened)), key=lambda n: (opened.environments[n], -uncertain[n], opened.keys[n]))
    turns, turn, last = np.zeros(len(opened), np.int64), 0, None
    for n in by_environment:
        turn = turn + 1 if opened.environments[n] == last else 0
        turns[n], last = turn, opened.environments[n]
    order = sorted(by_environment, key=lambda n: (turns[n], -uncertain[n]))
    row = np.empty(len(opened), np.int64)
    row[order] = np.arange(len(opened))
    return row


def _is_shared(run_id: str, example_id: str) -> bool:
    """Whether an example is one of those that two annotators are to judge: by its name, so wherever it is opened."""
    digest = hashlib.blake2b(f"{run_id}/{example_id}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") % SHARED_ONE_IN == 0
