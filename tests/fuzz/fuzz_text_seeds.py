"""Small logs, configurations and decision tables, sound and not, for mutations to begin from."""

from __future__ import annotations

import gzip
import json

LASER = "FLASER 3 1.0 2.0 81.9 3.0 4.0 {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"
REAR = "RLASER 2 1.0 2.0 {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"
ODOM = "ODOM {n} 0 0.1 0.5 0 0 {s} host {s}\n"
ROBOT = "ROBOTLASER1 0 -1.57 3.14 0.785 80 0.01 0 2 1 2 0 {n} 0 0.1 {n} 0 0.1 0 0 0 0 0 {s} host {s}\n"
OLD = "LASER_READING 2 1.0 2.0 {n} 0 0.1 {s}\n"
TRUE = "TRUEPOS {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"


def _log(*kinds: str, stamps=range(4)) -> bytes:
    text = "# a log\nPARAM a b\n" + "".join(k.format(n=n, s=s) for n, s in enumerate(stamps) for k in kinds)
    return text.encode()


def carmen_seeds() -> list[bytes]:
    """The first byte chooses what is asked of the log, see ``fuzz_recordings.carmen``."""
    unlike = LASER.replace("{s} host {s}", "5 host {s}")
    wide = "FLASER 400 " + "1 " * 400 + "0 0 0 0 0 0 {s} host {s}\n"
    piled = "FLASER 25 " + "9 " * 25 + "0 0 0 0 0 0 {s} host {s}\n"
    nothing = "FLASER 2 nan 0 {n} 0 0.1 {n} 0 0.1 {s} host {s}\n"
    logs = [
        _log(LASER, ODOM),
        _log(ROBOT, ODOM),
        _log(LASER, REAR, TRUE, stamps=[0.5 * n for n in range(4)]),
        _log(OLD, "ODOM {n} 0 0.1 {s}\n"),
        _log(LASER, ODOM, stamps=[0] * 4),
        _log(LASER, ODOM, stamps=[7, 7, 7, 7]),
        _log(unlike, ODOM),
        _log(LASER, stamps=[100, 101, 3, 4]),
        _log(LASER, ODOM, stamps=[100, 0, 101]) + _log(ODOM, stamps=[0, 500]),
        _log(LASER, stamps=[100, 99, 101, 98]),
        _log(LASER, ODOM, stamps=[7, 7, 7, 7]) + _log(ODOM, stamps=[9e8]),
        _log(ODOM),
        _log(ODOM, stamps=[50, 51, 2]),
        _log(wide, stamps=[1]),
        _log(piled, stamps=[1]),
        _log(nothing),
        _log(LASER.replace("81.9", "1e39")),
        _log(ROBOT.replace("0.785 80", "0 1e9")),
        _log(ROBOT.replace("0 2 1 2 0", "0 1 1 0").replace("0.785", "0")),
        _log(LASER, stamps=["nan", "1e400", "x", "1"]),
        _log(LASER, stamps=[1, 2]) + b"FLASER\nFLASER -1\nFLASER 9 1 2\nFLASER x\nODOM 1 2\nODOM\nROBOTLASER2 1 2 3\n",
        _log(LASER, stamps=[1, 2]) + b"FLASER 2 a b 0 0 0 0 0 0 3 host 3\nODOM a b c 0 0 0 3 host 3\n",
        _log(LASER) + b"x" * 1010 + b"\n" + _log(LASER),
        b"\n" * 300 + _log(LASER) + b"\n" * 300,
        _log(LASER).replace(b"\n", b"\r\n")[:-2],
        _log(LASER).replace(b"0.1", b"\xff"),
        b"",
        b"\n\n",
    ]
    packed = [gzip.compress(log, mtime=0) for log in (_log(LASER), _log(LASER) + b"\n" * 9000, b"")]
    packed += [packed[0][:-12], packed[0][:30] + b"\xff" * 9 + packed[0][39:]]
    modes = [bytes([mode]) + logs[0] for mode in (1, 2, 3, 5, 8, 11, 12, 16)]
    modes.append(b"\2" + _log(LASER, stamps=[-10, -9, 0, 1]))
    lines = [b"\x20" + log for log in (*logs[:4], *logs[18:22])]
    return [*(b"\0" + log for log in (*logs, *packed)), *modes, *lines]


def config_seeds() -> list[bytes]:
    """The first byte chooses how the rest is read, see ``fuzz_documents.config``."""
    yaml = [
        b"mission: {start: aligned, start_s: 1, end_s: 6, every: 2}\n",
        b"robots:\n  a: {source: b, files: [x], window: {start_s: 0, end_s: 5}, poses: {topic: /o, file: p.tum}}\n",
        b"map: &m {type: grid, resolution_m: 0.05}\nrobots: {a: {map: *m}}\n",
        b"priors: [{receiver: a, donor: b, x_m: 1, y_m: 2, yaw_rad: 0.5}]\nforbid: [[a, b]]\n",
        b"verdicts: [{merge: a.b.1, action: revert, by: x}]\nrules: r.yaml\n",
        b"limits: {beams: 5, plugin_s: 1.5}\noutput: {scans: true}\nexchange: {use: at, seconds: [1]}\n",
        b"a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n",
        b"? [1, 2]\n: {a: !!set {x, y}}\n'2001-01-01': 2001-01-01 00:00:00\n",
        b"reversal: lodger\nmap: 1\nrobots: {'../x': {}, 'a b': {}}\n--- 2\n",
        b"[[[[[[[[]]]]]]]]\n",
        b"<<: {a: 1}\nx: !!binary aGk=\ny: 0x1f\nz: 1e400\n",
    ]
    toml = [b"[mission]\nstart_s = 1\nend_s = 5\n", b"a = [[[[1]]]]\nb = {c = 2001-01-01}\n", b"x = 1e400\n"]
    yaml += [
        b"a: " + b"[" * 60 + b"]" * 60 + b"\n",
        b"a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
        + b"".join(b"a%d: &a%d [%b]\n" % (n, n, b", ".join([b"*a%d" % (n - 1)] * 10)) for n in range(1, 6)),
        b"a: *nothing\n",
        b'a: "\\ud800"\n',
        b"a: &a {b: &b c, d: *b}\ne: *a\n--- {}\n",
        b"",
        b"5\n",
        b"[a, b]\n",
        b"\xff\n",
        b"x: " + b"y" * 1100,
        b"robots: {a: {files: [there.mcap, nowhere.mcap], poses: {file: p.tum}}}\nrules: r.yaml\n",
        b"mission: {start_s: 5, end_s: 1}\nrobots: {a: {window: {start_s: 2, end_s: 1}}}\n",
        b"mission: {start_s: 999999999999999999999999999999999999, every: " + b"9" * 500 + b"}\n",
        b"mission: {every: 0x" + b"f" * 900 + b"}\n",
    ]
    toml += [b"[" * 900 + b"\n", b"a = 2001-99-99\n", b"a = " + b"[" * 900 + b"]" * 90, b"robots.a.files = ['x']\n"]
    documents = [json.dumps(document).encode() for document in _CONFIGS]
    return [
        *(b"y" + text for text in (*yaml, *documents)),
        *(b"t" + text for text in toml),
        *(b"j" + text for text in (*documents, b"[]", b"[" * 999, b'{"rules": [{"a": 1e999}]}')),
        *(b"f" + name for name in (b"nowhere.yaml", b"there.mcap", b"..", b"", b"a" * 99, b"a\nb")),
    ]


_CONFIGS = [
    {
        "mission": {"start": "aligned", "start_s": 1, "end_s": 6, "every": 2, "clock": "log", "common_event": "/bell"},
        "robots": {"a": {"source": "b", "files": ["x"], "window": {"start_s": 0, "end_s": 5}, "clock_offset_s": 1}},
        "map": {"type": "occupancy_grid", "resolution_m": 0.05},
        "reversal": "ledger",
        "exchange": {"use": "every", "seconds": 30},
    },
    {
        "robots": {"a": {"poses": {"topic": "/o", "max_gap_s": 1, "max_speed_m_s": 9}, "scans": ["/s"], "maps": None}},
        "priors": [{"receiver": "a", "donor": "b", "x_m": 1, "y_m": 2, "yaw_rad": 0.5, "sigma_m": 1}],
        "forbid": [["a", "b"]],
        "verdicts": [{"merge": "a.b.1", "action": "revert", "T_receiver_donor": [0.0] * 16}],
        "rules": [{"name": "r", "reject": "no"}],
        "output": {"scans": True},
        "limits": {"beams": 5, "plugin_s": 1.5, "chunk_bytes": 9, "failures": 1},
    },
    {"robots": {"../x": {}, "": {}, "a b": {}, ".": {}}, "mission": {"every": 10**400, "start_s": 9, "end_s": 1}},
]


def decision_seeds() -> list[bytes]:
    """The first byte chooses where the rules come from, see ``fuzz_documents.decision``."""
    procedure = {
        "match": {"use": "correlation"},
        "accept": {"use": "posterior"},
        "fuse": {"use": "log_odds"},
        "verify": {"use": "sequential", "metrics": ["contradiction"], "log": {"metrics": ["similarity"], "every": 9}},
    }
    measured = {"use": "thresholds", "metrics": {"similarity": {"min": 1}}, "every": 3}
    rules: list[dict[str, object]] = [
        {"name": "r", **procedure},
        {"name": "r", "when": {"own.type": "occupancy_grid", "resolution_ratio": {"min": 0.1, "max": 10}}, **procedure},
        {"name": "low", "when": {"own.known_area_m2": {"max": 1}, "prior": True}, **procedure},
        {"name": "high", "when": {"own.known_area_m2": {"min": 1e9}}, **procedure},
        {"name": "word", "when": {"own.type": {"min": 1}}, **procedure},
        {"name": "no", "when": {"own.a": [1, "x", True], "prior": False}, "reject": "never", "priority": 5},
        {"name": "r", "via": "occupancy_grid", "candidates": 2, "reverse": {"allow": ["ledger"]}, **procedure},
        {"name": "r", "via": "line_segments", **procedure},
        {"name": "r", **procedure, "match": {"use": "nosuch"}},
        {"name": "r", **procedure, "match": {"use": "line_association"}},
        {"name": "r", **procedure, "fuse": {"use": "line_union"}},
        {"name": "r", **procedure, "match": {"use": "kiss"}},
        {"name": "r", **procedure, "accept": measured, "verify": measured},
        {"name": "r", "retry": {"growth": 0.5}, "refine": {"every": None}, "metrics": {"rays": {}}, **procedure},
        {"name": "r"},
        {"name": "s", "reject": "no", "match": {"use": "x"}},
        {"when": {"odd": 1}},
        {"name": "r", "when": {"own.observations": {"min": -1, "max": 1e308}, "other.type": 5}, "reject": "x"},
    ]
    tables: list[object] = [[], {}, 5, *([rule] for rule in rules), rules[2:6], [rules[5], rules[0], 5]]
    texts = [json.dumps(table).encode() for table in tables]
    yaml = [
        b"- &a {name: r, when: {own.type: x}, reject: no}\n- *a",
        b"- {name: r, when: {own.observations: {min: .nan, max: -.inf}}, reject: x}",
        b"- name: r\n  when:\n    own.type: occupancy_grid\n  reject: |\n    no\n    never\n",
        b"- " * 60 + b"a",
        b"- {name: r\n",
        b"x: " + b"y" * 1100,
        b"\xff",
        b"- " + b"&a [" + b"x, " * 9 + b"x]\n- &b [" + b"*a, " * 50 + b"*a]\n- [" + b"*b, " * 50 + b"*b]\n- [*b]\n",
        b"- *gone\n",
        b'- {name: "\\ud800", reject: x}\n',
        b"- {name: r, reject: x}\n--- 5\n",
    ]
    facts = [b'{"own.a": true, "reversal": "ledger", "prior": false}', b'{"own.a": "x", "own.type": 3}', b"[1]", b"{"]
    return [
        *(b"j" + text for text in texts),
        *(b"j" + texts[8] + b"\0" + told for told in facts),
        *(kind + text for kind in (b"f", b"p") for text in (*texts[:6], *yaml)),
        b'j[{"name": "\\ud800"}]',
        b"j[[",
    ]
