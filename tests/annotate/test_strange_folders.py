"""Folders that somebody else made: names with script in them, paths that lead elsewhere, bytes that are no pictures."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from toy_examples import RUN

from mapgraft.annotate.desk import Answer, Desk
from mapgraft.annotate.opened import MOST_EXAMPLES, checked_picture, open_folders
from mapgraft.errors import MapError, OutputError, UsageError
from mapgraft.outputs.label_parts import MANY
from mapgraft.outputs.labels import label
from mapgraft.outputs.staging import JOURNAL, SUFFIX

SCRIPTS = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "'><svg onload=alert(1)>",
    "{{ 7 * 7 }}{% include '/etc/passwd' %}",
    "javascript:alert(1)",
    "</title></section><b>",
    "\N{RIGHT-TO-LEFT OVERRIDE}reversed\x1b[31m",
    "a" * 100_000,
)


class Tags(HTMLParser):
    """The tags of a page with their attributes, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


def part(out: Path) -> Path:
    (found,) = (out / "examples").glob("**/part-*.parquet")
    return found


def change(out: Path, **columns: Any) -> None:
    """Write the examples anew, with one value for all of them in some columns."""
    table = pq.ParquetFile(part(out)).read()
    for name, value in columns.items():
        at = table.schema.get_field_index(name)
        kind = table.schema.field(name).type
        kind = kind.value_type if pa.types.is_dictionary(kind) else kind
        values = value if isinstance(value, pa.Array) else pa.array([value] * len(table), kind)
        table = table.set_column(at, pa.field(name, values.type), values)
    pq.write_table(table, part(out))


@pytest.mark.parametrize("script", SCRIPTS, ids=range(len(SCRIPTS)))
def test_script_in_names_is_shown_as_text(serve: Callable, out: Path, script: str):
    change(out, receiver=script, donor=script, environment=script, recording=script, reason=script, rule=script)
    change(out, receiver_type=script, donor_type=script, compared_type=script)
    client = serve(out)
    plain = {tag for tag, _ in Tags(client.get("example/0").text).tags}
    for path in ("", "next", "example/3", "progress"):
        page = client.get(path)
        assert page.status == 200 and len(page.body) < 60_000
        tags = Tags(page.text)
        assert not {"script", "img", "b"} & {tag for tag, attributes in tags.tags if "src" not in attributes} - plain
        assert not [name for _, attributes in tags.tags for name in attributes if name.startswith("on")]
        assert not [
            value
            for _, attributes in tags.tags
            for name, value in attributes.items()
            if name in ("src", "href", "action", "hx-get", "hx-post") and value and not value.startswith(("/", "#"))
        ]
        assert "49" not in tags.text.replace("\N{REPLACEMENT CHARACTER}", "") or "7 * 7" not in script
        assert "\N{RIGHT-TO-LEFT OVERRIDE}" not in page.text and "\x1b" not in page.text
    assert client.label(3, "wrong", reason=script[:1_000]).status == 200
    revealed = Tags(client.get("revealed/3").text)
    assert not {"script", "img", "svg"} & {tag for tag, _ in revealed.tags}
    if len(script) < 100:
        assert script.split("\x1b")[0].lstrip("\N{RIGHT-TO-LEFT OVERRIDE}") in revealed.text


def test_script_in_the_words_of_others_is_shown_as_text(serve: Callable, out: Path):
    from mapgraft.examples import ExampleFolder

    key = ExampleFolder(out).keys[0]
    for by in SCRIPTS:
        label(out, key.run_id, merge_id=key.example_id, receiver="a", donor="b", verdict="right", by=by, reason=by)
    client = serve(out)
    ask = type(client)(client.port, client.token, None).get()
    for page in (ask, client.get(), client.get("progress")):
        assert page.status == 200 and len(page.body) < 60_000
        assert not {"img", "b"} & {tag for tag, attributes in Tags(page.text).tags if "onerror" in attributes}
        assert "<script>alert" not in page.text and "onerror=alert(1)>" not in page.text


@pytest.mark.parametrize("run_id", ["..", "../../elsewhere", "a/b", "", "x" * 500, "r\x00", "run_id=1"])
def test_a_run_with_a_name_that_leads_elsewhere_is_left_out(out: Path, tmp_path: Path, run_id: str):
    """A dataset tells the run in a column, which becomes the name of a folder for labels."""
    table = pq.ParquetFile(part(out)).read()
    part(out).unlink()
    where = out / "examples" / "split=train"
    where.mkdir(parents=True)
    runs = pa.array([run_id] * (len(table) - 1) + ["r1"])
    pq.write_table(table.append_column("run_id", runs), where / "part-0.parquet")
    opened = open_folders([out])
    assert len(opened) == 1 and opened.left_out == {"of a run whose name is none": 59}
    Desk(opened).say(0, "anna", Answer("right"))
    assert [path.name for path in (out / "labels").iterdir()] == ["run_id=r1"]


@pytest.mark.parametrize("name", ["labels", f"labels/run_id={RUN}"])
def test_labels_that_lead_elsewhere_are_not_followed(out: Path, tmp_path: Path, name: str):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (out / name).parent.mkdir(exist_ok=True)
    (out / name).symlink_to(elsewhere, target_is_directory=True)
    with pytest.raises(OutputError, match="is a link, which may lead out of"):
        Desk(open_folders([out])).say(0, "anna", Answer("right"))
    assert not list(elsewhere.iterdir())


@pytest.mark.parametrize("journal", ["link", "run", "nonsense"])
def test_opening_a_folder_carries_out_no_journal_but_of_words(out: Path, tmp_path: Path, journal: str):
    """Whoever made the folder has left a journal, and so many words that they are put together at the start."""
    home, run = tmp_path / "home", out / "labels" / f"run_id={RUN}"
    home.mkdir()
    run.mkdir(parents=True)
    for name in ("key", "rc"):
        (home / name).write_text("mine")
    for number in range(MANY):
        label(out, RUN, merge_id=f"alpha.beta.{number}", receiver="alpha", donor="beta", verdict="right")
    (out / "h").symlink_to(home)
    (out / f"payload{SUFFIX}").write_text("theirs")
    told = {"link": {"renamed": {f"payload{SUFFIX}": "h/rc"}, "gone": ["h/key"]}, "nonsense": "[" * 100_000}
    told["run"] = {"renamed": {f"payload{SUFFIX}": "payload"}, "gone": ["examples/part.parquet"]}
    (out / JOURNAL).write_text(json.dumps(told[journal]))
    desk = Desk(open_folders([out]))
    open_folders([out]).tidy()
    desk.say(0, "anna", Answer("right"))
    assert (out / JOURNAL).exists() and (out / f"payload{SUFFIX}").exists() and len(list(run.iterdir())) == MANY + 1
    assert {path.name: path.read_text() for path in home.iterdir()} == {"key": "mine", "rc": "mine"}


def test_what_cannot_be_written_is_said_and_not_counted(serve: Callable, out: Path):
    client = serve(out)
    n = client.get().n
    (out / "labels").write_text("in the way")
    refused = client.label(n, "right")
    assert refused.status == 503 and "in the way" in refused.text
    assert client.get().n == n and client.get(f"revealed/{n}").status == 403
    with pytest.raises(OutputError, match="labels is no folder, and answers are written to one of that name"):
        open_folders([out])
    (out / "labels").unlink()
    assert client.label(n, "right").status == 200


def bomb(width: int, height: int) -> bytes:
    """A PNG of few bytes that claims many pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (None, "no such picture"),
        (b"", "no such picture"),
        (b"<html><script>alert(1)</script></html>", "is no PNG"),
        (b"<svg xmlns='http://www.w3.org/2000/svg' onload='alert(1)'/>", "is no PNG"),
        (bomb(60_000, 60_000), "too large"),
        (bomb(8, 8) + bytes(5 * 2**20), "too large"),
    ],
    ids=["none", "empty", "html", "svg", "bomb", "long"],
)
def test_what_is_no_picture_is_not_given_to_a_browser(data: bytes | None, sentence: str):
    with pytest.raises(MapError, match=sentence):
        checked_picture(data)


def test_a_broken_picture_does_not_stop_the_queue(serve: Callable, out: Path):
    change(out, own_picture={"bytes": b"<script>", "path": None})
    client = serve(out)
    n = client.get().n
    assert client.get(f"picture/{n}/own.png").status == 503
    assert client.get(f"picture/{n}/donor.png").headers["content-type"] == "image/png"
    assert client.label(n, "unsure").n is not None


def test_numbers_that_are_none(serve: Callable, out: Path):
    """NaN and infinity where a place, a score or a size should be."""
    nan, huge = float("nan"), float("inf")
    change(out, score=nan, margin=huge, x_m=huge, receiver_resolution_m=nan, donor_resolution_m=-huge, scale=nan)
    change(out, evidence=[{"name": "posterior", "value": huge}, {"name": None, "value": None}], own_x_m=huge)
    change(out, T_receiver_donor=[nan] * 15 + [huge])
    client = serve(out)
    n = client.get().n
    assert client.get().status == 200
    for spelt in ("NaN", "Infinity", ">nan", ">inf"):
        assert spelt not in client.get().text
    assert client.label(n, "right", moved="1", x_m="1", y_m="2", yaw_rad="3").status == 200
    assert client.get(f"revealed/{n}").status == 200


def test_examples_without_pictures_are_left_out(out: Path):
    table = pq.ParquetFile(part(out)).read()
    change(out, donor_px_m=pa.array([None] * 40 + table["donor_px_m"].to_pylist()[40:], pa.float64()))
    opened = open_folders([out])
    assert len(opened) == 20 and opened.left_out == {"without pictures of both maps": 40}
    change(out, donor_px_m=None)
    with pytest.raises(UsageError, match=r"no example to judge in .*: 60 without pictures of both maps"):
        open_folders([out])


@pytest.mark.parametrize("damage", ["cut", "text", "column gone", "column of another type", "no rows"])
def test_damaged_examples_have_a_sentence(out: Path, damage: str):
    table = pq.ParquetFile(part(out)).read()
    if damage == "cut":
        part(out).write_bytes(part(out).read_bytes()[:-100])
    elif damage == "text":
        part(out).write_text("hello")
    elif damage == "column gone":
        pq.write_table(table.drop_columns(["environment"]), part(out))
    elif damage == "column of another type":
        change(out, own_px_m=pa.array(["wide"] * 60))
    else:
        pq.write_table(table.slice(0, 0), part(out))
    with pytest.raises(UsageError) as raised:
        open_folders([out])
    assert str(out) in str(raised.value) and "\n" not in str(raised.value)


def test_a_folder_that_claims_too_many_examples_is_not_read(out: Path):
    """A billion rows of one value take a few bytes in a file."""
    ids = pa.DictionaryArray.from_arrays(pa.array([0] * (MOST_EXAMPLES + 1), pa.int8()), pa.array(["alpha.beta.1"]))
    pq.write_table(pa.table({"example_id": ids}), part(out))
    with pytest.raises(UsageError, match=f"has {MOST_EXAMPLES + 1} examples, more than"):
        open_folders([out])


def test_bytes_that_were_damaged_later_are_passed_over(out: Path):
    """A disk that goes bad while somebody annotates: what cannot be read is not shown, the rest is."""
    desk = Desk(open_folders([out]))
    data = bytearray(part(out).read_bytes())
    first = desk.next("anna")
    desk.say(first, "anna", Answer("right"))
    data[4 : len(data) // 2] = bytes(len(data) // 2 - 4)
    with part(out).open("r+b") as stream:
        stream.write(data)
    seen = 0
    while (n := desk.next("anna")) is not None:
        desk.say(n, "anna", Answer("right"))
        seen += 1
    assert seen < 59


READ_ONLY = """
import os, sys
from pathlib import Path

from mapgraft.annotate.opened import open_folders
from mapgraft.errors import OutputError

if os.geteuid() == 0:
    os.setuid(65534)  # root may write anywhere
try:
    open_folders([Path(sys.argv[1])])
except OutputError as error:
    print(error)
"""


@pytest.mark.parametrize("locked", [".", "labels", f"labels/run_id={RUN}"])
def test_who_may_not_write_answers_is_told_before_the_first(out: Path, locked: str):
    open_folders([out])
    there = Path(tempfile.mkdtemp())  # where every user may come, which pytest's own folders are not for
    there.chmod(0o755)
    folder = shutil.copytree(out, there / "out")
    if locked != ".":
        (folder / locked).mkdir(parents=True)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o777)
    (folder / locked).chmod(0o555)
    done = subprocess.run([sys.executable, "-c", READ_ONLY, str(folder)], capture_output=True, text=True, check=False)
    (folder / locked).chmod(0o755)
    shutil.rmtree(there)
    assert done.stderr == ""
    assert done.stdout.startswith(f"{folder / locked} is read-only for this user, and answers are written there")
