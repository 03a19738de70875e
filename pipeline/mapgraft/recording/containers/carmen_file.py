"""CARMEN logs (.log, .clf, .gfs, also gzipped) as a source of typed messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np

from mapgraft.contracts.sources import (
    CARMEN_LASER_SCAN,
    CARMEN_ODOMETRY,
    Channel,
    RawMessage,
    ReadFaults,
    RecordedScan,
    ScanMessage,
    SchemaText,
)
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.carmen_clock import ClockSurvey, Time
from mapgraft.recording.containers.carmen_lines import (
    LASER_FRAMES,
    SCAN_KEYWORDS,
    CarmenOdometry,
    CarmenScan,
    keyword_of,
    pose_line,
    scan_line,
    stamps,
)
from mapgraft.recording.containers.carmen_survey import RangeSurvey
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.scanning import scans_of
from mapgraft.recording.containers.text_lines import Line, lines

_BROKEN = (ValueError, IndexError, OverflowError)


class _TimedLine(NamedTuple):
    keyword: str
    text: bytes
    time: Time


class CarmenSource:
    """One CARMEN log; its topics are the keywords of its lines (``FLASER``, ``ODOM``, …).

    The file is read when it is opened, to learn which range means "no return" and whether the stamps tell time, and
    once more for each pass. ``log_ns`` never falls back: lines written out of order keep their own stamp but take the
    log time of the newest line before. Where stamps are unusable the index of the scans is the clock, one second each;
    where they begin anew the rest is shifted; ``faults`` says so. Raises RecordingError when no line can be read.
    """

    container = "carmen"

    def __init__(self, path: Path, limits: ReadLimits = DEFAULT_LIMITS) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._limits = limits
        self._no_return_m: dict[str, float] = {}
        self._clock = self._survey()
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        counts = self._count()
        if not counts:
            raise RecordingError(f"{path} holds no readable line of a CARMEN log (FLASER, ROBOTLASER1, ODOM, …)")
        self._report(counts)
        self.channels = tuple(
            Channel(n, keyword, CARMEN_LASER_SCAN if keyword in SCAN_KEYWORDS else CARMEN_ODOMETRY, "carmen", count)
            for n, (keyword, count) in enumerate(sorted(counts.items()))
        )

    def _survey(self) -> ClockSurvey:
        """Learn the clock from the scans (from all lines in a log without scans) and the no-return ranges."""
        by_scans, by_lines = ClockSurvey(), ClockSurvey()
        ranges: dict[str, RangeSurvey] = {}
        for line in lines(self.path, self.faults, self._limits):
            keyword = keyword_of(line.text)
            if keyword is None:
                continue
            words = line.text.split()
            try:
                found = stamps(keyword, words)
                if keyword in SCAN_KEYWORDS:
                    scan = scan_line(keyword, words)
                    ranges.setdefault(keyword, RangeSurvey()).see(scan.ranges_m, scan.stated_max_m)
                    by_scans.see(found)
                by_lines.see(found)
            except _BROKEN as error:
                self._note_unreadable(line, error)
        self._no_return_m = {keyword: survey.no_return_m for keyword, survey in ranges.items()}
        return by_scans if by_scans.lines else by_lines

    def _count(self) -> Counter[str]:
        """Messages per keyword; notes what is odd about the clock on the way."""
        counts: Counter[str] = Counter()
        newest_ns: dict[str, int] = {}
        for keyword, _, time in self._timed_lines():
            counts[keyword] += 1
            self.start_ns = time.log_ns if self.start_ns is None else self.start_ns
            self.end_ns = time.log_ns
            if time.stamp_ns < newest_ns.get(keyword, time.stamp_ns):
                sentence = f"{keyword} lines were written out of order: they keep their own stamps"
                self.faults.add("lines_out_of_order", sentence, topic=keyword)
            newest_ns[keyword] = max(newest_ns.get(keyword, time.stamp_ns), time.stamp_ns)
        return counts

    def _report(self, counts: Counter[str]) -> None:
        """Note what is odd about the log as a whole."""
        if self._clock.basis == "index":
            sentence = "the stamps do not advance: the index of the scans is the clock, one second each"
            self.faults.add("stamps_unusable", sentence, count=self._clock.lines)
        elif self._clock.basis == "logged":
            sentence = "the sender's stamps do not advance: the logger's are used"
            self.faults.add("stamps_unusable", sentence, count=self._clock.lines)
        if "LASER_READING" in counts:
            sentence = "GMapping's raw log has poses of odometry only: convert it with gfs2log for corrected ones"
            self.faults.add("poses_raw", sentence, topic="LASER_READING", count=counts["LASER_READING"])

    def _timed_lines(self) -> Iterator[_TimedLine]:
        """The readable lines that have a time, with it; the same in each pass."""
        clock = self._clock.clock(by_scans=bool(self._no_return_m))
        for line in lines(self.path, self.faults, self._limits):
            keyword = keyword_of(line.text)
            if keyword is None:
                continue
            try:
                time = clock.time(stamps(keyword, line.text.split()), scan=keyword in SCAN_KEYWORDS)
            except _BROKEN:
                continue  # counted by the survey
            if time is None:
                sentence = (
                    f"{keyword} lines have no time of their own (0, or far from their neighbours): they are left out"
                )
                self.faults.add("line_without_time", sentence, topic=keyword, place=line.number)
                continue
            if time.restarted:
                sentence = f"stamps begin anew at line {line.number}: what follows is shifted so that time goes on"
                self.faults.add("clock_restarted", sentence, place=line.number)
            yield _TimedLine(keyword, line.text, time)

    def _note_unreadable(self, line: Line, error: Exception) -> None:
        sentence = f"line {line.number} of {self.path.name} cannot be read ({error})"
        self.faults.add("line_unreadable", sentence, place=line.number)

    def schema(self, channel: Channel) -> SchemaText | None:
        """See ``Source.schema``."""
        return None

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``. ``data`` is the line behind its stamp on the log's clock in nanoseconds."""
        chosen = {channel.topic: channel for channel in self.channels if topics is None or channel.topic in topics}
        if not chosen:
            return
        for keyword, text, time in self._timed_lines():
            if end_ns is not None and time.log_ns > end_ns:
                return
            if keyword in chosen and (start_ns is None or time.log_ns >= start_ns):
                yield RawMessage(chosen[keyword], time.log_ns, b"%d %b" % (time.stamp_ns, text))

    def decode(self, message: RawMessage) -> CarmenScan | CarmenOdometry:
        """See ``Source.decode``."""
        stamp, *words = bytes(message.data).split()
        keyword = message.channel.topic
        try:
            if keyword not in SCAN_KEYWORDS:
                frame, pose = pose_line(keyword, words)
                return CarmenOdometry(int(stamp), frame, pose)
            scan = scan_line(keyword, words)
        except _BROKEN as error:
            raise RecordingError(f"a {keyword} line of {self.path.name} cannot be read ({error})") from error
        return CarmenScan(
            int(stamp),
            LASER_FRAMES[keyword],
            scan.start_rad,
            scan.step_rad,
            self._no_return_m[keyword],
            scan.ranges_m,
            scan.laser_pose,
            scan.robot_pose,
        )

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """See ``Source.decode_scan``; readings that saw nothing are +inf."""
        scan = self.decode(message)
        if not isinstance(scan, CarmenScan):
            raise RecordingError(f"a {message.channel.topic} line is no scan")
        limit_m = np.float32(scan.no_return_m)
        ranges = np.where(scan.ranges_m >= limit_m, np.float32(np.inf), scan.ranges_m)
        ranges.setflags(write=False)
        return ScanMessage(
            scan.stamp_ns, scan.laser, scan.start_rad, scan.step_rad, 0.0, 0.0, float(scan.no_return_m), ranges
        )

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        return scans_of(self, topics, start_ns, end_ns, self.faults)

    def close(self) -> None:
        """See ``Source.close``; a log is open only while it is read."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
