"""How maps really lie to each other, by what people say of examples in a CSV file."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from mapgraft.examples.csv_lines import ITSELF, Line, lines_of
from mapgraft.examples.truths import GIVEN, Known
from mapgraft.persons import SAME_PLACE_M, SAME_TURN_RAD

About = TypeVar("About", bound=Hashable)


def robots_truth(path: Path, recordings: Mapping[str, str] | None = None) -> dict[tuple[str, str], Known]:
    """By (receiver, donor), where persons hold the donor's map to lie, from a file that ``exported`` has written.

    ``recordings`` are the stems of the robots' recordings: lines of other recordings are left out. Raises UsageError
    where lines about one pair contradict each other.
    """
    lines = lines_of(path, ("receiver", "donor", "label"))
    return _truths(
        (line for line in lines if recordings is None or _is_of(line, recordings)),
        lambda line: (line.text("receiver"), line.text("donor")),
    )


def examples_truth(path: Path, run_id: str) -> dict[str, Known]:
    """By example of one run or evaluation, where persons hold the donor's map to lie; raises as ``robots_truth``."""
    lines = lines_of(path, ("example_id", "label"))
    return _truths((line for line in lines if line.text("run_id") == run_id), lambda line: line.text("example_id"))


def lines_about(path: Path, recordings: Mapping[str, str], run_id: str) -> tuple[int, int]:
    """How many lines of such a file are about these robots or one run or evaluation, and how many there are."""
    lines = list(lines_of(path, ("label",)))
    used = [
        line
        for line in lines
        if line.text("run_id") == run_id
        or ({line.text("receiver"), line.text("donor")} <= recordings.keys() and _is_of(line, recordings))
    ]
    return len(used), len(lines)


def _is_of(line: Line, recordings: Mapping[str, str]) -> bool:
    """Whether a line is of these recordings; one that names none is of any."""
    if not (recorded := line.text("recording")):
        return True
    pair = {line.text("receiver"), line.text("donor")}
    return pair <= recordings.keys() and recorded == "+".join(sorted({recordings[robot] for robot in pair}))


def _truths(lines: Iterable[Line], about: Callable[[Line], About]) -> dict[About, Known]:
    """The transforms that somebody holds for right, confirmed or put right, by what the lines are about."""
    said: dict[About, list[Line]] = {}
    for line in _last(lines):
        said.setdefault(about(line), []).append(line)
    truths = {}
    for key, here in said.items():
        given = [(line, known) for line in here if (known := _held(line)) is not None]
        _require_none_called_wrong(given, here)
        if given:
            truths[key] = _agreed(given)
    return truths


def _last(lines: Iterable[Line]) -> list[Line]:
    """Of what one annotator says of one example the last; all of what names no annotator or no example.

    A line without a time is later than all that have one, and one further down later than one further up.
    """
    last: dict[tuple[str, ...], Line] = {}
    timed = [(line.said_ns(), line) for line in lines]
    for _, line in sorted(timed, key=lambda one: (one[0] is None, one[0] or 0, one[1].number)):
        who = line.text("run_id"), line.text("example_id"), line.text("annotator")
        last[who if all(who[1:]) else (str(line.number),)] = line
    return sorted(last.values(), key=lambda line: line.number)


def _held(line: Line) -> Known | None:
    """What a line tells of where the donor's map lies; raises UsageError where that is what it calls wrong."""
    T, T_judged = line.transform(), line.transform("judged_")
    if T is None or line.label() not in ("right", "wrong"):
        return None
    if line.label() == "wrong" and T_judged is not None and max(T.difference(T_judged)) < ITSELF:
        raise line.fault("it gives for right what it calls wrong: correct the label, or leave the pose out")
    return Known(T, GIVEN, line.number_of("scale") or 1.0)


def _require_none_called_wrong(given: Sequence[tuple[Line, Known]], lines: Sequence[Line]) -> None:
    """Raises UsageError where somebody calls wrong, without another place, what somebody else holds for right."""
    without = [line for line in lines if line.label() == "wrong" and line.transform() is None]
    for right in (line for line, _ in given if line.label() == "right"):
        for wrong in without:
            if _same_judged(right, wrong):
                raise wrong.fault(
                    f"this line calls wrong what line {right.number} holds for right: decide which of the two is "
                    "right, and take the other out"
                )


def _same_judged(a: Line, b: Line) -> bool:
    """Whether two lines judge the same example, with the same transform as far as they tell."""
    ids = [(line.text("run_id"), line.text("example_id")) for line in (a, b)]
    if ids[0] != ids[1] or not ids[0][1]:
        return False
    T_a, T_b = a.transform("judged_"), b.transform("judged_")
    if T_a is None or T_b is None:
        return True
    shift_m, turn_rad = T_a.difference(T_b)
    return shift_m <= SAME_PLACE_M and turn_rad <= SAME_TURN_RAD


def _agreed(given: Sequence[tuple[Line, Known]]) -> Known:
    """Of several transforms that mean one place the one in their middle, by the sum of its distances to the others."""
    first = given[0]
    for line, known in given[1:]:
        shift_m, turn_rad = _apart(first[1], known)
        if shift_m > SAME_PLACE_M or turn_rad > SAME_TURN_RAD:
            raise line.fault(
                f"this transform lies {shift_m:.2f} m and {math.degrees(turn_rad):.1f}° from that of line "
                f"{first[0].number} about the same maps: decide which of the two is right, and take the other out"
            )
    sums = [math.fsum(shift_m + turn_rad for shift_m, turn_rad in (_apart(a, b) for _, b in given)) for _, a in given]
    return given[sums.index(min(sums))][1]


def _apart(a: Known, b: Known) -> tuple[float, float]:
    assert a.T_receiver_donor is not None and b.T_receiver_donor is not None
    shift_m, turn_rad = a.T_receiver_donor.difference(b.T_receiver_donor)
    return shift_m, abs(turn_rad)
