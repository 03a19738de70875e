"""Nasty logs, ready maps, clouds, segments and plans."""

from __future__ import annotations

import gzip
import random
import struct
import zlib
from collections.abc import Iterator

from nasty_case import LAUGHS, Nasty, patched


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
        "gzip-broken": patched(packed, 20, b"\xff\xff\xff\xff"),
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
    yield from _descriptions()
    yield from _images()
    cells = {"m.yaml": _MAP.encode(), "m.pgm": _PGM, "c.yaml": b"limits: {grid_cells: 10}\n"}
    yield Nasty("limits-grid-cells", cells, ("info", "@/m.yaml", "-c", "@/c.yaml"))
    for name, command in {
        "match-nothing": ("match", "@/m.yaml"),
        "match-broken": ("match", "@/m.yaml", "@/n.yaml"),
        "match-same-twice": ("match", "@/m.yaml", "@/m.yaml", "@/m.yaml"),
    }.items():
        yield Nasty(name, {"m.yaml": _MAP.encode(), "m.pgm": _PGM, "n.yaml": b"{"}, command)


def _descriptions() -> Iterator[Nasty]:
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
        "laughs": LAUGHS + _MAP.replace("[0, 0, 0]", "*a8"),
        "python-object": _MAP + "x: !!python/object/apply:os.system [echo]\n",
        "broken": "image: [\n",
    }
    for name, text in texts.items():
        yield Nasty(f"map-{name}", {"m.yaml": text.encode(), "m.pgm": _PGM}, ("info", "@/m.yaml"), hint="m")


def _images() -> Iterator[Nasty]:
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
        yield Nasty(f"image-{name}", {"m.yaml": _MAP.encode(), "m.pgm": data}, ("info", "@/m.yaml"))
    yield Nasty("image-without-scale", {"m.png": _png(4, 4, bytes(20))}, ("info", "@/m.png"))


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
