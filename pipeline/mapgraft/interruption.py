"""Raising an error from a signal handler, but never in the middle of a compiled kernel.

Python runs signal handlers wherever Python code runs in the main thread. That may be numba's own code, which turns
what a kernel gives back into Python values (tuples with arrays, for one): nobody looks there whether an error was
raised, and it becomes a wrong result or ends the process. So an error waits until the kernel has come back.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import FrameType
from typing import Any, Final

COMPILING: Final = Path("core", "dispatcher.py")  # through which numba compiles; errors come through there

_waiting: list[tuple[BaseException, str]] = []  # each with the file whose code it spares


def interrupt(error: BaseException, frame: FrameType | None, sparing: str = "") -> None:
    """Raise an error in the code that a signal has met; where that belongs to a kernel, when the kernel has come back.

    ``frame`` is what the signal handler was given. If the error had to wait, and the first code to run again is of the
    file ``sparing``, it is dropped. Of several that wait a KeyboardInterrupt goes first, and the others are dropped.
    """
    caller = None if frame is None else caller_of_kernel(frame)
    if caller is None:
        final = isinstance(error, KeyboardInterrupt)
        if frame is not None and frame.f_code.co_filename == __file__ and not final:
            return  # another one is just being raised, which must not be lost; an alarm rings again
        if final:
            _waiting.clear()
        raise error
    _waiting.append((error, sparing))
    if len(_waiting) == 1:
        _await(caller)


def caller_of_kernel(frame: FrameType) -> FrameType | None:
    """The frame that called the kernel for which this one does something, None where it does not belong to a kernel."""
    numba = getattr(sys.modules.get("numba"), "__file__", None)
    if numba is None:
        return None
    home, caller, outermost = f"{Path(numba).parent}{os.sep}", None, ""
    at: FrameType | None = frame
    while at is not None:
        if at.f_code.co_filename.startswith(home):
            caller, outermost = at.f_back, at.f_code.co_filename
        at = at.f_back
    return None if outermost == f"{home}{COMPILING}" else caller


def _await(caller: FrameType) -> None:
    """Raise what waits at the caller's next instruction, the first after the kernel's call.

    A trace function does that, as a debugger's would: a timer would meet the next kernel where one follows another, and
    the next line may lie outside of the ``with`` or ``try`` in which the kernel was called.
    Whoever traced the program before (a debugger) is put back, but Python itself ends all tracing at an error.
    """
    before, of_caller, fine = sys.gettrace(), caller.f_trace, caller.f_trace_opcodes

    def look(frame: FrameType, _event: str, _argument: Any) -> None:
        if caller_of_kernel(frame) is not None:
            return
        sys.settrace(before)
        caller.f_trace, caller.f_trace_opcodes = of_caller, fine
        found = [error for error, sparing in _waiting if frame.f_code.co_filename != sparing]
        _waiting.clear()
        if found:
            raise min(found, key=lambda error: not isinstance(error, KeyboardInterrupt))

    caller.f_trace, caller.f_trace_opcodes = look, True
    sys.settrace(look)
