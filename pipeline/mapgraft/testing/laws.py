"""What a law is: something a plugin must keep for everything that hypothesis can think of, examined one by one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeVar

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.errors import Flaky, Unsatisfiable

from mapgraft.errors import MapgraftError, UsageError

Drawn = TypeVar("Drawn")
Status = Literal["kept", "broken", "expected failure", "kept unexpectedly", "not tried"]


class BrokenLawError(AssertionError):
    """A law is broken; the text is one clause that says what was found."""


class NotTriedError(MapgraftError):
    """A law cannot be examined; the text says what is missing."""


class Drawing:
    """What one example of a law is made of: drawn from hypothesis, and kept to be told when the law breaks."""

    def __init__(self, data: st.DataObject, example: Example) -> None:
        self._data = data
        self._example = example
        example.drawn.clear()

    def draw(self, strategy: st.SearchStrategy[Drawn], label: str = "") -> Drawn:
        """One value; with a ``label`` it is told as part of the counterexample."""
        value = self._data.draw(strategy, label or None)
        if label:
            self._example.drawn.append(f"{label} {value}")
        return value

    def note(self, text: str) -> None:
        """Tell this as part of the counterexample, too."""
        self._example.drawn.append(text)

    def reached(self) -> None:
        """The example has come to what the law is about."""
        self._example.reached += 1


class Example:
    """The latest example: what was drawn, and how many examples came to the point."""

    def __init__(self) -> None:
        self.drawn: list[str] = []
        self.reached = 0


@dataclass(frozen=True, slots=True)
class Law:
    """One law: its name, what it says, how it is examined, and why it may come out that nothing was examined."""

    name: str
    sentence: str
    check: Callable[[Any, Drawing], None]
    vacuous: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one law; ``sentence`` says why, or what the smallest counterexample is."""

    law: Law
    status: Status
    sentence: str = ""
    error: BaseException | None = None


class Laws:
    """What all classes of laws have in common.

    A subclass whose name begins with ``Test`` is collected by pytest. ``expected_failures`` maps the names of laws
    (the test's name without ``test_``) to the reason why they cannot be kept; one that is kept after all is a failure,
    so that no excuse outlives its reason. ``examples`` is how many examples are tried, ``shrinks`` whether a
    counterexample is made as small as possible. All examples are the same in every run.
    """

    expected_failures: ClassVar[Mapping[str, str]] = {}
    examples: ClassVar[int] = 25
    shrinks: ClassVar[bool] = True


def law(sentence: str, *, vacuous: str = "") -> Callable[[Callable[[Any, Drawing], None]], Callable[[Any], None]]:
    """Make a test of a method that checks one example and raises ``BrokenLawError`` (see ``require``).

    With ``vacuous``, a law of which no example called ``Drawing.reached`` counts as not tried, for that reason.
    """

    def mark(check: Callable[[Any, Drawing], None]) -> Callable[[Any], None]:
        made = Law(check.__name__.removeprefix("test_"), sentence, check, vacuous)

        def test(self: Laws) -> None:
            __tracebackhide__ = True
            tell_pytest(self, made)

        test.__name__, test.__qualname__, test.__module__ = check.__name__, check.__qualname__, check.__module__
        test.__doc__ = sentence
        test.__dict__["law"] = made
        return test

    return mark


def laws_of(laws: Laws | type[Laws]) -> Iterator[Law]:
    """The laws of a class and its bases, in the order in which they are written.

    Raises UsageError when a failure is expected of a law that there is not.
    """
    kind = laws if isinstance(laws, type) else type(laws)
    names = dict.fromkeys(name for base in inspect.getmro(kind) for name in vars(base))
    found = [value.law for name in names if hasattr(value := getattr(kind, name), "law")]
    known = [made.name for made in found]
    if unknown := sorted(set(kind.expected_failures) - set(known)):
        raise UsageError(
            f"{kind.__name__} expects {', '.join(unknown)} to fail, its laws are {', '.join(sorted(known))}"
        )
    yield from found


def require(holds: object, clause: str | Callable[[], str]) -> None:
    """Raise ``BrokenLawError`` with the clause unless it holds."""
    if not holds:
        raise BrokenLawError(clause if isinstance(clause, str) else clause())


def examine(laws: Laws, law: Law) -> Outcome:
    """Try the law on many examples; nothing that the plugin does wrong is raised."""
    reason = laws.expected_failures.get(law.name)
    example = Example()
    error = _first_failure(laws, law, example)
    if isinstance(error, NotTriedError):
        return Outcome(law, "not tried", str(error), error)
    if isinstance(error, Unsatisfiable):
        return Outcome(law, "not tried", law.vacuous or "no example could be made that has anything to examine", error)
    if error is not None:
        if reason is not None:
            return Outcome(law, "expected failure", reason, error)
        return Outcome(law, "broken", _counterexample(error, example), error)
    if reason is not None:
        return Outcome(law, "kept unexpectedly", f"it was declared an expected failure ({reason}): drop that")
    if law.vacuous and not example.reached:
        return Outcome(law, "not tried", law.vacuous)
    return Outcome(law, "kept")


def tell_pytest(laws: Laws, law: Law) -> None:
    """Examine the law and tell pytest: a failure with its counterexample, an expected one, or a skip."""
    import pytest

    __tracebackhide__ = True
    list(laws_of(laws))
    outcome = examine(laws, law)
    if outcome.status == "not tried":
        pytest.skip(outcome.sentence)
    if outcome.status == "expected failure":
        pytest.xfail(outcome.sentence)
    if outcome.status != "kept":
        raise AssertionError(f"{law.sentence}: {outcome.sentence}") from outcome.error


def _first_failure(laws: Laws, law: Law, example: Example) -> BaseException | None:
    phases = (Phase.generate, Phase.shrink) if laws.shrinks else (Phase.generate,)

    @settings(
        max_examples=laws.examples,
        phases=phases,
        deadline=None,
        database=None,
        derandomize=True,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
        print_blob=False,
    )
    @given(st.data())
    def attempt(data: st.DataObject) -> None:
        law.check(laws, Drawing(data, example))

    try:
        attempt()
    except Exception as error:  # a stranger's code may fail in any way, and that is what is looked for
        error.__notes__ = []  # hypothesis lists all that it drew, arrays and all; we say it in a sentence
        return error
    return None


def _counterexample(error: BaseException, example: Example) -> str:
    """One sentence: what was found, and with which example."""
    if isinstance(error, Flaky):
        causes = [str(cause) for cause in getattr(error, "exceptions", ()) if isinstance(cause, BrokenLawError)]
        found = f"it comes out differently from time to time ({causes[0] if causes else 'same example, same plugin'})"
    elif isinstance(error, BrokenLawError):
        found = str(error)
    else:
        found = f"{type(error).__name__}: {error}{_where(error)}"
    return f"{found} [{'; '.join(example.drawn)}]" if example.drawn else found


def _where(error: BaseException) -> str:
    """In which function the plugin failed: the innermost frame that is not the kit's own."""
    trace, found = error.__traceback__, ""
    while trace is not None:
        name = trace.tb_frame.f_globals.get("__name__", "")
        if not name.startswith(("mapgraft.testing", "hypothesis")):
            found = f", in {trace.tb_frame.f_code.co_qualname} of {name}"
        trace = trace.tb_next
    return found
