"""Nasty MCAP files: damaged, beyond the limits, with definitions that nobody writes, and lying of themselves."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator

import fuzz_mcap
from fuzz_mcap_seeds import HEAD, LIES, scans_at
from fuzz_seeds import LASER, TF, mcap_file
from nasty_case import Nasty, S, patched
from nasty_recording import recording, sound_recording

_INFO = ("info", "@/a.mcap")


def recordings() -> Iterator[Nasty]:
    yield from _spoilt()
    yield from _made()
    yield from _run()


def _spoilt() -> Iterator[Nasty]:
    """Bytes of sound files that were damaged."""
    whole = sound_recording()
    unfinished = mcap_file(types=(LASER, TF), finish=False)
    chunk = whole.index(b"\x06", 60)
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
        "noise-in-the-middle": patched(whole, len(whole) // 2, random.Random(4).randbytes(200)),
        "zeros-in-the-middle": patched(whole, len(whole) // 2, bytes(300)),
        "zeros-all": bytes(5000),
        "chunk-length-lies": patched(whole, chunk + 1, struct.pack("<Q", 1 << 62)),
        "chunk-length-negative": patched(whole, chunk + 1, b"\xff" * 8),
        "chunk-size-lies": patched(whole, chunk + 25, struct.pack("<Q", 1 << 40)),
        "chunk-sum-wrong": patched(whole, chunk + 33, b"\x01\x02\x03\x04"),
        "footer-points-nowhere": patched(whole, len(whole) - 28, struct.pack("<Q", 1 << 60)),
        "footer-points-at-start": patched(whole, len(whole) - 28, struct.pack("<Q", 8)),
        "footer-zero": patched(whole, len(whole) - 28, bytes(20)),
        "twice-in-a-row": whole + whole,
        "noise-behind-the-end": whole + random.Random(5).randbytes(100),
    }
    for name, data in spoilt.items():
        yield Nasty(f"mcap-{name}", {"a.mcap": data}, _INFO, hint="scan")
    for compression in ("zstd", "lz4"):
        packed = mcap_file(compression, types=(LASER, TF), count=6)
        at = packed.index(compression.encode()) + 40
        broken = patched(packed, at, b"\xff" * 16)
        yield Nasty(f"mcap-{compression}-broken", {"a.mcap": broken}, _INFO)


def _made() -> Iterator[Nasty]:
    """Sound files that tell odd things."""
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
        yield Nasty(f"mcap-{name}", {"a.mcap": recording(**spoil)}, _INFO, hint="scan")


def _run() -> Iterator[Nasty]:
    """Files that show what they are only when they are mapped, or beyond the limits."""
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
        "topics": ("limits: {robots: 1}\n", {"topics": 21, "scans": 2}),
        "extent": ("limits: {extent_m: 0.15}\n", {}),
    }
    for name, (text, spoil) in limited.items():
        files = {"a.mcap": recording(**spoil), "c.yaml": text.encode()}
        yield Nasty(f"limits-{name}", files, (*run, "-c", "@/c.yaml"), hint="limits.")
    many = recording(topics=150, scans=2, beams=5)
    yield Nasty("mcap-150-robots", {"a.mcap": many}, _INFO)


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
