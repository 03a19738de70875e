"""Where faults are noted: which thing breaks which law, and which other laws break along with it."""

from __future__ import annotations

import beacon_laws as laws
import beacons

FAULTS: dict[tuple[type, str], tuple[type, tuple[str, ...]]] = {}
MAKERS = {
    laws.BeaconLaws: "make_map_type",
    laws.SlideLaws: "make_matcher",
    laws.SlideNearLaws: "make_matcher",
    laws.SumLaws: "make_fuser",
    laws.DisagreementLaws: "make_metric",
    laws.EchoesLaws: "make_metric",
    laws.FirstOneLaws: "make_acceptor",
    laws.AtMostLaws: "make_verifier",
    laws.ToMarksLaws: "make_conversion",
    laws.RegularLaws: "make_policy",
}


def breaks(kind, law, *along):
    """Note that a class breaks a law, and which other ones it may break."""

    def note(faulty):
        FAULTS[kind, law] = (faulty, along)
        return faulty

    return note


def faulty_laws(kind, law, examples):
    """The class of laws with the faulty thing in the good one's place."""
    faulty, _ = FAULTS[kind, law]
    given = {"limit": 0.5, "confirm_after": 3} if issubclass(faulty, beacons.AtMost) else {}
    return type(
        kind.__name__, (kind,), {MAKERS[kind]: lambda self: faulty(**given), "examples": examples, "shrinks": False}
    )()
