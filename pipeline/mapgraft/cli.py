"""The command line. Results go to stdout, everything else to stderr; no traceback unless ``--debug`` asks for it."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import cast

import typer

from mapgraft.commands.app import app
from mapgraft.errors import MapgraftError
from mapgraft.interruption import interrupt

# The class of all faults on a command line; typer has kept it in different places.
USAGE_FAULT = cast("type[typer.BadParameter]", typer.BadParameter.__mro__[1])
SIGNALLED = 128  # plus its number is what a shell expects of a program that a signal ended
INTERRUPTED = SIGNALLED + signal.SIGINT
ENDING = (signal.SIGTERM, signal.SIGHUP)  # what a system that shuts down, or a terminal that is closed, sends
UNHANDLED = (signal.SIG_DFL, signal.default_int_handler)  # nohup ignores SIGHUP: that stays
_DECIDED = "what was decided before, if anything, is on disk"
LEFT = dict.fromkeys(("run", "revert", "confirm", "forbid"), _DECIDED) | {
    "corpus": "what was done before is in the data set, and the same command goes on from there",
    "evaluate": "no result was written",
}
"""What is left of commands that write while they go on, when they are ended."""

_received: list[signal.Signals] = []  # which of ENDING has ended this process


def main() -> None:
    """The entry point of the command ``mapgraft``."""
    for number in (signal.SIGINT, *ENDING):
        if signal.getsignal(number) in UNHANDLED:
            signal.signal(number, _end)
    code = invoke(sys.argv[1:])
    if code > SIGNALLED:  # at once: where Ctrl-C met code made at run time, Python would end itself by the signal
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _end(number: int, frame: FrameType | None) -> None:
    """Leave as after Ctrl-C: partial files are closed. Saying one of ENDING twice makes it no faster."""
    if number in ENDING:
        if _received:
            return
        _received.append(signal.Signals(number))
    interrupt(KeyboardInterrupt(), frame)


def invoke(arguments: list[str]) -> int:
    """Run one command line and return its exit code: 0 done, 1 the job failed, 2 wrong usage, 130 interrupted, 129 and
    143 ended by SIGHUP and SIGTERM."""
    debug = "--debug" in arguments
    try:
        code = app(args=arguments, prog_name="mapgraft", standalone_mode=False)
        return _ended(code if isinstance(code, int) else 0, arguments)
    except typer.Exit as exit_:
        return _ended(exit_.exit_code, arguments)
    except (KeyboardInterrupt, typer.Abort):
        return _ended(INTERRUPTED, arguments)
    except USAGE_FAULT as error:
        return _usage(error, arguments)
    except MapgraftError as error:
        if debug:
            raise
        return _fail(str(error), error.exit_code)
    except BrokenPipeError:
        sys.stderr.close()  # whoever read our output has gone away: nothing more to say
        return 1
    except Exception as error:
        if debug:
            raise
        return _fail(_unforeseen(error), 1)


def _unforeseen(error: Exception) -> str:
    """What nobody has asked for: any question about a path may meet a folder that this user may not enter."""
    if isinstance(error, PermissionError) and error.filename:
        return f"{error.filename} is closed to this user: check the permissions of it and of its folders"
    return f"internal error, {type(error).__name__}: {error}; run again with --debug to see where"


def _ended(code: int, arguments: list[str]) -> int:
    if code != INTERRUPTED:
        return code
    left = LEFT.get(_command(arguments), "nothing was written")
    if _received:
        return _fail(f"ended by {_received[0].name}; {left}", SIGNALLED + _received[0])
    return _fail(f"interrupted; {left}", code)


def _command(arguments: list[str]) -> str:
    return next((word for word in arguments if not word.startswith("-")), "")


def _usage(fault: typer.BadParameter, arguments: list[str]) -> int:
    """What is wrong, the nearest there is, and whose help shows what there is."""
    near: list[str] = getattr(fault, "possibilities", None) or []  # of an option that there is not, the nearest first
    sentence = f"{fault}. Did you mean '{near[0]}'?" if near else fault.format_message().rstrip(".")
    if not sentence:
        return 2  # help was shown
    path = f"mapgraft {_command(arguments)}" if fault.ctx is None else fault.ctx.command_path
    return _fail(f"{sentence}{' ' if sentence.endswith('?') else '; '}'{path} --help' shows what there is", 2)


def _fail(sentence: str, code: int) -> int:
    from mapgraft.console import plain

    sys.stderr.write(f"mapgraft: {plain(sentence)}\n")
    return code
