"""How two maps really lie to each other, as far as somebody knows, and whether a hypothesis is right by that."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from mapgraft.contracts import Points, Transform
from mapgraft.evaluation.truth import Error, Truth, error_of
from mapgraft.outputs.tables import Row

RECORDED: Final = "recorded poses"
GIVEN: Final = "given"

Truths = Mapping[tuple[str, str], "Known"]  # by (receiver, donor)


@dataclass(frozen=True, slots=True)
class Known:
    """Where a donor's map lies in a receiver's, None where the two do not belong together, and how that is known.

    ``truth`` is more of it, where somebody knows that already.
    """

    T_receiver_donor: Transform | None
    by: str
    scale: float = 1.0
    truth: Truth | None = None


def inverted(known: Known) -> Known:
    """The same seen from the other robot."""
    if known.T_receiver_donor is None:
        return known
    back = known.T_receiver_donor.inverse().matrix.copy()
    back[:3, 3] /= known.scale
    return Known(Transform(back), known.by, 1.0 / known.scale)


def completed(truths: Truths, robots: Iterable[str]) -> Truths:
    """With what follows for other pairs from a chain of known ones, the shortest; known pairs stay as they are."""
    out = dict(truths)
    names = sorted(robots)
    for receiver in names:
        reached: dict[str, Known] = {}
        waiting = [(receiver, Known(Transform.identity(), GIVEN))]
        while waiting:
            via, known = waiting.pop(0)
            for donor in names:
                step = truths.get((via, donor))
                if donor == receiver or donor in reached or step is None or step.T_receiver_donor is None:
                    continue
                reached[donor] = _chained(known, step)
                waiting.append((donor, reached[donor]))
        for donor, known in reached.items():
            out.setdefault((receiver, donor), known)
    return out


def _chained(a: Known, b: Known) -> Known:
    assert a.T_receiver_donor is not None and b.T_receiver_donor is not None
    T = b.T_receiver_donor.matrix.copy()
    T[:3, 3] *= a.scale
    return Known(a.T_receiver_donor @ Transform(T), b.by, a.scale * b.scale)


@dataclass(frozen=True, slots=True, eq=False)
class Yardstick:
    """The truth about two maps at one moment: walls of the donor where they belong (``points_m``), and their overlap.

    ``points_m`` is None where the two maps do not belong together: then everything is wrong.
    """

    known: Known
    points_m: Points | None
    overlap: float

    @classmethod
    def of(cls, known: Known, truth: Truth | None) -> Yardstick:
        """``truth`` is that about the two maps, None where they do not belong together."""
        return cls(known, None, 0.0) if truth is None else cls(known, truth.points_m, truth.overlap)

    def columns(self, T_receiver_donor: Transform | None, scale: float) -> Row:
        """The columns of the truth about a hypothesis, None where there is none."""
        error = self._error(T_receiver_donor, scale)
        T = self.known.T_receiver_donor
        return {
            "truth": None if T_receiver_donor is None else self.word(T_receiver_donor, scale),
            "truth_T": None if T is None else T.matrix,
            "truth_overlap": self.overlap,
            "truth_error_m": None if error is None else error.displacement_m,
            "truth_error_deg": None if error is None else error.rotation_deg,
            "truth_by": self.known.by,
        }

    def word(self, T_receiver_donor: Transform, scale: float) -> str:
        """Whether a transform is ``right`` or ``wrong``."""
        error = self._error(T_receiver_donor, scale)
        return "right" if error is not None and error.right else "wrong"

    def _error(self, T: Transform | None, scale: float) -> Error | None:
        true = self.known.T_receiver_donor
        if T is None or true is None or self.points_m is None:
            return None
        return error_of(self.points_m, true, self.known.scale, T, scale)
