"""On what machine, and beside how much other work, times were taken."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from pathlib import Path

_CPUINFO = Path("/proc/cpuinfo")  # of Linux
_MODEL = "model name"


@dataclass(frozen=True, slots=True)
class Timing:
    """How long everything took, from reading to written files, and what that depends on.

    ``cpus`` are those that the process may use. ``processor`` is its model, empty where nobody tells. ``load`` is the
    mean number of processes that wanted to run in the last 1, 5 and 15 minutes, empty where the system keeps no count.
    """

    whole_s: float
    cpus: int
    processor: str
    load: tuple[float, ...]


def timing(whole_s: float) -> Timing:
    """What took so long, on this machine, now."""
    allowed = getattr(os, "sched_getaffinity", None)
    cpus = len(allowed(0)) if allowed is not None else os.cpu_count() or 1
    return Timing(whole_s, cpus, _processor(), _load())


def _processor() -> str:
    try:
        lines = _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = (value.strip() for name, _, value in (line.partition(":") for line in lines) if name.strip() == _MODEL)
    return next(models, "") or platform.processor()


def _load() -> tuple[float, ...]:
    try:
        return os.getloadavg()
    except (AttributeError, OSError):  # not on this system, or not to be had
        return ()
