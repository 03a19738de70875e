"""Nasty configurations and decision tables."""

from __future__ import annotations

import random
from collections.abc import Iterator

from nasty_case import LAUGHS, Nasty
from nasty_recording import sound_recording

_CONFIGS = {
    "not-yaml": "robots: [alpha\n",
    "tabs": "robots:\n\talpha: {}\n",
    "list": "- a\n- b\n",
    "scalar": "just a word\n",
    "two-documents": "mission: {}\n---\nmission: {}\n",
    "deep-lists": "rules: " + "[" * 5000 + "]" * 5000 + "\n",
    "deep-maps": "map: " + "{a: " * 3000 + "1" + "}" * 3000 + "\n",
    "deep-blocks": "".join(" " * n + "a:\n" for n in range(200)),
    "billion-laughs": LAUGHS,
    "laughs-in-rules": LAUGHS + "rules: *a8\n",
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
    "laughs": LAUGHS + "b: *a8\n",
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
