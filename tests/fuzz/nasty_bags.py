"""Nasty bags and databases, and what is no recording at all."""

from __future__ import annotations

import gzip
import random
from collections.abc import Iterator

from fuzz_bag_seeds import odd_bags, odd_databases, running_databases
from nasty_case import LAUGHS, Nasty
from nasty_recording import sound_recording


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
    for name, data in {**odd_databases(), **running_databases()}.items():
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
        "metadata-laughs": LAUGHS,
        "metadata-again": head + "  relative_file_paths: [" + "a.mcap, " * 5000 + "a.mcap]\n",
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
