"""The folder of one pairing: the picture, the merged map, and the numbers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from mapgraft.errors import PluginError
from mapgraft.matching.document import document
from mapgraft.matching.judging import Judged
from mapgraft.matching.overlay import paint, png
from mapgraft.matching.pairing import Hypothesis, Pairing
from mapgraft.matching.placing import placed_sketch, sketch
from mapgraft.outputs.fence import lies_in
from mapgraft.outputs.files import json_bytes
from mapgraft.outputs.findings import FINDINGS, findings_csv
from mapgraft.outputs.lock import locked
from mapgraft.outputs.names import file_names
from mapgraft.outputs.staging import Staging, writing
from mapgraft.procedures import Workshop

DOCUMENT = "match.json"
OVERLAY = "overlay.png"  # of an accepted hypothesis
CANDIDATE = "candidate.png"  # of one that was not
STEM = "merged"


def write_folder(out: Path, pairing: Pairing, workshop: Workshop) -> list[str]:
    """Write everything about a pairing, whole or not at all; what an earlier match left there goes.

    Returns the names of the files. Raises OutputError when the folder cannot be written.
    """
    with workshop.guard.calling("map type", pairing.a.map_type.name):
        files = _files(pairing, workshop)
    with locked(out), writing(out):
        earlier, staging = _listed(out), Staging(out)
        for name, content in files.items():
            staging.write(name, content)
        staging.write(DOCUMENT, json_bytes({**document(pairing), "files": [*files, DOCUMENT]}))  # the last one renamed
        return staging.publish(gone=earlier)


def write_judged(out: Path, judged: Sequence[Judged], workshop: Workshop) -> list[str]:
    """Write a picture of each pair with truth, and of each unrelated one that was merged: ``<id>.png``.

    Returns the names of the files. Raises OutputError when the folder cannot be written.
    """
    names = file_names()
    with locked(out), writing(out):
        staging = Staging(out)
        for one in judged:
            if one.pairing.best is not None and (one.pairing.accepted or one.pair.kind != "unrelated"):
                staging.write(f"{names[one.pair.id]}.png", picture(one.pairing, one.pairing.best, workshop))
        return staging.publish()


def picture(pairing: Pairing, hypothesis: Hypothesis, workshop: Workshop) -> bytes:
    """The two maps on each other as a hypothesis puts them."""
    a, b, match = pairing.a, pairing.b, hypothesis.match
    T = match.T_receiver_donor
    theirs = placed_sketch(workshop, a, b, T, match.scale)
    verdict = "accepted" if hypothesis.accepted else f"NOT accepted ({pairing.verdict})"
    where = f"x {T.x_m:z.2f} m, y {T.y_m:z.2f} m, yaw {math.degrees(T.yaw_rad):z.1f}°"
    names = (f"A ({a.name})", f"B ({b.name})")
    return png(*paint(sketch(a.map_type, a.view), theirs), f"{verdict}: B lies in A at {where}", names)


def _files(pairing: Pairing, workshop: Workshop) -> dict[str, bytes]:
    files: dict[str, bytes] = {}
    if pairing.best is not None:
        files[OVERLAY if pairing.best.accepted else CANDIDATE] = picture(pairing, pairing.best, workshop)
        found = [
            (pairing.a.name, pairing.b.name, "", measurement.name, finding)
            for measurement in pairing.best.measurements or ()
            for finding in measurement.findings
        ]
        if found:
            files[FINDINGS] = findings_csv(found)
    if pairing.merged is not None:
        files |= _checked(pairing.a.map_type.files(pairing.merged, STEM))
    return files


def _checked(files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    for name in files:
        if not name.startswith(STEM) or "/" in name:
            raise PluginError(f"a map type gave a file {name!r}: its name must start with {STEM!r} and hold no '/'")
    return files


def _listed(out: Path) -> list[str]:
    """The files that an earlier match in the folder lists."""
    try:
        listed = json.loads((out / DOCUMENT).read_text(encoding="utf-8"))["files"]
        return [name for name in listed if lies_in(out, name) and "/" not in name]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []
