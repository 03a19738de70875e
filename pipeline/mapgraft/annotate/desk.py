"""Where annotators sit: which example somebody is shown next, and what becomes of their answer."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from threading import RLock
from typing import Final, Self, get_args

import numpy as np

from mapgraft.annotate.agreement import agreements, mean_kappa
from mapgraft.annotate.opened import UNREADABLE, Opened
from mapgraft.annotate.queue import Queue
from mapgraft.annotate.shown import Outcome, Place, Progress, Said, Shown, Which, Word
from mapgraft.annotate.telling import REASON_CHARACTERS
from mapgraft.annotate.words import CODES, Words
from mapgraft.outputs.label_parts import MANY, gather
from mapgraft.pages import readable

NAME_CHARACTERS: Final = 64
MOST_NAMED: Final = 50  # annotators whose names are shown
FARTHEST_M: Final = 1e6  # to which a map is dragged
LONGEST_S: Final = 86_400.0  # that somebody is believed to have looked at one example


@dataclass(frozen=True, slots=True)
class Answer:
    """What somebody says of an example; ``place`` is where they put the donor's map, None where they left it."""

    said: Said
    reason: str = ""
    place: Place | None = None
    elapsed_s: float | None = None

    @classmethod
    def read(cls, form: Mapping[str, str]) -> Self:
        """An answer from the fields of the page's form; raises ValueError with a sentence for one that is none."""
        said = {word: word for word in get_args(Said)}.get(form.get("label", ""))
        if said is None:
            raise ValueError("an answer is right, wrong or unsure")
        reason = form.get("reason", "").strip()
        if len(reason) > REASON_CHARACTERS:
            raise ValueError(f"a reason has at most {REASON_CHARACTERS} characters")
        moved = form.get("moved", "0")
        if moved not in ("0", "1"):
            raise ValueError("'moved' is 0 or 1")
        place = _place(form) if moved == "1" else None
        elapsed_s = _number(form.get("elapsed_s", ""))
        timed = elapsed_s is not None and 0.0 <= elapsed_s <= LONGEST_S
        return cls(said, reason, place, elapsed_s if timed else None)


class Desk:
    """The opened examples with what was said of them. All methods may be called from several threads at once."""

    def __init__(self, opened: Opened) -> None:
        self._opened = opened
        self._words = Words(opened)
        self._queue = Queue(opened)
        self._shown_to: dict[str, int] = {}
        self._skipped: dict[str, list[int]] = {}
        self._lock = RLock()
        self.given = 0

    def __len__(self) -> int:
        return len(self._opened)

    @property
    def left_out(self) -> list[tuple[int, str]]:
        """How many examples of the folders nobody is shown, and why."""
        return [(count, why) for why, count in self._opened.left_out.items()]

    def annotators(self) -> tuple[str, ...]:
        """Those who have said something, by name; of many, those who said most."""
        with self._lock:
            self._words.refresh()
            return tuple(sorted(name for name in self._most(MOST_NAMED) if _is_name(name)))

    def next(self, annotator: str) -> int | None:
        """The example that somebody is to judge now; the same until they have, None when they have judged all."""
        with self._lock:
            self._words.refresh()
            current = self._shown_to.get(annotator)
            if current is None or self._words.word(current, annotator) is not None:
                self._shown_to.pop(annotator, None)
                current = self._readable_one(annotator)
                if current is not None:
                    self._shown_to[annotator] = current
            return current

    def after(self, annotator: str, n: int) -> int | None:
        """The example that most likely comes after ``n``."""
        with self._lock:
            skipped = [*self._skipped.get(annotator, ()), n]
            found = self._queue.next(self._words, annotator, self._others(annotator), skipped)
            return None if found == n else found

    def skip(self, annotator: str, n: int) -> None:
        """Put off an example until all others are answered; nothing is written down."""
        with self._lock:
            skipped = self._skipped.setdefault(annotator, [])
            if n in skipped:
                skipped.remove(n)
            skipped.append(n)
            if self._shown_to.get(annotator) == n:
                del self._shown_to[annotator]

    def shown(self, n: int) -> Shown:
        """An example without anything that tells what the robot made of it."""
        return self._opened.shown(n)

    def picture(self, n: int, which: Which) -> bytes:
        """A map of an example from above, as PNG."""
        return self._opened.picture(n, which)

    def outcome(self, n: int) -> Outcome:
        """What the robot made of an example: for those who have answered."""
        return self._opened.outcome(n)

    def word(self, n: int, annotator: str) -> Word | None:
        """What somebody said last of an example, None where that is nothing or was withdrawn."""
        with self._lock:
            return self._words.word(n, annotator)

    def say(self, n: int, annotator: str, answer: Answer) -> None:
        """Write an answer down; it is on disk when this returns. Raises OutputError when it cannot be written."""
        with self._lock:
            what = (answer.said, answer.reason, answer.place, answer.elapsed_s)
            self._opened.write(n, annotator, *what, self._now(annotator))
            self.given += 1
            self._words.refresh()

    def undo(self, annotator: str) -> int | None:
        """Withdraw what somebody said last; the example, which is the next they are shown, or None without any.

        What was said stays on disk; a further row withdraws it.
        """
        with self._lock:
            self._words.refresh()
            last = self._words.last(annotator)
            if last is None:
                return None
            self._opened.write(last.n, annotator, "withdrawn", "", None, None, self._now(annotator))
            self._words.refresh()
            self._shown_to[annotator] = last.n
            return last.n

    def progress(self, annotator: str) -> Progress:
        """How far somebody is, and how far annotators agree."""
        with self._lock:
            codes = self._words.codes
            named = {*self._most(MOST_NAMED), *({annotator} & codes.keys())}
            said = {name: int(np.count_nonzero(codes[name])) for name in sorted(named)}
            pairs = agreements(codes, annotator)
            answered = said.get(annotator, 0)
            labelled = int((self._words.count > 0).sum())
            own = codes.get(annotator, np.zeros(0, np.int8))
            mine = {word: int((own == code).sum()) for word, code in CODES.items()}
            return Progress(annotator, answered, len(self), labelled, mine, said, pairs, mean_kappa(pairs))

    def rest(self, annotator: str, n: int) -> None:
        """What there is to do while somebody looks at the example that came after ``n``, which they have judged.

        The one after that is read, and now and then words are put together.
        """
        current = self._shown_to.get(annotator)
        following = None if current is None else self.after(annotator, current)
        if following is not None:
            with suppress(*UNREADABLE):  # it is passed over when it is its turn
                self.shown(following)
        if self.given % MANY == 0:
            gather(*self._opened.place_of(n))

    def _readable_one(self, annotator: str) -> int | None:
        """The next example of those that can be read."""
        while True:
            n = self._queue.next(self._words, annotator, self._others(annotator), self._skipped.get(annotator, ()))
            if n is None:
                return None
            try:
                self.shown(n)
                return n
            except UNREADABLE:
                self._queue.leave_out(n)

    def _most(self, count: int) -> list[str]:
        """The annotators who have said most."""
        codes = self._words.codes
        return sorted(codes, key=lambda name: (-int(np.count_nonzero(codes[name])), name))[:count]

    def _others(self, annotator: str) -> list[int]:
        """What others are looking at."""
        return [n for name, n in self._shown_to.items() if name != annotator]

    def _now(self, annotator: str) -> datetime:
        """The wall clock, but later than what somebody said last: the clock may have been set back since."""
        now = datetime.now(UTC)
        last = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=self._words.newest_ns(annotator) // 1_000)
        return now if now > last else last + timedelta(microseconds=1)


def checked_name(name: str) -> str:
    """An annotator's name in the one spelling in which it is compared; raises ValueError for one that will not do."""
    known = unicodedata.normalize("NFC", " ".join(name.split()))
    if not 0 < len(known) <= NAME_CHARACTERS:
        raise ValueError(f"a name has between 1 and {NAME_CHARACTERS} characters")
    if not known.isprintable() or readable(known) != known:
        raise ValueError("a name has only characters that one can see")
    return known


def _is_name(name: str) -> bool:
    try:
        return checked_name(name) == name
    except ValueError:
        return False


def _place(form: Mapping[str, str]) -> Place:
    numbers = [_number(form.get(field, "")) for field in ("x_m", "y_m", "yaw_rad")]
    x_m, y_m, yaw_rad = numbers
    if x_m is None or y_m is None or yaw_rad is None or max(abs(x_m), abs(y_m)) > FARTHEST_M:
        raise ValueError("where a map was put is told by three numbers: x_m, y_m, yaw_rad")
    return Place(x_m, y_m, math.remainder(yaw_rad, math.tau))


def _number(text: str) -> float | None:
    """A finite number, None for anything else."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
