"""Recordings whose times and poses have gone wrong."""

from __future__ import annotations

import random
from collections.abc import Iterator

from nasty_case import Nasty, S
from nasty_recording import recording


def times() -> Iterator[Nasty]:
    """Stamps and clocks gone wrong: thirty scans, one a second."""
    day, year = 86_400 * S, 365 * 86_400 * S
    stamps = {
        "zero-once": lambda n: 0 if n == 12 else n * S + S,
        "zero-every-other": lambda n: 0 if n % 2 else n * S + S,
        "zero-at-first": lambda n: 0 if n < 3 else n * S + S,
        "zero-at-last": lambda n: 0 if n > 26 else n * S + S,
        "ahead-once": lambda n: (2**31 - 1) * S if n == 12 else n * S + S,
        "ahead-at-first": lambda n: (2**31 - 1) * S if n == 0 else n * S + S,
        "back-once": lambda n: 2 * S if n == 12 else n * S + S,
        "negative-once": lambda n: -5 * S if n == 12 else n * S + S,
        "negative": lambda n: (n - 100) * S,
        "set-back": lambda n: n * S + S - (5 * S if n > 12 else 0),
        "set-forward": lambda n: n * S + S + (day if n > 12 else 0),
        "anew": lambda n: (n % 12) * S + S,
        "said-twice": lambda n: n // 2 * 2 * S + S,
        "stands-still": lambda n: min(max(n, 2), 2 if n < 20 else n - 18) * S,
        "noise": lambda n: random.Random(n).randrange(2**31) * S,
        "two-clocks-in-turn": lambda n: n * S + S + (day if n % 2 else 0),
    }
    scans = {"scans": 30, "x_m": lambda n: 0.1 * n}
    for name, stamp in stamps.items():
        data = recording(stamp=stamp, **scans, tf_stamp=lambda n: n * S + S)
        yield Nasty(f"time-{name}", {"a.mcap": data}, ("info", "@/a.mcap"), hint="scan")
        data = recording(stamp=stamp, **scans)
        yield Nasty(f"time-{name}-and-poses", {"a.mcap": data}, ("info", "@/a.mcap"), hint="scan")
    hole = {"log": lambda n: n * S + S + (50 * year if n > 12 else 0)}
    hole["stamp"] = hole["log"]
    run = ("run", "-q", "@/a.mcap", "@/b.mcap", "-o", "@/out")
    two = {"a.mcap": recording(**scans, **hole), "b.mcap": recording(**scans)}
    yield Nasty("time-hole-of-years", two, run, hint="scan")
    logs = {
        "log-zero": {"log": lambda n: 0},
        "log-and-stamp-zero": {"log": lambda n: 0, "stamp": lambda n: 0},
        "log-backwards": {"log": lambda n: (40 - n) * S},
        "log-beyond-numbers": {"log": lambda n: 2**64 - 1 - n},
        "log-ahead-once": {"log": lambda n: 2**63 if n == 12 else n * S + S},
    }
    for name, spoil in logs.items():
        yield Nasty(f"time-{name}", {"a.mcap": recording(**scans, **spoil)}, ("info", "@/a.mcap"), hint="scan")
    back = recording(**scans, stamp=stamps["set-back"])
    configs = {
        "header": "mission: {clock: header}\n",
        "log": "mission: {clock: log}\n",
        "robot": "robots: {a: {clock: log}}\n",
        "unknown": "mission: {clock: sundial}\n",
        "event-nobody-heard": "mission: {common_event: /bell}\n",
        "event-scans": "mission: {common_event: /scan}\n",
    }
    for name, text in configs.items():
        files = {"a.mcap": back, "c.yaml": text.encode()}
        yield Nasty(f"time-clock-{name}", files, ("info", "@/a.mcap", "-c", "@/c.yaml"), hint="scan")


def poses() -> Iterator[Nasty]:
    """Poses and frames gone wrong: thirty scans, one a second."""
    turns = [(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0)]
    made = {
        "jump-once": {"x_m": lambda n: 900.0 if n == 12 else 0.1 * n},
        "jump-and-stay": {"x_m": lambda n: 900.0 if n > 12 else 0.1 * n},
        "jump-to-and-fro": {"x_m": lambda n: 900.0 if n % 2 else 0.1 * n},
        "jump-everywhere": {"x_m": lambda n: random.Random(n).uniform(-2e4, 2e4)},
        "turn-to-and-fro": {"quaternion": lambda n: turns[n % 2]},
        "nan-once": {"x_m": lambda n: float("nan") if n == 12 else 0.1 * n},
        "nan-every-other": {"x_m": lambda n: float("nan") if n % 2 else 0.1 * n},
        "without-rotation-once": {"quaternion": lambda n: (0.0, 0.0, 0.0, 0.0) if n == 12 else turns[0]},
        "rotation-infinite-once": {"quaternion": lambda n: (0.0, 0.0, 0.0, float("inf")) if n == 12 else turns[0]},
        "rotation-long": {"quaternion": lambda n: (0.0, 0.0, 0.0, 1e200)},
        "begin-late": {"tf_stamp": lambda n: (n + 25) * S},
        "end-early": {"tf_stamp": lambda n: n * S - 25 * S},
        "of-another-clock": {"tf_stamp": lambda n: n * S + 9_000 * S},
        "stamps-zero": {"tf_stamp": lambda n: 0},
        "stamp-zero-once": {"tf_stamp": lambda n: 0 if n == 12 else n * S + S},
        "stamp-ahead-once": {"tf_stamp": lambda n: (2**31 - 1) * S if n == 12 else n * S + S},
        "two-parents": {"extra": tuple((n, "odom", "laser") for n in range(5, 30))},
        "two-parents-and-two-ways": {
            "extra": tuple((n, *edge) for n in range(30) for edge in (("odom", "laser"), ("map", "odom")))
        },
        "two-parents-once": {"extra": ((12, "odom", "laser"),)},
        "loop": {"extra": ((12, "laser", "map"),)},
        "loop-aside": {"extra": ((12, "cup", "table"), (13, "table", "cup"))},
        "loop-of-many": {"extra": tuple((n, f"f{n}", f"f{(n + 1) % 30}") for n in range(30))},
        "many-frames": {"extra": tuple((n, "map", f"f{n}-{k}") for n in range(30) for k in range(100))},
        "ladder": {"extra": tuple((n, f"l{n}-{a}", f"l{n + 1}-{b}") for n in range(30) for a in "ab" for b in "ab")},
        "ladder-to-the-sensor": {
            "extra": (
                *((n, f"l{n}-{a}", f"l{n + 1}-{b}") for n in range(29) for a in "ab" for b in "ab"),
                (29, "l29-a", "map"),
            )
        },
    }
    for name, spoil in made.items():
        data = recording(scans=30, **{"x_m": lambda n: 0.1 * n, **spoil})
        yield Nasty(f"poses-{name}", {"a.mcap": data}, ("info", "@/a.mcap"), hint="scan")
    for name in ("jump-once", "two-parents-and-two-ways", "loop"):
        data = recording(scans=30, **{"x_m": lambda n: 0.1 * n, **made[name]})
        yield Nasty(f"poses-{name}-run", {"a.mcap": data}, ("run", "-q", "@/a.mcap", "-o", "@/out"), hint="scan")
