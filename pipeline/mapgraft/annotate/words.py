"""What annotators have said of the opened examples, as it stands on disk."""

from __future__ import annotations

from typing import Final, get_args

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from mapgraft import examples
from mapgraft.annotate.agreement import Codes
from mapgraft.annotate.opened import Opened, matrices
from mapgraft.annotate.shown import Said, Word
from mapgraft.annotate.telling import REASON_CHARACTERS, text
from mapgraft.examples import ExampleKey
from mapgraft.outputs.label_parts import LabelParts
from mapgraft.outputs.labels import NOBODY_NAMED

CODES: Final[dict[Said, int]] = {said: code for code, said in enumerate(get_args(Said), 1)}  # 0 is nothing
Counts = NDArray[np.int64]  # (n,) of annotators
MOST_ANNOTATORS: Final = 1_000  # whose words are kept; a byte each per example
COLUMNS: Final = ("merge_id", "label", "annotator", "comment")


class Words:
    """The last word of every annotator on every example, read from the folders' ``labels/`` and kept up to date.

    ``codes`` is annotator → (n,) what they said, by ``CODES``. ``right``, ``wrong`` and ``unsure`` (n,) count the
    annotators.
    """

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self._parts = [LabelParts(path) for path in opened.paths]
        self._words: dict[str, dict[int, tuple[int, Word | None]]] = {}
        self._counts: Counts = np.zeros((1 + len(CODES), len(opened)), np.int64)
        self.codes: dict[str, Codes] = {}
        self._newest_ns: dict[str, int] = {}
        for word in opened.published():
            self._put(word)

    @property
    def right(self) -> Counts:
        return self._of("right")

    @property
    def wrong(self) -> Counts:
        return self._of("wrong")

    @property
    def unsure(self) -> Counts:
        return self._of("unsure")

    @property
    def count(self) -> Counts:
        """How many annotators have said something of each example, (n,)."""
        total: Counts = self._counts[1:].sum(axis=0)
        return total

    def refresh(self) -> None:
        """Take in what was written since, also by others."""
        for parts in self._parts:
            for run_id, rows in parts.new():
                self._take(run_id, rows)

    def word(self, n: int, annotator: str) -> Word | None:
        """What somebody said last of an example; None where that is nothing or was withdrawn."""
        return self._words.get(annotator, {}).get(n, (0, None))[1]

    def newest_ns(self, annotator: str) -> int:
        """When somebody said something last, or withdrew it; nanoseconds since 1970, 0 for never."""
        return self._newest_ns.get(annotator, 0)

    def last(self, annotator: str) -> Word | None:
        """What somebody said last of all that still stands."""
        standing = [word for _, word in self._words.get(annotator, {}).values() if word is not None]
        return max(standing, key=lambda word: word.at_ns, default=None)

    def _of(self, said: Said) -> Counts:
        counted: Counts = self._counts[CODES[said]]
        return counted

    def _take(self, run_id: str, rows: pa.Table) -> None:
        stamps = rows["labelled_at"].cast(pa.int64()).to_pylist()
        judged, held = (matrices(rows[name]) for name in ("T_receiver_donor_judged", "T_receiver_donor"))
        for at, (row, at_ns) in enumerate(zip(rows.select(COLUMNS).to_pylist(), stamps, strict=True)):
            key = ExampleKey(run_id, row["merge_id"])
            n = self._opened.number(*key)
            if n is not None:
                Ts = (self._opened.other_transform(n, judged[at]), self._opened.other_transform(n, held[at]))
                who, why = row["annotator"] or NOBODY_NAMED, row["comment"] or ""
                self._put(examples.Word(key, row["label"], who, *Ts, why, at_ns or 0, None))

    def _put(self, found: examples.Word) -> None:
        n, annotator, at_ns = self._opened.number(*found.key), text(found.annotator), found.said_ns
        if n is None or not found.is_about(self._opened.judged(n)):
            return
        if annotator not in self._words and len(self._words) >= MOST_ANNOTATORS:
            return
        words = self._words.setdefault(annotator, {})
        if n in words and words[n][0] > at_ns:
            return
        self._newest_ns[annotator] = max(self._newest_ns.get(annotator, 0), at_ns)
        codes = self.codes.setdefault(annotator, np.zeros(len(self._opened), np.int8))
        said = next((said for said in CODES if said == found.label), None)  # None: withdrawn
        code = 0 if said is None else CODES[said]
        place = self._opened.moved(n, found.T_receiver_donor)
        words[n] = (
            at_ns,
            None if said is None else Word(n, annotator, said, text(found.comment, REASON_CHARACTERS), place, at_ns),
        )
        self._counts[codes[n], n] -= 1
        self._counts[code, n] += 1
        codes[n] = code
