"""One topic of payloads on its way in: in which frame its messages are, and when they were, odd stamps put right."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mapgraft.contracts.sources import RecordedScan
from mapgraft.recording.poses.frames import Stamped
from mapgraft.recording.robots.clocks import INDEX_STEP_NS, Times
from mapgraft.recording.robots.payloads import Opened, Read
from mapgraft.recording.robots.stamps import BEYOND_NS, Odd, StampWatch
from mapgraft.recording.timeline.tally import TopicTally

_MOST_FRAMES = 64  # of one topic that are watched; a frame that changes with every message must not fill the memory


@dataclass(slots=True)
class Topic:
    """What an intake knows about one payload topic.

    ``seen_frame`` is the frame that a sample shows, ``tree_frame`` its name in the robot's tree.
    """

    name: str
    kind: str
    seen_frame: str
    tree_frame: str
    tally: TopicTally
    times: Times
    met: int = 0  # messages so far, for the clock that counts them
    wanted: int = 0  # of which within all limits, for thinning
    _watches: dict[str, StampWatch] = field(default_factory=dict)  # by frame: two lidars may share a topic
    _before: dict[str, Read] = field(default_factory=dict)
    _judged: bool = False

    def __post_init__(self) -> None:
        self._judged = self.times.judged(self.name)

    def frame(self, opened: Opened) -> str:
        return self.tree_frame if opened.frame == self.seen_frame else opened.frame

    def time(self, number: int, read: Read, opened: Opened) -> int | None:
        """When a message was, by the robot's clock, in nanoseconds; None for one not to be used, which is tallied."""
        if self._judged and (watch := self._watches.get(opened.frame) or self._watch(opened.frame)) is not None:
            odd = watch.judge(read.log_ns, opened.stamp_ns)
            before, self._before[opened.frame] = self._before.get(opened.frame), read
            time_ns = opened.stamp_ns if odd is None else self._put_right(odd, opened.stamp_ns, before, read)
        elif self.times.clock == "index":
            return number * INDEX_STEP_NS
        else:
            time_ns = self.times.stamp(self.name, Stamped(read.log_ns, opened.stamp_ns))
        if time_ns is not None and not -BEYOND_NS <= time_ns <= BEYOND_NS:
            self.tally.drop("beyond_time", 0, f"its time is {time_ns / 1e9:.6g} s, which no clock shows")
            return None
        return time_ns

    def _put_right(self, odd: Odd, stamp_ns: int, before: Read | None, read: Read) -> int | None:
        if odd.cause == "stamp_repeated" and before is not None and _same(before, read):
            self.tally.drop("repeated", odd.time_ns, "it is the one before once more, byte for byte")
            return None
        if not odd.used:
            self.tally.drop(odd.cause, odd.time_ns, odd.because)
            return None
        what = "it is put in order" if odd.time_ns == stamp_ns else "the time of its recording counts"
        self.tally.notice(odd.cause, odd.time_ns, f"{odd.because}; {what}")
        return odd.time_ns

    def _watch(self, frame: str) -> StampWatch | None:
        watch = self._watches.get(frame)
        if watch is None and len(self._watches) < _MOST_FRAMES:
            watch = self._watches[frame] = StampWatch(self.times.offset_ns)
        return watch


def _same(one: Read, other: Read) -> bool:
    """Whether two messages say the same."""
    if isinstance(one, RecordedScan):
        if not isinstance(other, RecordedScan):
            return False
        a, b = one.scan, other.scan
        rest = a._replace(ranges_m=b.ranges_m, T_frame_sensor=b.T_frame_sensor)
        same = all(x is y or x == y for x, y in zip(rest, b, strict=True))
        return same and np.array_equal(a.ranges_m, b.ranges_m, equal_nan=True)
    return not isinstance(other, RecordedScan) and one.data == other.data
