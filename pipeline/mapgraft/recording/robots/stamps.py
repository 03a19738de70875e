"""Stamps that cannot be true: zeros, jumps, falls back and repeats, told from clocks that are only late or slow."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from statistics import median_low
from typing import Final, Literal, NamedTuple

from mapgraft.recording.poses.frames import Stamped

StampCause = Literal["stamp_zero", "stamp_jump", "stamp_backwards", "stamp_repeated"]

OUT_OF_ORDER_NS: Final = 1_000_000_000
"""Messages of one stream may change places by this much."""

AHEAD_NS: Final = 2_000_000_000
"""From one message to the next stamps may run this much ahead of the time of recording: a simulator that makes up time,
messages that waited in the air."""

BEYOND_NS: Final = 2**62
"""In the year 2116; no clock shows more, and what is added to a time must still be one."""

LASTING: Final = 10
"""So many odd messages in a row are no slip: the clock was set."""

_REMEMBERED: Final = 5  # offsets, of which the median counts, so that one slip moves nothing
_NEVER: Final = -(2**62)


class Odd(NamedTuple):
    """A stamp that is odd: why (``because`` is a clause), and what the time of its message is, as far as one can tell.

    ``time_ns`` is the stamp where it may be true all the same, else the time of recording plus the usual offset of the
    stamps before. It is not to be relied on without ``used``: the message may have come late, and its stamp be true.
    """

    cause: StampCause
    time_ns: int
    because: str
    used: bool = True


class StampWatch:
    """Follows the stamps of one stream of messages (a topic, an edge) and says which of them cannot be true.

    A stamp is believed when it follows the one before, whatever the recorder did meanwhile (it may have slept, or got
    late messages all at once), when the recorder saw the same gap, or when it lies as far from the time of recording as
    those before. A message with another stamp is not to be used, until that lasts: then a clock that was set back, or a
    simulation that began anew, goes on in the time of recording, and one that was set forward is believed. A stamp of 0
    tells nothing, so that the time of recording counts. The first few stamps have nothing to be measured by.

    ``usual_ns`` is how far stamps lie after the time of recording elsewhere in the stream, None where nobody knows.
    """

    __slots__ = ("_given_ns", "_log_ns", "_next_ns", "_offsets", "_row", "_stamp_ns", "_usual_ns", "began_anew")

    def __init__(self, usual_ns: int | None = None) -> None:
        self._usual_ns = usual_ns
        self.began_anew = False  # whether what came before the last message was not to be believed after all
        self._stamp_ns = _NEVER  # of the message before
        self._given_ns = _NEVER  # the time that counts for it
        self._log_ns = 0
        self._next_ns = _NEVER  # after which a stamp follows that needs no second look; never, where that is in doubt
        self._offsets: deque[int] = deque(maxlen=_REMEMBERED)
        self._row = 0  # how many odd ones in a row follow each other

    def judge(self, log_ns: int, stamp_ns: int) -> Odd | None:
        """Why the next message's stamp cannot be true, None where it is believed; messages come as recorded."""
        self.began_anew = False
        if 0 < stamp_ns - self._next_ns <= AHEAD_NS and stamp_ns > 0:
            self._stamp_ns = self._given_ns = self._next_ns = stamp_ns
            self._log_ns = log_ns
            self._offsets.append(stamp_ns - log_ns)
            return None
        odd = self._looked_at(log_ns, stamp_ns)
        self._stamp_ns, self._log_ns = stamp_ns, log_ns
        return odd

    def _looked_at(self, log_ns: int, stamp_ns: int) -> Odd | None:
        step_ns = stamp_ns - self._given_ns
        if not self._offsets or (stamp_ns > 0 and self._is_new(step_ns, log_ns)):
            self.began_anew = bool(self._offsets)
            self._offsets.clear()
            self._believe(log_ns, stamp_ns)
            return None
        instead_ns = log_ns + median_low(self._offsets)
        near = abs(stamp_ns - instead_ns) <= OUT_OF_ORDER_NS
        if stamp_ns == 0 and not near:
            self._row = 0
            return self._doubt(Odd("stamp_zero", instead_ns, "its stamp is 0"))
        if stamp_ns == self._stamp_ns and stamp_ns <= instead_ns + OUT_OF_ORDER_NS:
            return self._repeated(max(instead_ns, stamp_ns), stamp_ns)
        if not near:
            self._row = self._row + 1 if self._row and 0 <= stamp_ns - self._stamp_ns <= AHEAD_NS else 1
        if step_ns > 0:
            if near or self._goes_on(step_ns, log_ns, stamp_ns):
                self._believe(log_ns, stamp_ns)
                return None
            recorded = f"recorded {_seconds(log_ns - self._log_ns)} earlier"
            because = f"its stamp lies {_seconds(step_ns)} after that of the one before, {recorded}"
            return self._doubt(Odd("stamp_jump", instead_ns, because, used=False))
        because = f"its stamp lies {_seconds(-step_ns)} before that of the one before"
        if near:
            return Odd("stamp_backwards", stamp_ns, because)
        return self._doubt(Odd("stamp_backwards", instead_ns, because, used=self._row >= LASTING))

    def _is_new(self, step_ns: int, log_ns: int) -> bool:
        """Whether so little is known that the newcomer may be as right as what came before."""
        jumps = step_ns < -OUT_OF_ORDER_NS or step_ns > max(AHEAD_NS, log_ns - self._log_ns + OUT_OF_ORDER_NS)
        return jumps and len(self._offsets) < _REMEMBERED

    def _goes_on(self, step_ns: int, log_ns: int, stamp_ns: int) -> bool:
        """Whether a later stamp may be true: the recorder saw the gap, too, or it is usual elsewhere, or it lasts."""
        if step_ns <= log_ns - self._log_ns + OUT_OF_ORDER_NS:
            return True
        if self._usual_ns is not None and abs(stamp_ns - log_ns - self._usual_ns) <= OUT_OF_ORDER_NS:
            return True
        return self._row >= LASTING

    def _believe(self, log_ns: int, stamp_ns: int) -> None:
        offset_ns = stamp_ns - log_ns
        if self._offsets and abs(offset_ns - median_low(self._offsets)) > OUT_OF_ORDER_NS:
            self._offsets.clear()  # what was usual is so no longer
        self._given_ns = self._next_ns = stamp_ns
        self._offsets.append(offset_ns)
        self._row = 0

    def _repeated(self, instead_ns: int, stamp_ns: int) -> Odd:
        self._given_ns = instead_ns
        if instead_ns - stamp_ns > OUT_OF_ORDER_NS:
            self._next_ns = _NEVER
        return Odd("stamp_repeated", instead_ns, "it has the stamp of the one before")

    def _doubt(self, odd: Odd) -> Odd:
        self._given_ns, self._next_ns = odd.time_ns, _NEVER
        return odd


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / 1e9:,.3f} s"


def believed(times: Iterable[Stamped], usual_ns: int) -> list[int]:
    """The times of those messages of one stream that are to be used, in the order of their recording."""
    watch, found = StampWatch(usual_ns), list[int]()
    for log_ns, stamp_ns in times:
        odd = watch.judge(log_ns, stamp_ns)
        if watch.began_anew:
            found.clear()
        if odd is None or odd.used:
            found.append(stamp_ns if odd is None else odd.time_ns)
    return found
