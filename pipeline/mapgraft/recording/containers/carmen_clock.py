"""The time of a CARMEN log: its stamps where they tell time, the order of its lines where they do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from mapgraft.recording.containers.carmen_lines import Stamps

Basis = Literal["sent", "logged", "index"]

RESTART_NS = 10_000_000_000
"""Stamps that fall back by more than this begin anew; by less, lines were only written out of order."""

AFTER_RESTART_NS = 1_000_000
SCAN_NS = 1_000_000_000
LINE_NS = 1_000
"""With the index as clock, a scan lasts a second and every other line after it a microsecond."""


class Time(NamedTuple):
    """When a line was logged (never falling back), and the line's own stamp on the same clock."""

    log_ns: int
    stamp_ns: int
    restarted: bool


@dataclass(slots=True)
class ClockSurvey:
    """Counts, over the lines that shall tell time, how many are later than all before by either stamp."""

    lines: int = 0
    sent_advances: int = 0
    logged_advances: int = 0
    _newest_sent_ns: int = -(2**63)
    _newest_logged_ns: int = -(2**63)

    def see(self, found: Stamps) -> None:
        self.lines += 1
        if found.sent_ns > self._newest_sent_ns:
            self.sent_advances, self._newest_sent_ns = self.sent_advances + 1, found.sent_ns
        if found.logged_ns > self._newest_logged_ns:
            self.logged_advances, self._newest_logged_ns = self.logged_advances + 1, found.logged_ns

    @property
    def basis(self) -> Basis:
        """The sender's stamps, or else the logger's, if most lines advance them; else the index."""
        if self.lines <= 2 or 2 * self.sent_advances >= self.lines:
            return "sent"
        return "logged" if 2 * self.logged_advances >= self.lines else "index"

    def clock(self, *, by_scans: bool) -> CarmenClock:
        """A clock at the beginning of the log."""
        return CarmenClock(self.basis, by_scans, self._newest_sent_ns > 0)


@dataclass(slots=True)
class CarmenClock:
    """Gives every line its time; the same lines give the same times, so the file can be read again.

    Scans make the clock, and other lines follow it: corrected logs hold odometry lines whose stamps were never set (0,
    or whatever was in memory), and these must not move it. ``by_scans`` is False for logs without scans, ``stamped``
    says that the log has stamps other than 0.
    """

    basis: Basis
    by_scans: bool
    stamped: bool
    _newest_ns: int | None = None
    _raw_ns: int | None = None
    _offset_ns: int = 0
    _scans: int = 0

    def time(self, found: Stamps, *, scan: bool) -> Time | None:
        """The time of the next line; None for a line that has none."""
        raw_ns = found.logged_ns if self.basis == "logged" else found.sent_ns
        makes_time = scan or not self.by_scans
        if not makes_time and self._is_astray(raw_ns):
            return None
        time = self._by_index(makes_time) if self.basis == "index" else self._by_stamp(raw_ns, makes_time)
        self._newest_ns, self._raw_ns = time.log_ns, raw_ns if makes_time or self._raw_ns is None else self._raw_ns
        return time

    def _is_astray(self, raw_ns: int) -> bool:
        """Whether a stamp cannot be the time of a line that stands here."""
        if raw_ns == 0 and self.stamped and self._newest_ns is not None:
            return True
        if self.basis == "index":
            # six digits are all that many logs keep of an epoch stamp
            return self._raw_ns is not None and abs(raw_ns - self._raw_ns) > max(RESTART_NS, abs(self._raw_ns) // 10**5)
        return self._newest_ns is not None and abs(raw_ns + self._offset_ns - self._newest_ns) > RESTART_NS

    def _by_index(self, makes_time: bool) -> Time:
        before_ns = -LINE_NS if self._newest_ns is None else self._newest_ns
        now_ns = max(before_ns + LINE_NS, self._scans * SCAN_NS if makes_time else 0)
        self._scans += makes_time
        return Time(now_ns, now_ns, False)

    def _by_stamp(self, raw_ns: int, makes_time: bool) -> Time:
        stamp_ns = raw_ns + self._offset_ns
        if self._newest_ns is None:
            return Time(stamp_ns, stamp_ns, False)
        restarted = makes_time and stamp_ns < self._newest_ns - RESTART_NS
        if restarted:
            self._offset_ns = self._newest_ns + AFTER_RESTART_NS - raw_ns
            stamp_ns = raw_ns + self._offset_ns
        return Time(max(self._newest_ns, stamp_ns), stamp_ns, restarted)
