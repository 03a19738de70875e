"""What metrics found at single places: the latest of each standing merge, as a table and as lines for viewers."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence

from mapgraft.contracts import Finding
from mapgraft.events import Event

FINDINGS = "findings.csv"
TOPIC = "findings"  # below the robot's name
_COLUMNS = (
    *("receiver", "donor", "merge_id", "metric", "kind", "value", "unit"),
    *("x0_m", "y0_m", "z0_m", "x1_m", "y1_m", "z1_m"),
)
_LINE_LIST, _ADD, _DELETE_ALL = 5, 0, 3
_WIDTH_M = 0.12
_COLOURS = ((0.9, 0.2, 0.2), (0.95, 0.6, 0.1), (0.2, 0.5, 0.95), (0.2, 0.7, 0.4), (0.6, 0.3, 0.7))  # red, green, blue


class LatestFindings:
    """Follows the events and keeps what was found last of each merge that stands."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[Event, dict[str, Sequence[Finding]]]] = {}

    def happened(self, event: Event) -> bool:
        """Take in one event; True when what is to be shown of its merge has changed."""
        if event.kind == "reverted":
            return self._found.pop(event.merge_id, None) is not None
        told = {m.name: m.findings for m in event.measurements if m.findings}
        if not told or event.state not in ("provisional", "confirmed"):
            return False
        before = self._found[event.merge_id][1] if event.merge_id in self._found else {}
        self._found[event.merge_id] = (event, {**before, **told})
        return True

    def of_receiver(self, receiver: str) -> list[Finding]:
        """All findings in one robot's map."""
        return [
            finding
            for event, told in self._found.values()
            if event.receiver == receiver
            for findings in told.values()
            for finding in findings
        ]

    def csv(self) -> bytes | None:
        """``findings.csv``; None when nothing was found."""
        if not self._found:
            return None
        rows = [
            (event.receiver, event.donor, event.merge_id, metric, finding)
            for event, told in self._found.values()
            for metric, findings in told.items()
            for finding in findings
        ]
        return findings_csv(rows)


def findings_csv(rows: Sequence[tuple[str, str, str, str, Finding]]) -> bytes:
    """A table of (receiver, donor, merge id, metric, finding)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for receiver, donor, merge_id, metric, f in rows:
        writer.writerow([receiver, donor, merge_id, metric, f.kind, f"{f.value:.6g}", f.unit, *f.start_m, *f.end_m])
    return text.getvalue().encode()


def finding_markers(findings: Sequence[Finding]) -> Mapping[str, object]:
    """The fields of a MarkerArray that wipes what was drawn before and draws one list of lines for each kind."""
    kinds = sorted({finding.kind for finding in findings})
    lines: list[dict[str, object]] = []
    for number, kind in enumerate(kinds):
        r, g, b = _COLOURS[number % len(_COLOURS)]
        ends = [end for finding in findings if finding.kind == kind for end in (finding.start_m, finding.end_m)]
        lines.append(
            {
                "ns": kind,
                "type": _LINE_LIST,
                "action": _ADD,
                "pose": {"orientation": {"w": 1.0}},
                "scale": {"x": _WIDTH_M},
                "color": {"r": r, "g": g, "b": b, "a": 1.0},
                "points": [dict(zip("xyz", end, strict=True)) for end in ends],
            }
        )
    return {"markers": [{"action": _DELETE_ALL}, *lines]}
