"""Ctrl-C at a line that is chosen: a signal from outside comes anywhere, and mostly not where it would hurt."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

Line = tuple[str, int]  # file and number


@contextmanager
def interrupted(wanted: Callable[[CodeType], bool], at: Line | None = None) -> Iterator[list[Line]]:
    """KeyboardInterrupt comes where the line ``at`` is about to be executed for the first time inside.

    Yields the lines of the code that is ``wanted``, in the order in which they are executed for the first time.
    """
    seen: dict[Line, None] = {}
    before = sys.gettrace()

    def on_call(frame: FrameType, event: str, given: Any) -> Any:
        return on_line if wanted(frame.f_code) else None

    def on_line(frame: FrameType, event: str, given: Any) -> Any:
        line = (frame.f_code.co_filename, frame.f_lineno)
        if event == "line" and line not in seen:
            seen[line] = None
            lines.append(line)
            if line == at:
                raise KeyboardInterrupt
        return on_line

    lines: list[Line] = []
    sys.settrace(on_call)
    try:
        yield lines
    finally:
        sys.settrace(before)


def of_modules(*names: str) -> Callable[[CodeType], bool]:
    """Code of modules, by the names of their files."""
    return lambda code: Path(code.co_filename).name in names
