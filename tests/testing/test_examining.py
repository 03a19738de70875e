"""How one law is examined, and what is told of it."""

from __future__ import annotations

import itertools
from typing import ClassVar

import pytest
from hypothesis import assume
from hypothesis import strategies as st

from mapgraft.contracts import UsageError
from mapgraft.testing import Drawing, Laws, NotTriedError, Outcome, examine, law, laws_of, require
from mapgraft.testing.laws import tell_pytest

COUNT = itertools.count()


class Numbers(Laws):
    """Laws of which some are kept."""

    @law("numbers are numbers")
    def test_kept(self, drawing: Drawing) -> None:
        require(drawing.draw(st.integers()) is not None, "a number is none")

    @law("numbers are small")
    def test_small(self, drawing: Drawing) -> None:
        number = drawing.draw(st.integers(0, 1000), "the number")
        require(number < 17, f"{number} is not small")

    @law("numbers divide")
    def test_divides(self, drawing: Drawing) -> None:
        drawing.note("by nothing")
        _divide(drawing.draw(st.integers(1, 9)))

    @law("chance is none")
    def test_chance(self, drawing: Drawing) -> None:
        drawing.draw(st.integers())
        require(next(COUNT) != 3, "the clock struck")

    @law("it needs something")
    def test_needs(self, drawing: Drawing) -> None:
        raise NotTriedError("nobody brought anything")

    @law("it never comes to that", vacuous="no number was even and odd")
    def test_vacuous(self, drawing: Drawing) -> None:
        drawing.draw(st.integers())

    @law("no example fits", vacuous="nothing fits")
    def test_unsatisfiable(self, drawing: Drawing) -> None:
        assume(False)


class Excused(Numbers):
    expected_failures: ClassVar[dict[str, str]] = {"small": "large ones are wanted", "kept": "who knows"}


def _divide(number: int) -> float:
    return number / 0


def outcome_of(laws: Laws, name: str) -> Outcome:
    (one,) = [one for one in laws_of(laws) if one.name == name]
    return examine(laws, one)


@pytest.mark.parametrize(
    ("name", "status", "sentence"),
    [
        ("kept", "kept", ""),
        ("small", "broken", "17 is not small [the number 17]"),
        ("divides", "broken", f"ZeroDivisionError: division by zero, in _divide of {__name__} [by nothing]"),
        ("needs", "not tried", "nobody brought anything"),
        ("vacuous", "not tried", "no number was even and odd"),
        ("unsatisfiable", "not tried", "nothing fits"),
    ],
)  # fmt: skip
def test_each_outcome_is_one_sentence(name: str, status: str, sentence: str) -> None:
    found = outcome_of(Numbers(), name)
    assert (found.status, found.sentence) == (status, sentence)


def test_what_comes_out_differently_is_broken() -> None:
    found = outcome_of(Numbers(), "chance")
    assert found.status == "broken"
    assert "it comes out differently from time to time" in found.sentence


def test_expected_failures_give_their_reason_and_must_fail() -> None:
    assert outcome_of(Excused(), "small").status == "expected failure"
    assert outcome_of(Excused(), "small").sentence == "large ones are wanted"
    stale = outcome_of(Excused(), "kept")
    assert stale.status == "kept unexpectedly"
    assert "who knows" in stale.sentence


def test_pytest_is_told() -> None:
    by_name = {one.name: one for one in laws_of(Excused)}
    tell_pytest(Numbers(), by_name["kept"])
    with pytest.raises(AssertionError, match=r"numbers are small: 17 is not small"):
        tell_pytest(Numbers(), by_name["small"])
    with pytest.raises(pytest.xfail.Exception, match="large ones are wanted"):
        tell_pytest(Excused(), by_name["small"])
    with pytest.raises(AssertionError, match="drop that"):
        tell_pytest(Excused(), by_name["kept"])
    with pytest.raises(pytest.skip.Exception, match="nobody brought anything"):
        tell_pytest(Numbers(), by_name["needs"])


def test_an_excuse_for_a_law_that_there_is_not_is_refused() -> None:
    class Misspelt(Numbers):
        expected_failures: ClassVar[dict[str, str]] = {"smal": "large ones are wanted"}

    with pytest.raises(UsageError, match="Misspelt expects smal to fail, its laws are"):
        list(laws_of(Misspelt))


def test_laws_can_be_left_out_and_replaced() -> None:
    class Fewer(Numbers):
        test_chance = None

        @law("numbers are fairly small")
        def test_small(self, drawing: Drawing) -> None:
            require(drawing.draw(st.integers(0, 1000)) < 2000, "it is large")

    names = [one.name for one in laws_of(Fewer)]
    assert "chance" not in names and names.count("small") == 1
    assert outcome_of(Fewer(), "small").status == "kept"
