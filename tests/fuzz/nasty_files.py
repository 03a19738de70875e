"""Small nasty inputs, each with what mapgraft is asked to do with it; the same bytes every time.

``python tests/fuzz/nasty_files.py FOLDER`` writes them all, for whoever wants to try another program on them.
``python tests/fuzz/nasty_files.py --expected`` asks mapgraft and rewrites ``nasty_expected.json``: read the difference.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import os
import random
import struct
import sys
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import fuzz_mcap
from fuzz_bag_seeds import odd_bags, odd_databases
from fuzz_mcap_seeds import HEAD, LIES, scans_at
from fuzz_seeds import LASER, TF, mcap_file, store_of
from mcap.writer import CompressionType, Writer

EXPECTED = Path(__file__).with_name("nasty_expected.json")
S = 1_000_000_000


@dataclass(frozen=True)
class Nasty:
    """One input: files by name, the words of the command line (``@`` stands for the folder), and what to look for.

    ``hint`` picks the line of the output that is expected where the command does its work all the same.
    """

    name: str
    files: dict[str, bytes]
    command: tuple[str, ...]
    hint: str = ""
    folders: tuple[str, ...] = ()
    tags: tuple[str, ...] = field(default=())


def all_cases() -> list[Nasty]:
    """Every case, by name; names are unique."""
    cases = [
        *configs(),
        *tables(),
        *recordings(),
        *liars(),
        *times(),
        *poses(),
        *definitions(),
        *logs(),
        *maps(),
        *drawings(),
        *bags(),
        *strange(),
    ]
    names = [case.name for case in cases]
    assert len(set(names)) == len(names), sorted(name for name in names if names.count(name) > 1)
    return cases


def write(case: Nasty, folder: Path) -> list[str]:
    """Put the files of a case into a folder; returns the command line."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in case.folders:
        (folder / name).mkdir(parents=True, exist_ok=True)
    for name, data in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return [word.replace("@", str(folder)) for word in case.command]


# -- configurations ----------------------------------------------------------------------------------------------------

_LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 9)
)
_CONFIGS = {
    "not-yaml": "robots: [alpha\n",
    "tabs": "robots:\n\talpha: {}\n",
    "list": "- a\n- b\n",
    "scalar": "just a word\n",
    "two-documents": "mission: {}\n---\nmission: {}\n",
    "deep-lists": "rules: " + "[" * 5000 + "]" * 5000 + "\n",
    "deep-maps": "map: " + "{a: " * 3000 + "1" + "}" * 3000 + "\n",
    "deep-blocks": "".join(" " * n + "a:\n" for n in range(200)),
    "billion-laughs": _LAUGHS,
    "laughs-in-rules": _LAUGHS + "rules: *a8\n",
    "alias-of-itself": "map: &m {type: *m}\n",
    "alias-of-nothing": "map: *nothing\n",
    "anchor-twice": "map: &a {type: &a occupancy_grid}\nmission: {}\n",
    "duplicate-key": "mission: {}\nmission: {}\n",
    "python-object": "map: !!python/object/apply:os.system [echo hello]\n",
    "unknown-tag": "map: !danger {a: 1}\n",
    "impossible-date": "mission: {start_s: 2001-13-45}\n",
    "thousands-of-digits": "mission: {every: " + "9" * 6000 + "}\n",
    "hexadecimal-digits": "mission: {every: 0x" + "f" * 6000 + "}\n",
    "half-a-surrogate": 'map: {type: "\\ud800"}\n',
    "control-characters": "map: {type: a\x07b}\n",
    "escape-sequence": 'map: {type: "\\x1b[31mred\\x1b[0m"}\n',
    "bidirectional": 'map: {type: "\\u202Egrid"}\n',
    "unknown-key": "misson: {}\n",
    "unknown-key-with-newline": '"mission\\nmapgraft: all is well": {}\n',
    "number-as-key": "1: 2\n",
    "list-as-key": "? [a, b]\n: c\n",
    "nan-start": "mission: {start_s: .nan}\n",
    "infinite-end": "mission: {end_s: .inf}\n",
    "end-before-start": "mission: {start_s: 9, end_s: 3}\n",
    "every-zero": "mission: {every: 0}\n",
    "unknown-typestore": "mission: {typestore: ros3}\n",
    "robots-list": "robots: [alpha]\n",
    "name-climbs": 'robots: {"../../etc": {}}\n',
    "name-with-slash": "robots: {a/b: {}}\n",
    "name-dots": 'robots: {"..": {}}\n',
    "name-empty": 'robots: {"": {}}\n',
    "name-long": "robots: {" + "n" * 300 + ": {}}\n",
    "name-escapes": 'robots: {"\\e[2J": {}}\n',
    "name-nul": 'robots: {"a\\0b": {}}\n',
    "window-reversed": "robots: {scan: {window: {start_s: 5, end_s: 1}}}\n",
    "gap-negative": "robots: {scan: {poses: {max_gap_s: -1}}}\n",
    "files-elsewhere": "robots: {x: {files: [/nowhere/at/all.mcap]}}\n",
    "poses-elsewhere": "robots: {x: {source: scan, poses: {file: nowhere.tum}}}\n",
    "yaw-in-degrees": "priors: [{receiver: a, donor: b, x_m: 0, y_m: 0, yaw_rad: 90}]\n",
    "prior-for-nobody": "priors: [{receiver: a, donor: b, x_m: 0, y_m: 0, yaw_rad: 1}]\n",
    "prior-infinite": "priors: [{receiver: a, donor: b, x_m: .inf, y_m: 0, yaw_rad: 1}]\n",
    "forbid-three": "forbid: [[a, b, c]]\n",
    "verdict-short": "verdicts: [{merge: a.b.1, action: revert, T_receiver_donor: [1, 2, 3]}]\n",
    "verdict-unknown": "verdicts: [{merge: a.b.1, action: destroy}]\n",
    "reversal-unknown": "reversal: undo\n",
    "exchange-unknown": "exchange: {use: telepathy}\n",
    "exchange-parameter": "exchange: {use: every, seconds: -3}\n",
    "exchange-nameless": "exchange: {seconds: 3}\n",
    "map-unknown": "map: {type: octree}\n",
    "map-parameter": "map: {type: occupancy_grid, colour: red}\n",
    "resolution-zero": "map: {resolution_m: 0}\n",
    "resolution-nan": "map: {resolution_m: .nan}\n",
    "resolution-tiny": "map: {resolution_m: 1.0e-300}\n",
    "limits-zero": "limits: {beams: 0}\n",
    "limits-unknown": "limits: {memory: 5}\n",
    "limits-infinite": "limits: {plugin_s: .inf}\n",
    "rules-missing": "rules: nowhere.yaml\n",
    "rules-folder": "rules: ..\n",
    "rules-number": "rules: 5\n",
}


def configs() -> Iterator[Nasty]:
    sound = {"scan.mcap": sound_recording()}
    command = ("info", "@/scan.mcap", "-c", "@/c.yaml")
    for name, text in _CONFIGS.items():
        yield Nasty(f"config-{name}", {**sound, "c.yaml": text.encode()}, command)
    for name, data in {
        "latin1": b"map: {type: \xe9}\n",
        "utf16": "mission: {}\n".encode("utf-16"),
        "nul": b"\0" * 100,
        "noise": random.Random(1).randbytes(500),
        "huge": b"# " + b"x" * (1 << 21),
    }.items():
        yield Nasty(f"config-{name}", {**sound, "c.yaml": data}, command)
    toml = ("info", "@/scan.mcap", "-c", "@/c.toml")
    for name, text in {
        "toml-broken": "[mission\n",
        "toml-deep": "a = " + "[" * 5000 + "]" * 5000,
        "toml-twice": "a = 1\na = 2\n",
        "toml-date": "a = 2001-99-99\n",
        "toml-unknown": "[mision]\n",
    }.items():
        yield Nasty(f"config-{name}", {**sound, "c.toml": text.encode()}, toml)
    yield Nasty("config-missing", sound, ("info", "@/scan.mcap", "-c", "@/c.yaml"))
    yield Nasty("config-is-a-folder", sound, command, folders=("c.yaml",))


# -- decision tables ---------------------------------------------------------------------------------------------------

_PROCEDURE = "match: {use: correlation}, accept: {use: posterior}, fuse: {use: log_odds}, verify: {use: sequential}"
_TABLES = {
    "empty": "",
    "mapping": "name: r\n",
    "number": "5\n",
    "numbers": "- 5\n- 6\n",
    "deep": "- " * 2000 + "a\n",
    "laughs": _LAUGHS + "b: *a8\n",
    "broken": "- {name: r\n",
    "nothing": "- {}\n",
    "incomplete": "- {name: r, match: {use: correlation}}\n",
    "both": "- {name: r, reject: no, " + _PROCEDURE + "}\n",
    "unknown-key": "- {name: r, colour: red, " + _PROCEDURE + "}\n",
    "unknown-field": "- {name: r, when: {weather: rain}, " + _PROCEDURE + "}\n",
    "unknown-side": "- {name: r, when: {third.type: x}, " + _PROCEDURE + "}\n",
    "unknown-matcher": "- {name: r, " + _PROCEDURE.replace("correlation", "corelation") + "}\n",
    "unknown-parameter": "- {name: r, " + _PROCEDURE.replace("use: correlation", "use: correlation, luck: 7") + "}\n",
    "via-nothing": "- {name: r, via: octree, " + _PROCEDURE + "}\n",
    "no-candidates": "- {name: r, candidates: 0, " + _PROCEDURE + "}\n",
    "every-zero": "- {name: r, " + _PROCEDURE.replace("use: sequential", "use: sequential, every: 0") + "}\n",
    "growth-negative": "- {name: r, retry: {growth: -1}, " + _PROCEDURE + "}\n",
    "growth-nan": "- {name: r, refine: {growth: .nan}, " + _PROCEDURE + "}\n",
    "range-of-words": "- {name: r, when: {resolution_ratio: {min: much}}, " + _PROCEDURE + "}\n",
    "reversal-unknown": "- {name: r, reverse: {allow: [undo]}, " + _PROCEDURE + "}\n",
    "metric-unknown": "- {name: r, "
    + _PROCEDURE.replace("use: sequential", "use: sequential, metrics: [beauty]")
    + "}\n",
    "name-escapes": '- {name: "\\e[31m", colour: red, ' + _PROCEDURE + "}\n",
    "priority-huge": "- {name: r, priority: 1.5, " + _PROCEDURE + "}\n",
}


def tables() -> Iterator[Nasty]:
    sound = {"scan.mcap": sound_recording(), "c.yaml": b"rules: r.yaml\n"}
    for name, text in _TABLES.items():
        files = {**sound, "r.yaml": text.encode()}
        yield Nasty(f"rules-{name}", files, ("info", "@/scan.mcap", "-c", "@/c.yaml"))
    yield Nasty(
        "rules-noise", {**sound, "r.yaml": random.Random(2).randbytes(300)}, ("info", "@/scan.mcap", "-c", "@/c.yaml")
    )


# -- MCAP --------------------------------------------------------------------------------------------------------------


@cache
def sound_recording() -> bytes:
    """A robot called scan that stands still for three seconds."""
    return recording()


def recording(
    topic: str = "/scan",
    scans: int = 4,
    beams: int = 40,
    frame: str = "laser",
    poses: bool = True,
    x_m=lambda n: 0.1 * n,
    stamp=lambda n: n * S + S,
    topics: int = 1,
    edge: tuple[str, str] = ("map", "laser"),
    attachment: str = "",
    definition: bytes | None = None,
    schema: str = LASER,
    kind: str = "ros2msg",
    encoding: str = "cdr",
    angle: float = -1.0,
    quaternion=(0.0, 0.0, 0.0, 1.0),
    log=lambda n: n * S + S,
    tf_stamp=None,
    extra: tuple[tuple[int, str, str], ...] = (),
) -> bytes:
    """An MCAP file of one or many robots; every argument is a way to spoil it.

    ``extra`` transforms (parent, child) are told beside the n-th scan.
    """
    import numpy as np

    store, stream = store_of(2), io.BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start("ros2")
    text = store.generate_msgdef(LASER, ros_version=2)[0].encode() if definition is None else definition
    laser = writer.register_schema(schema, kind, text)
    tf = writer.register_schema(TF, "ros2msg", store.generate_msgdef(TF, ros_version=2)[0].encode())
    names = [topic] if topics == 1 else [f"/r{n}{topic}" for n in range(topics)]
    channels = [writer.register_channel(name, encoding, laser) for name in names]
    tf_channel = writer.register_channel("/tf", "cdr", tf)
    types = store.types
    for n in range(scans):
        time = types["builtin_interfaces/msg/Time"](*divmod(stamp(n), S))
        tf_time = types["builtin_interfaces/msg/Time"](*divmod((tf_stamp or stamp)(n), S))
        for number, channel in enumerate(channels):
            own = frame if topics == 1 else f"r{number}/{frame}"
            header = types["std_msgs/msg/Header"](time, own)
            ranges = np.full(beams, 2.0 + 0.01 * n, np.float32)
            scan = types[LASER](header, angle, 1.0, 0.05, 0.0, 0.1, 0.1, 30.0, ranges, np.zeros(0, np.float32))
            log_ns = log(n)
            writer.add_message(channel, log_ns, bytes(store.serialize_cdr(scan, LASER)), log_ns)
            if poses:
                told = edge if topics == 1 else (f"r{number}/map", own)
                vector = types["geometry_msgs/msg/Vector3"](float(x_m(n)), 0.0, 0.0)
                turn = types["geometry_msgs/msg/Quaternion"](*(quaternion(n) if callable(quaternion) else quaternion))
                moved = types["geometry_msgs/msg/Transform"](vector, turn)
                stamped = [
                    types["geometry_msgs/msg/TransformStamped"](
                        types["std_msgs/msg/Header"](tf_time, parent), child, moved
                    )
                    for parent, child in (told, *((parent, child) for k, parent, child in extra if k == n))
                ]
                data = bytes(store.serialize_cdr(types[TF](stamped), TF))
                writer.add_message(tf_channel, log_ns, data, log_ns)
    if attachment:
        writer.add_attachment(S, S, attachment, "text/plain", b"root::0:0\n")
    writer.finish()
    return stream.getvalue()


def _lie(data: bytes, offset: int, value: bytes) -> bytes:
    return data[:offset] + value + data[offset + len(value) :]


def recordings() -> Iterator[Nasty]:
    whole = sound_recording()
    unfinished = mcap_file(types=(LASER, TF), finish=False)
    chunk = whole.index(b"\x06", 60)
    info = ("info", "@/a.mcap")
    spoilt = {
        "empty": b"",
        "magic": b"\x89MCAP0\r\n",
        "magic-twice": b"\x89MCAP0\r\n" * 2,
        "half-a-magic": b"\x89MCA",
        "other-version": b"\x89MCAP9\r\n" + whole[8:],
        "cut-in-header": whole[:20],
        "cut-in-first-chunk": whole[: chunk + 200],
        "cut-in-half": whole[: len(whole) // 2],
        "cut-before-footer": whole[:-30],
        "cut-last-byte": whole[:-1],
        "unfinished": unfinished,
        "unfinished-cut": unfinished[:-7],
        "noise-behind-magic": b"\x89MCAP0\r\n" + random.Random(3).randbytes(2000),
        "noise-in-the-middle": _lie(whole, len(whole) // 2, random.Random(4).randbytes(200)),
        "zeros-in-the-middle": _lie(whole, len(whole) // 2, bytes(300)),
        "zeros-all": bytes(5000),
        "chunk-length-lies": _lie(whole, chunk + 1, struct.pack("<Q", 1 << 62)),
        "chunk-length-negative": _lie(whole, chunk + 1, b"\xff" * 8),
        "chunk-size-lies": _lie(whole, chunk + 25, struct.pack("<Q", 1 << 40)),
        "chunk-sum-wrong": _lie(whole, chunk + 33, b"\x01\x02\x03\x04"),
        "footer-points-nowhere": _lie(whole, len(whole) - 28, struct.pack("<Q", 1 << 60)),
        "footer-points-at-start": _lie(whole, len(whole) - 28, struct.pack("<Q", 8)),
        "footer-zero": _lie(whole, len(whole) - 28, bytes(20)),
        "twice-in-a-row": whole + whole,
        "noise-behind-the-end": whole + random.Random(5).randbytes(100),
    }
    for name, data in spoilt.items():
        yield Nasty(f"mcap-{name}", {"a.mcap": data}, info, hint="scan")
    for compression in ("zstd", "lz4"):
        packed = mcap_file(compression, types=(LASER, TF), count=6)
        at = packed.index(compression.encode()) + 40
        broken = _lie(packed, at, b"\xff" * 16)
        yield Nasty(f"mcap-{compression}-broken", {"a.mcap": broken}, info)
    made = {
        "no-messages": {"scans": 0},
        "no-poses": {"poses": False},
        "no-beams": {"beams": 0},
        "one-scan": {"scans": 1},
        "angles-nan": {"angle": float("nan")},
        "poses-nan": {"x_m": lambda n: float("nan")},
        "poses-without-rotation": {"quaternion": (0.0, 0.0, 0.0, 0.0)},
        "poses-infinite": {"x_m": lambda n: float("inf")},
        "stamps-zero": {"stamp": lambda n: 0},
        "stamps-backwards": {"stamp": lambda n: 100 * S - n * S},
        "stamps-equal": {"stamp": lambda n: 5 * S},
        "frame-of-itself": {"edge": ("laser", "laser")},
        "frame-nameless": {"edge": ("", "laser")},
        "frame-elsewhere": {"edge": ("map", "camera")},
        "frame-escapes": {"frame": "\x1b[31mlaser", "edge": ("map", "\x1b[31mlaser")},
        "topic-escapes": {"topic": "/\x1b]0;owned\x07\x1b[2Jscan"},
        "topic-c1-escapes": {"topic": "/\x9b31mscan"},
        "topic-newline": {"topic": "/scan\nmapgraft: all is well"},
        "topic-markup": {"topic": "/[bold red]scan[/]"},
        "topic-html": {"topic": "/<script>alert(1)</script>/scan"},
        "topic-climbs": {"topic": "/../../../../tmp/owned/scan"},
        "topic-bidirectional": {"topic": "/\u202enacs"},
        "topic-empty": {"topic": ""},
        "topic-long": {"topic": "/" + "x" * 5000 + "/scan"},
        "attachment-climbs": {"attachment": "../../../../etc/passwd"},
        "encoding-unknown": {"encoding": "morse"},
        "encoding-lies": {"encoding": "json"},
        "encoding-escapes": {"encoding": "\x1b[31m"},
        "schema-kind-lies": {"kind": "ros1msg"},
        "schema-kind-unknown": {"kind": "runes"},
    }
    for name, spoil in made.items():
        yield Nasty(f"mcap-{name}", {"a.mcap": recording(**spoil)}, info, hint="scan")
    run = ("run", "-q", "@/a.mcap", "-o", "@/out")
    far = {
        "one-pose-far": lambda n: 1e9 if n == 2 else 0.1 * n,
        "one-pose-out-of-town": lambda n: 2e5 if n == 2 else 0.1 * n,
        "one-pose-a-walk-away": lambda n: 3e4 if n == 2 else 0.1 * n,
        "first-pose-far": lambda n: 1e12 if n == 0 else 0.1 * n,
        "all-poses-far": lambda n: 1e15,
        "pose-beyond-numbers": lambda n: 1e300 if n == 1 else 0.0,
    }
    for name, x_m in far.items():
        yield Nasty(f"run-{name}", {"a.mcap": recording(x_m=x_m)}, run, hint="scan")
    limited = {
        "beams": ("limits: {beams: 10}\n", {}),
        "robots": ("limits: {robots: 3}\n", {"topics": 4}),
        "extent": ("limits: {extent_m: 0.15}\n", {}),
    }
    for name, (text, spoil) in limited.items():
        files = {"a.mcap": recording(**spoil), "c.yaml": text.encode()}
        yield Nasty(f"limits-{name}", files, (*run, "-c", "@/c.yaml"), hint="limits.")
    many = recording(topics=150, scans=2, beams=5)
    yield Nasty("mcap-150-robots", {"a.mcap": many}, info)


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


_RULE = "=" * 80
_DEFINITIONS = {
    "holds-itself": "sensor_msgs/LaserScan again\n",
    "circle": f"a/B b\n{_RULE}\nMSG: a/B\na/C c\n{_RULE}\nMSG: a/C\na/B b\n",
    "billion-numbers": "float64[1000000000] x\n",
    "billion-words": "string[1000000000] x\n",
    "arrays-in-arrays": f"a/B[60000] b\n{_RULE}\nMSG: a/B\na/C[60000] c\n{_RULE}\nMSG: a/C\nstring s\n",
    "sequence-of-nothing": f"a/B[] b\n{_RULE}\nMSG: a/B\n",
    "number-of-digits": "float64[" + "9" * 5000 + "] x\n",
    "negative-array": "float64[-1] x\n",
    "unknown-type": "who/Knows x\n",
    "no-grammar": "this is no definition at all {{{\n",
    "code": "float64 __import__('os')\n",
    "empty": "\n",
    "noise": random.Random(6).randbytes(400).decode("latin1"),
    "long": "# " + "x" * (1 << 20) + "\nfloat64 x\n",
    "deep": "".join(f"a/T{n} x\n{_RULE}\nMSG: a/T{n}\n" for n in range(60)) + "float64 x\n",
    "other-fields": "std_msgs/Header header\nfloat64 x\n",
}


def definitions() -> Iterator[Nasty]:
    for name, text in _DEFINITIONS.items():
        data = recording(definition=text.encode("utf-8", "replace"))
        yield Nasty(f"definition-{name}", {"a.mcap": data}, ("info", "@/a.mcap"))
    for name, schema in {
        "name-code": "a/msg/A(); import os",
        "name-empty": "",
        "name-climbs": "../../etc/passwd",
        "name-escapes": "a/msg/\x1b[31mA",
    }.items():
        yield Nasty(f"definition-{name}", {"a.mcap": recording(schema=schema)}, ("info", "@/a.mcap"), hint="/scan")


# -- MCAP files that say what is not so --------------------------------------------------------------------------------


def liars() -> Iterator[Nasty]:
    """Indexes, summaries and chunks that lie, each with right checksums but for what lies, and maps told as JSON."""
    two = (fuzz_mcap.Chunk(scans_at((1, 2, 3))), fuzz_mcap.Chunk(scans_at((4, 5))))
    for name in fuzz_mcap.WRONG:
        for crcs in (True, False):
            told = fuzz_mcap.Told(crcs=crcs, wrong=frozenset({name}))
            kind = "sealed" if crcs else "unsealed"
            data = fuzz_mcap.assembled([*HEAD, *two], told)
            yield Nasty(
                f"mcap-{kind}-{name.replace('_', '-')}-lies", {"a.mcap": data}, ("info", "@/a.mcap"), hint="scan"
            )
    for lie in LIES:
        chunk = fuzz_mcap.Chunk(scans_at((1, 2, 3)), "zstd", lie)
        data = fuzz_mcap.assembled([*HEAD, chunk, two[1]])
        yield Nasty(f"mcap-packed-chunk-{lie}-lies", {"a.mcap": data}, ("info", "@/a.mcap"), hint="scan")
    head = '"header": {"stamp": {"secs": 5, "nsecs": 0}, "frame_id": "map"}'
    info = '"info": {"width": 2, "height": 1, "resolution": 0.1, "origin": {"position": {"x": 0, "y": 0, "z": 0}, '
    info += '"orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}}'
    for name, text in {
        "without-info": f"{{{head}}}",
        "without-cells": f"{{{head}, {info}}}",
        "of-words": f'{{{head}, {info}, "data": "ab"}}',
        "of-halves": f'{{{head}, {info}, "data": [0.5, 0.5]}}',
        "of-lists": f'{{{head}, {info}, "data": [[0], [1]]}}',
    }.items():
        described = (
            fuzz_mcap.schema(1, "nav_msgs/OccupancyGrid", "jsonschema", b"{}"),
            fuzz_mcap.channel(1, 1, "/map", "json"),
        )
        data = fuzz_mcap.assembled([HEAD[0], *described, fuzz_mcap.message(1, 5 * S, text.encode())])
        yield Nasty(f"json-map-{name}", {"a.mcap": data}, ("run", "@/a.mcap", "-o", "@/out", "--no-report", "-q"))


# -- CARMEN and other text ---------------------------------------------------------------------------------------------


def logs() -> Iterator[Nasty]:
    line = "FLASER 3 1.0 2.0 3.0 {n} 0 0 {n} 0 0 {n}.5 host {n}.5\n"
    good = "".join(line.format(n=n) for n in range(6))
    spoilt: dict[str, str | bytes] = {
        "billion-beams": "FLASER 1000000000 1.0\n",
        "negative-beams": "FLASER -5 1.0 2.0 0 0 0 0 0 0 1 h 1\n",
        "beams-no-number": "FLASER many 1 2 3\n",
        "beams-of-digits": "FLASER " + "9" * 5000 + " 1 2 3\n",
        "line-ends": "FLASER 3 1.0\nFLASER\nODOM\nODOM 1 2\n",
        "poses-nan": good.replace(" 0 0 ", " nan nan "),
        "poses-infinite": good.replace(" 0 0 ", " inf 0 "),
        "ranges-nan": good.replace("1.0 2.0 3.0", "nan nan nan"),
        "ranges-huge": good.replace("1.0 2.0 3.0", "1e308 1e309 -1e308"),
        "ranges-words": good.replace("2.0", "two"),
        "stamps-nan": good.replace(".5 host", "nan host"),
        "stamps-of-million-digits": good.replace(".5 host", "e999999 host"),
        "stamps-beyond-numbers": good.replace(".5 host", "e999999999999 host"),
        "stamps-zero": "".join(line.format(n=1).replace("1.5", "0") for _ in range(5)),
        "stamps-beyond": good.replace(".5 host", "e300 host"),
        "comments": "# only\n# comments\n",
        "parameters": "PARAM a b\nSYNC x\n",
        "noise-between": good.encode() + random.Random(7).randbytes(500) + b"\n" + good.encode(),
        "nul-between": good.replace("\n", "\0\n"),
        "one-long-line": "FLASER " + "1 " * 300_000 + "\n",
        "mac-lines": good.replace("\n", "\r"),
        "no-end-of-line": good[:-1],
        "keyword-only": "FLASER",
        "escapes": good + "FLASER 3 \x1b[31m 2 3 0 0 0 0 0 0 9 h 9\n",
    }
    for name, text in spoilt.items():
        data = text if isinstance(text, bytes) else text.encode()
        yield Nasty(f"log-{name}", {"a.log": data}, ("info", "@/a.log"), hint="FLASER")
    packed = gzip.compress(good.encode(), mtime=0)
    for name, data in {
        "gzip-cut": packed[:-20],
        "gzip-broken": _lie(packed, 20, b"\xff\xff\xff\xff"),
        "gzip-of-noise": gzip.compress(random.Random(8).randbytes(200), mtime=0),
        "gzip-of-zeros": gzip.compress(bytes(50_000_000), mtime=0),
        "gzip-header": b"\x1f\x8b",
    }.items():
        yield Nasty(f"log-{name}", {"a.log.gz": data}, ("info", "@/a.log.gz"), hint="FLASER")
    for name, text in {
        "tum-short": "1.0 2.0 3.0\n",
        "tum-words": "1 2 3 4 5 6 7 w\n",
        "tum-alone": "".join(f"{n} 0 0 0 0 0 0 1\n" for n in range(9)),
        "tum-nan": "1 nan 0 0 0 0 0 1\n",
    }.items():
        yield Nasty(f"text-{name}", {"a.tum": text.encode()}, ("info", "@/a.tum"))


# -- ready maps --------------------------------------------------------------------------------------------------------


def _png(width: int, height: int, data: bytes = b"", colour: int = 0) -> bytes:
    def part(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", zlib.compress(data)) + part(b"IEND", b"")


_PGM = b"P5\n4 4\n255\n" + bytes([0, 205, 254, 254] * 4)
_MAP = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def maps() -> Iterator[Nasty]:
    info = ("info", "@/m.yaml")
    texts = {
        "nothing": "",
        "list": "- a\n",
        "no-image": _MAP.replace("image: m.pgm\n", ""),
        "image-number": _MAP.replace("m.pgm", "5"),
        "image-climbs": _MAP.replace("m.pgm", "../../../../etc/passwd"),
        "image-absolute": _MAP.replace("m.pgm", "/etc/passwd"),
        "image-device": _MAP.replace("m.pgm", "/dev/zero"),
        "image-missing": _MAP.replace("m.pgm", "n.pgm"),
        "image-itself": _MAP.replace("m.pgm", "m.yaml"),
        "image-folder": _MAP.replace("m.pgm", "."),
        "image-nul": _MAP.replace("m.pgm", '"m\\0.pgm"'),
        "image-escapes": _MAP.replace("m.pgm", '"\\e[31m.pgm"'),
        "resolution-zero": _MAP.replace("0.05", "0"),
        "resolution-negative": _MAP.replace("0.05", "-1"),
        "resolution-nan": _MAP.replace("0.05", ".nan"),
        "resolution-word": _MAP.replace("0.05", "fine"),
        "resolution-tiny": _MAP.replace("0.05", "1.0e-300"),
        "origin-short": _MAP.replace("[0, 0, 0]", "[0, 0]"),
        "origin-infinite": _MAP.replace("[0, 0, 0]", "[.inf, 0, 0]"),
        "origin-far": _MAP.replace("[0, 0, 0]", "[1.0e+18, 0, 0]"),
        "origin-word": _MAP.replace("[0, 0, 0]", "here"),
        "mode-unknown": _MAP + "mode: modern\n",
        "thresholds-reversed": _MAP.replace("0.196", "0.9"),
        "thresholds-nan": _MAP.replace("0.196", ".nan"),
        "negate-two": _MAP.replace("negate: 0", "negate: 2"),
        "deep": "image: " + "[" * 3000 + "]" * 3000 + "\n",
        "laughs": _LAUGHS + _MAP.replace("[0, 0, 0]", "*a8"),
        "python-object": _MAP + "x: !!python/object/apply:os.system [echo]\n",
        "broken": "image: [\n",
    }
    for name, text in texts.items():
        yield Nasty(f"map-{name}", {"m.yaml": text.encode(), "m.pgm": _PGM}, info, hint="m")
    images = {
        "empty": b"",
        "header": b"P5\n",
        "million-by-million": b"P5\n1000000 1000000\n255\n",
        "cut": _PGM[:-3],
        "zero-wide": b"P5\n0 4\n255\n",
        "gray-zero": b"P5\n2 2\n0\n\0\0\0\0",
        "gray-beyond": b"P5\n2 2\n70000\n\0\0\0\0",
        "gray-above": b"P5\n2 2\n100\n\xff\xff\xff\xff",
        "digits": b"P5\n" + b"9" * 4000 + b" 1\n255\n",
        "plain-words": b"P2\n2 2\n255\na b c d\n",
        "png-million-by-million": _png(1_000_000, 1_000_000),
        "png-cut": _png(4, 4, bytes(20))[:40],
        "png-noise": b"\x89PNG\r\n\x1a\n" + random.Random(9).randbytes(200),
        "noise": random.Random(10).randbytes(300),
    }
    for name, data in images.items():
        yield Nasty(f"image-{name}", {"m.yaml": _MAP.encode(), "m.pgm": data}, info)
    yield Nasty("image-without-scale", {"m.png": _png(4, 4, bytes(20))}, ("info", "@/m.png"))
    cells = {"m.yaml": _MAP.encode(), "m.pgm": _PGM, "c.yaml": b"limits: {grid_cells: 10}\n"}
    yield Nasty("limits-grid-cells", cells, ("info", "@/m.yaml", "-c", "@/c.yaml"))
    for name, command in {
        "match-nothing": ("match", "@/m.yaml"),
        "match-broken": ("match", "@/m.yaml", "@/n.yaml"),
        "match-same-twice": ("match", "@/m.yaml", "@/m.yaml", "@/m.yaml"),
    }.items():
        yield Nasty(name, {"m.yaml": _MAP.encode(), "m.pgm": _PGM, "n.yaml": b"{"}, command)


# -- clouds, segments and plans in files ------------------------------------------------------------------------------

_PCD = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n0 0 1\n1 0 1\n"
)
_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    "0 0 1\n1 0 1\n"
)
_SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm" viewBox="0 0 100 100">{}</svg>'
_XML_LAUGHS = (
    '<!DOCTYPE svg [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    + "]><svg>&i;</svg>"
)
_DXF = "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n{}\n20\n0\n11\n5\n21\n0\n0\nENDSEC\n0\nEOF\n"
_GEOJSON = '{{"type": "FeatureCollection", "unit": "m", "features": [{}]}}'
_LINE = '{{"type": "Feature", "properties": {{}}, "geometry": {{"type": "LineString", "coordinates": {}}}}}'
_FREE = (
    _LINE.format("[[0, 0], [5, 0]]")
    + ', {"type": "Feature", "properties": {"kind": "free", "cell_m": 1e-9}, "geometry": '
    '{"type": "MultiPolygon", "coordinates": [[[[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]]]]}}'
)


def drawings() -> Iterator[Nasty]:
    texts = {
        "pcd-nothing": "",
        "pcd-no-fields": _PCD.replace("FIELDS x y z\n", ""),
        "pcd-no-z": _PCD.replace("FIELDS x y z", "FIELDS x y w"),
        "pcd-sizes-lie": _PCD.replace("SIZE 4 4 4", "SIZE 4 4 3"),
        "pcd-count-negative": _PCD.replace("COUNT 1 1 1", "COUNT 1 -1 1"),
        "pcd-count-giant": _PCD.replace("COUNT 1 1 1", "COUNT 1 1 2000000000"),
        "pcd-points-giant": _PCD.replace("POINTS 2", "POINTS 2000000000").replace("ascii", "binary"),
        "pcd-points-beyond": _PCD.replace("POINTS 2", "POINTS 99999999999999999999"),
        "pcd-points-lie": _PCD.replace("POINTS 2", "POINTS 3"),
        "pcd-words": _PCD.replace("1 0 1", "one 0 1"),
        "pcd-all-nan": _PCD.replace("0 0 1", "nan nan nan").replace("1 0 1", "inf 0 1"),
        "pcd-viewpoint-words": _PCD.replace("VIEWPOINT 0 0", "VIEWPOINT here there"),
        "pcd-viewpoint-infinite": _PCD.replace("VIEWPOINT 0 0", "VIEWPOINT inf 0"),
        "pcd-encoding-unknown": _PCD.replace("DATA ascii", "DATA brotli"),
        "pcd-lzf-bomb": _PCD.replace("POINTS 2", "POINTS 134744072").replace(
            "ascii\n", "binary_compressed\n\4\0\0\0````"
        ),
        "ply-nothing": "",
        "ply-no-end": _PLY.replace("end_header", ""),
        "ply-vertices-giant": _PLY.replace("vertex 2", "vertex 2000000000").replace("ascii", "binary_little_endian"),
        "ply-vertices-negative": _PLY.replace("vertex 2", "vertex -2"),
        "ply-type-unknown": _PLY.replace("float z", "decimal z"),
        "ply-no-z": _PLY.replace("property float z\n", "").replace("0 0 1\n1 0 1", "0 0\n1 0"),
        "ply-cut": _PLY[:-6],
        "svg-nothing": "",
        "svg-laughs": _XML_LAUGHS,
        "svg-entity-of-a-file": '<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///etc/passwd">]><svg>&a;</svg>',
        "svg-deep": "<svg>" + "<g>" * 5000 + "</g>" * 5000 + "</svg>",
        "svg-endless-path": _SVG.format('<path d="M0 0' + " h1e308" * 50 + '"/>'),
        "svg-path-words": _SVG.format('<path d="M zero zero L one one"/>'),
        "svg-transform-words": _SVG.format('<g transform="turn(around)"><line x1="0" y1="0" x2="50" y2="0"/></g>'),
        "svg-transform-nan": _SVG.format(
            '<g transform="matrix(nan 0 0 1 0 0)"><line x1="0" y1="0" x2="50" y2="0"/></g>'
        ),
        "svg-no-walls": _SVG.format(""),
        "dxf-nothing": "",
        "dxf-noise": random.Random(15).randbytes(300).hex(),
        "dxf-infinite": _DXF.format("inf"),
        "dxf-words": _DXF.format("here"),
        "dxf-cut": _DXF.format("1")[:40],
        "geojson-nothing": "",
        "geojson-deep": "[" * 100_000,
        "geojson-no-features": "{}",
        "geojson-words": _GEOJSON.format(_LINE.format('["here", "there"]')),
        "geojson-infinite": _GEOJSON.format(_LINE.format("[[0, 0], [1e999, 0]]")),
        "geojson-far": _GEOJSON.format(_LINE.format("[[0, 0], [1e300, 0]]")),
        "geojson-free-giant": _GEOJSON.format(_FREE),
    }
    for name, text in texts.items():
        file = f"a.{name.partition('-')[0]}"
        yield Nasty(f"file-{name}", {file: text.encode()}, ("info", f"@/{file}"))
    far = {"a.pcd": _PCD.replace("1 0 1", "1e30 0 1").encode(), "b.geojson": b"", "c.svg": b""}
    far["b.geojson"] = _GEOJSON.format(_LINE.format("[[0, 0], [1e12, 0]]")).encode()
    far["c.svg"] = _SVG.format('<path d="M0 0 L1e30 0"/>').encode()
    for file, data in far.items():
        yield Nasty(f"run-far-{file[2:]}", {file: data}, ("run", f"@/{file}", "--out", "@/out", "--no-report", "-q"))


# -- bags, databases and what is no recording --------------------------------------------------------------------------


def bags() -> Iterator[Nasty]:
    info = ("info", "@/a.bag")
    for name, data in {
        "magic": b"#ROSBAG V2.0\n",
        "version-1": b"#ROSBAG V1.2\n" + bytes(100),
        "version-9": b"#ROSBAG V9.9\n" + bytes(100),
        "noise": b"#ROSBAG V2.0\n" + random.Random(11).randbytes(3000),
        "length-lies": b"#ROSBAG V2.0\n" + b"\xff\xff\xff\x7f" + bytes(50),
        "zeros": b"#ROSBAG V2.0\n" + bytes(5000),
    }.items():
        yield Nasty(f"bag-{name}", {"a.bag": data}, info)
    for name, data in {
        "magic": b"SQLite format 3\0",
        "noise": b"SQLite format 3\0" + random.Random(12).randbytes(5000),
        "zeros": b"SQLite format 3\0" + bytes(5000),
    }.items():
        yield Nasty(f"db3-{name}", {"a.db3": data}, ("info", "@/a.db3"))
    for name, data in odd_databases().items():
        yield Nasty(f"db3-{name}", {"a.db3": data}, ("info", "@/a.db3"), hint="scan")
    for name, data in odd_bags().items():
        yield Nasty(f"bag-{name}", {"a.bag": data}, info, hint="scan")
    head = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n"
    whole = {"b/a.mcap": sound_recording()}
    for name, text in {
        "metadata-empty": "",
        "metadata-list": "- a\n",
        "metadata-broken": "a: [\n",
        "metadata-climbs": head + "  relative_file_paths: [../../../../etc/passwd]\n",
        "metadata-absolute": head + "  relative_file_paths: [/etc/passwd]\n",
        "metadata-missing-file": head + "  relative_file_paths: [z.mcap]\n",
        "metadata-no-list": head + "  relative_file_paths: 5\n",
        "metadata-storage": head.replace("mcap", "clay") + "  relative_file_paths: [a.mcap]\n",
        "metadata-deep": "a: " + "[" * 3000 + "]" * 3000 + "\n",
        "metadata-laughs": _LAUGHS,
    }.items():
        yield Nasty(f"folder-{name}", {**whole, "b/metadata.yaml": text.encode()}, ("info", "@/b"), hint="scan")
    yield Nasty("folder-empty", {}, ("info", "@/b"), folders=("b",))
    yield Nasty("folder-without-metadata", whole, ("info", "@/b"), hint="scan")


def strange() -> Iterator[Nasty]:
    for name, data in {
        "zip": b"PK\x03\x04" + bytes(50),
        "bz2": b"BZh9" + bytes(50),
        "xz": b"\xfd7zXZ\0" + bytes(50),
        "zstd": b"\x28\xb5\x2f\xfd" + bytes(50),
        "pdf": b"%PDF-1.7\n",
        "html": b"<html><script>alert(1)</script></html>\n",
        "elf": b"\x7fELF" + bytes(100),
        "noise": random.Random(13).randbytes(1000),
        "nul": bytes(1000),
        "newlines": b"\n" * 1000,
        "spaces": b" " * 1000,
    }.items():
        yield Nasty(f"file-{name}", {"a.mcap": data}, ("info", "@/a.mcap"))
    yield Nasty("file-missing", {}, ("info", "@/a.mcap"))
    yield Nasty("file-name-escapes", {"a\x1b[31m\x07.mcap": b"x"}, ("info", "@/a\x1b[31m\x07.mcap"))
    yield Nasty("file-name-newline", {"a\nb.mcap": b"x"}, ("info", "@/a\nb.mcap"))
    whole = {"a.mcap": sound_recording()}
    yield Nasty("file-twice", whole, ("info", "@/a.mcap", "@/a.mcap"))
    yield Nasty("run-into-a-file", {**whole, "out": b""}, ("run", "-q", "@/a.mcap", "-o", "@/out"))
    yield Nasty("run-start-beyond-end", whole, ("run", "-q", "@/a.mcap", "--start", "900", "-o", "@/out"))
    yield Nasty("run-prior-nan", whole, ("run", "-q", "@/a.mcap", "--prior", "a,b=nan,0,0", "-o", "@/out"))
    yield Nasty("run-forbid-itself", whole, ("run", "-q", "@/a.mcap", "--forbid", "scan,scan", "-o", "@/out"))
    mission = {"out/mission.json": b'{"files": [' + b"[" * 3000}
    yield Nasty("revert-broken-mission", mission, ("revert", "@/out", "a.b.1"))
    yield Nasty(
        "revert-hostile-mission", {"out/mission.json": b'{"files": ["/etc/passwd"], "config": {"x": 1}}'},
        ("revert", "@/out", "a.b.1"),
    )  # fmt: skip
    lines = b"".join(b"FLASER 2 1.0 2.0 0 0 0 0 0 0 %d.0 host %d.0\n" % (n, n) for n in range(1, 30))
    bombs = {"newlines": b"\n" * (60 << 20), "one-line": b"x" * (60 << 20), "lines": b"# " + b"y" * 9998 + b"\n"}
    bombs["lines"] *= 6000
    for name, filling in bombs.items():
        yield Nasty(f"gzip-bomb-{name}", {"a.log.gz": gzip.compress(lines + filling, mtime=0)}, ("info", "@/a.log.gz"))
    trusting = {"a.mcap": whole["a.mcap"], "c.yaml": b"limits: {chunk_bytes: 10}\n"}
    yield Nasty("convert-limited", trusting, ("convert", "@/a.mcap", "@/b.mcap", "-c", "@/c.yaml"), hint="limits.")
    yield Nasty("convert-noise", {"a.bag": random.Random(14).randbytes(100)}, ("convert", "@/a.bag", "@/b.mcap"))
    yield Nasty("evaluate-noise", {"a.log": b"FLASER 1"}, ("evaluate", "@/a.log", "-q"))


# -- what comes of them ------------------------------------------------------------------------------------------------


def outcome(case: Nasty, folder: Path) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the case's command, the folder written as ``@``."""
    from mapgraft.cli import invoke

    command = write(case, folder)
    out, err, before = io.StringIO(), io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "20000"  # a terminal so wide that nothing is wrapped
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = invoke(command)
    finally:
        os.environ.pop("COLUMNS")
        os.environ.update({} if before is None else {"COLUMNS": before})
    return code, *(stream.getvalue().replace(str(folder), "@") for stream in (out, err))


def told(text: str) -> str:
    """A text without the line breaks that a terminal's width makes."""
    return " ".join(text.split())


def _expected() -> None:
    found: dict[str, dict[str, object]] = {}
    for case in all_cases():
        with tempfile.TemporaryDirectory() as name:
            code, out, err = outcome(case, Path(name))
        found[case.name] = {"code": code, "says": (told(err) if code else _picked(case, out))[:300]}
    EXPECTED.write_text(json.dumps(found, indent=1, ensure_ascii=True) + "\n")


def _picked(case: Nasty, out: str) -> str:
    """What tells most of a command that did its work: a sentence on what was lost, else the last one with the hint.

    The line of all rules tells of plugins, not of the input.
    """
    marks = ("left out", "limits.", "did not enter", "cut off", "damaged", "is lost", "cannot be", "without")
    told_all = [line for line in out.splitlines() if not line.lstrip().startswith("rules: ")]
    lines = [line for line in told_all if any(mark in line for mark in marks)]
    return told((lines or [line for line in told_all if case.hint in line] or [out])[-1])


def main() -> None:
    if sys.argv[1:] == ["--expected"]:
        _expected()
        return
    for case in all_cases():
        write(case, Path(sys.argv[1]) / case.name)


if __name__ == "__main__":
    main()
