"""How the report says things: times, lengths, transforms, states, and what a revert left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from mapgraft.contracts import Exactness, Transform
from mapgraft.events import Event, Kind

TONES: Final[dict[str, str]] = {
    "merged": "wait",
    "updated": "none",
    "verified": "none",
    "confirmed": "good",
    "reverted": "bad",
    "rejected": "none",
    "unmatched": "none",
    "ambiguous": "doubt",
    "attached": "good",
    "reattached": "none",
    "detached": "bad",
    "unattached": "none",
    "disputed": "doubt",
    "disbelieved": "doubt",
    "corrected": "none",
    "renamed": "none",
    "failed": "doubt",
    "provisional": "wait",
}
_LISTED: Final = 6  # names that a sentence holds
_LONG_NAME: Final = 60  # characters of a name that fit where a line must not grow
_LONG_S: Final = 600.0
_YEAR_1971_NS: Final = 31_536_000_000_000_000  # stamps before it are counted from the first scan, and are no dates


@dataclass(frozen=True, slots=True)
class Clock:
    """Data time as people read it: since the first observation, in long missions in minutes."""

    start_ns: int
    end_ns: int

    def at(self, stamp_ns: int) -> str:
        seconds = self.seconds(stamp_ns)
        return f"{seconds:.1f} s" if not self.is_long else f"{round(seconds) // 60}:{round(seconds) % 60:02d} min"

    @property
    def is_long(self) -> bool:
        return self.seconds(self.end_ns) >= _LONG_S

    @property
    def unit(self) -> str:
        return "min" if self.is_long else "s"

    def units(self, stamp_ns: int) -> float:
        """The same as a number for axes, in ``unit``."""
        return self.seconds(stamp_ns) / (60.0 if self.is_long else 1.0)

    def seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - self.start_ns) / 1e9

    @property
    def span(self) -> str:
        return duration(self.seconds(self.end_ns))

    @property
    def date(self) -> str:
        """When the recording began, on its own clock; empty where that is no date."""
        if self.start_ns < _YEAR_1971_NS:
            return ""
        return datetime.fromtimestamp(self.start_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def duration(seconds: float) -> str:
    if seconds < _LONG_S:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 600 else f"{minutes // 60} h {minutes % 60:02d} min"


def number(value: float) -> str:
    """A number with as many digits as tell something."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞" if value > 0 else "−∞"
    if value == int(value) and abs(value) < 1e9:
        return f"{int(value):,}".replace("-", "−")
    return (f"{value:,.1f}" if 1000.0 <= abs(value) < 1e9 else f"{value:.4g}").replace("-", "−")


def count(n: int, one: str, many: str = "") -> str:
    return f"{n:,} {one if n == 1 else many or one + 's'}"


def listed(names: Sequence[str]) -> str:
    """``a, b and c``; of many the first ones and how many more there are."""
    names = [short(name) for name in names]
    shown = names if len(names) <= _LISTED else [*names[: _LISTED - 1], f"{len(names) - _LISTED + 1} more"]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}" if shown else "nobody"


def short(name: str, longest: int = _LONG_NAME) -> str:
    return name if len(name) <= longest else f"{name[: longest - 1]}…"


def size(n: int) -> str:
    return f"{n / 1e6:,.2f} MB" if n >= 1_000_000 else f"{n / 1e3:,.1f} kB" if n >= 1000 else f"{n} B"


def pose(T: Transform, scale: float, sigma: Sequence[float] | None = None) -> str:
    """Where the donor's map lies, with one standard deviation where it is known: x, y (m) and yaw (°)."""
    values = [("x", T.x_m, "m", 3), ("y", T.y_m, "m", 3), ("yaw", math.degrees(T.yaw_rad), "°", 2)]
    if abs(T.z_m) > 1e-9:
        values.insert(2, ("z", T.z_m, "m", 3))
    known = dict(zip(("x", "y", "z", "yaw"), sigma, strict=True)) if sigma is not None else {}
    known["yaw"] = math.degrees(known["yaw"]) if known else math.nan
    parts = [
        f"{name} {value:z.{digits}f}".replace("-", "−")
        + (f" ± {known[name]:.{digits}f}" if name in known and math.isfinite(known[name]) else "")
        + (f" {unit}" if unit == "m" else unit)
        for name, value, unit, digits in values
    ]
    return ", ".join(parts) + (f", scale {scale:.4g}" if scale != 1.0 else "")


def sigma_of(event: Event) -> tuple[float, float, float, float] | None:
    """Standard deviations of x, y, z (m) and yaw (rad)."""
    if event.covariance is None:
        return None
    diagonal = [math.sqrt(max(float(value), 0.0)) for value in event.covariance.diagonal()]
    return diagonal[0], diagonal[1], diagonal[2], diagonal[5]


def done_by(event: Event) -> str:
    """Who decided, as the end of a sentence."""
    return f" by {event.by}" if event.by else ""


def exactness(receiver: str, left: Exactness) -> str:
    """What a revert left behind, in a sentence."""
    if left.exact:
        return f"Exact: {receiver}’s map is, bit for bit, what it would be had this merge never happened."
    held = left.cells_contaminated
    parts = [
        f"{count(left.cells_reset, 'cell was', 'cells were')} set back to unknown",
        f"{held:,} still hold{'s' * (held == 1)} something of the donor",
        f"{left.cells_lost:,} lost evidence that was not the donor’s",
    ]
    return f"Approximate: {', '.join(parts)}."


def happened(kind: Kind) -> str:
    """The kind of an event at the beginning of a sentence."""
    return {
        "offered": "Offered",
        "rejected": "Rejected",
        "unmatched": "Not matched",
        "ambiguous": "Put off as ambiguous",
        "merged": "Merged",
        "updated": "Brought up to date",
        "verified": "Looked at",
        "confirmed": "Confirmed",
        "reverted": "Reverted",
        "attached": "Attached",
        "reattached": "Attached anew",
        "detached": "Detached",
        "unattached": "Not attached",
        "disputed": "In dispute",
        "disbelieved": "No longer believed",
        "corrected": "Corrected",
        "renamed": "Renamed",
        "failed": "Failed",
    }[kind]
