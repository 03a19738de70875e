"""Output folders that somebody else made: whatever lies in them, nothing outside is written, renamed or removed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path

import pytest
from plots import provenance, tell, told

from mapgraft.errors import OutputError
from mapgraft.outputs.label_parts import gather
from mapgraft.outputs.labels import label
from mapgraft.outputs.lock import LOCK, locked, settled
from mapgraft.outputs.report import publish
from mapgraft.outputs.run_folder import RunFolder
from mapgraft.outputs.staging import JOURNAL, SUFFIX, Staging

MCAP = "demo.merge.mcap"
PART = ".part-00000.parquet.partial"


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder of somebody who opens another one: nothing in it may change."""
    home = tmp_path / "home"
    for folder in ("", "run_id=r1", "sub"):
        (home / folder).mkdir()
        for name in ("key", "rc", f"x{SUFFIX}", PART, ".part-00000-x.parquet.partial", "part-00000-1.parquet"):
            (home / folder / name).write_text(json.dumps({"files": [], "mine": name}))
    (home / "journal").write_text(json.dumps({"renamed": {}, "gone": ["rc", "sub/key"]}))
    return home


@pytest.fixture
def strange(tmp_path: Path) -> Path:
    """The folder of a stranger, with nothing in it yet."""
    (tmp_path / "strange").mkdir()
    return tmp_path / "strange"


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file and folder below a folder."""
    found = sorted(folder.rglob("*"))
    return {path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None for path in found}


def begin(out: Path, renamed: dict[str, str] | None = None, gone: Sequence[str] = ()) -> None:
    """Leave a journal as a killed process does."""
    (out / JOURNAL).write_text(json.dumps({"renamed": renamed or {}, "gone": gone}))


def run(out: Path) -> None:
    """A short run that has maps, and examples beside it."""
    with RunFolder(out, "demo", "r1", provenance()) as sink:
        sink.keep("mission.json", b"{}")
        tell(sink, islice(told(), 400))


def say(out: Path) -> None:
    label(out, "r1", merge_id="a.b.1", receiver="a", donor="b", verdict="right")


def put_together(out: Path) -> None:
    gather(out, "r1", at_least=1)


def report(out: Path) -> None:
    with locked(out):
        publish(out, "a page")


def stage(out: Path) -> None:
    with locked(out):
        staging = Staging(out)
        staging.write("summary.json", b"{}")
        staging.write("sub/x", b"")
        staging.publish(gone=["rc", "sub/key"])


WRITERS = (run, say, put_together, report, stage)
FOLDERS = (
    *("maps", "trajectories", "labels", "events", "sub"),
    *("labels/run_id=r1", "labels/run_id=r2", "events/run_id=r1", "events/run_id=r2"),
)
FILES = (
    *(LOCK, JOURNAL, f"{JOURNAL}{SUFFIX}", "summary.json", f"summary.json{SUFFIX}", f"report.html{SUFFIX}"),
    *(
        f"{MCAP}{SUFFIX}",
        MCAP,
        f"maps/alpha.png{SUFFIX}",
        f"metrics/run_id=r1/{PART}",
        "labels/run_id=r1/part-1.parquet",
    ),
)


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize(
    ("link", "to"),
    [
        *((link, to) for link in FOLDERS for to in ("", "not/there")),
        *((link, to) for link in FILES for to in ("rc", "not there")),
        (JOURNAL, "journal"),
    ],
)
def test_wherever_a_link_leads_nothing_changes_there(
    home: Path, strange: Path, writer: Callable[[Path], None], link: str, to: str
) -> None:
    before = contents(home)
    (strange / link).parent.mkdir(parents=True, exist_ok=True)
    (strange / link).symlink_to(home / to)
    try:
        writer(strange)
    except OutputError as error:
        assert "\n" not in str(error) and str(strange) in str(error)
    assert contents(home) == before


@pytest.mark.parametrize(
    ("link", "said"),
    [
        *((name, "is a link, which may lead out of") for name in ("maps", "trajectories", "labels", "events")),
        ("examples/run_id=r1", "is a link, which may lead out of"),
        (LOCK, "because a link is in its place: remove it"),
    ],
)
def test_a_run_is_told_of_it_before_it_begins(home: Path, strange: Path, link: str, said: str) -> None:
    (strange / link).parent.mkdir(exist_ok=True)
    (strange / link).symlink_to(home)
    with pytest.raises(OutputError, match=said) as raised:
        RunFolder(strange, "demo", "r1", provenance(), examples=True).open()
    assert str(strange / link) in str(raised.value)
    assert {path.name for path in strange.rglob("*") if path.is_file()} <= {LOCK}


def test_links_in_the_places_of_unfinished_files_are_replaced(home: Path, strange: Path) -> None:
    for name in ("transforms.csv", "summary.json", MCAP):
        (strange / f"{name}{SUFFIX}").symlink_to(home / "key")
    run(strange)
    assert not [path for path in strange.rglob("*") if path.is_symlink()]
    assert not list(strange.rglob(f"*{SUFFIX}"))


@pytest.mark.parametrize(
    "journal",
    [
        {"renamed": {"payload.partial": "h/rc"}, "gone": []},
        {"renamed": {"h/x.partial": "h/rc"}, "gone": []},
        {"renamed": {"h/x.partial": "rc"}, "gone": []},
        {"renamed": {}, "gone": ["h/key"]},
        {"renamed": {}, "gone": ["sub/h/key"]},
        {"renamed": {"payload.partial": "rc"}, "gone": ["x", "h/key"]},
    ],
)
def test_a_journal_that_leads_out_through_a_link_is_refused_whole(home: Path, strange: Path, journal: object) -> None:
    (strange / "sub").mkdir()
    for name in ("payload.partial", "rc", "x"):
        (strange / name).write_text(f"theirs: {name}")
    (strange / JOURNAL).write_text(json.dumps(journal))
    (strange / "h").symlink_to(home)
    (strange / "sub" / "h").symlink_to(home)
    before = contents(home), {name: data for name, data in contents(strange).items() if name != LOCK}
    for writer in (settled, run, report, stage):
        with pytest.raises(OutputError, match=r"is a link, which may lead out of|is not what a run writes there"):
            writer(strange)
    assert before == (contents(home), {name: data for name, data in contents(strange).items() if name != LOCK})


@pytest.mark.parametrize(
    "journal",
    [
        '{"renamed": {"a.partial": "c", "b.partial": "c"}, "gone": []}',
        '{"renamed": {"a.partial": "b.partial", "b.partial": "c"}, "gone": []}',
        '{"renamed": {"a.partial": "a"}, "gone": ["a"]}',
        '{"renamed": {"a.partial": "a"}, "gone": ["a.partial"]}',
        '{"renamed": {"a.partial": "a"}, "gone": ["c", "c"]}',
        '{"renamed": {"a.partial": "a"}, "gone": ["./a"]}',
        '{"renamed": {"a": "c"}, "gone": []}',
        '{"renamed": {"a.partial": "sub/a"}, "gone": []}',
        '{"renamed": {}, "gone": ["sub//a"]}',
        '{"renamed": {}, "gone": ["."]}',
        '{"renamed": {}, "gone": ["a\\u0000"]}',
        '{"renamed": {}, "gone": ["\\ud800"]}',
        '{"renamed": {"a.partial": ["a"]}, "gone": []}',
        '{"renamed": {"a.partial": "a"}}',
        '{"gone": ' + "[" * 100_000,
        "\udcff",
        "",
    ],
)
def test_a_journal_that_no_run_writes_is_refused_whole(strange: Path, journal: str) -> None:
    (strange / "sub").mkdir()
    for name in ("a", "b", "c", "a.partial", "b.partial", "sub/a"):
        (strange / name).write_text(f"theirs: {name}")
    (strange / JOURNAL).write_bytes(journal.encode(errors="surrogateescape"))
    before = contents(strange)
    with pytest.raises(OutputError, match="is not what a run writes there: remove it"):
        settled(strange)
    assert {name: data for name, data in contents(strange).items() if name != LOCK} == before


def test_what_an_earlier_run_lists_elsewhere_is_none_of_its_files(home: Path, strange: Path) -> None:
    run(strange)
    (strange / "maps" / "h").symlink_to(home)
    (strange / "maps" / "old.png").write_bytes(b"")
    summary = json.loads((strange / "summary.json").read_text())
    summary["files"] += ["maps/old.png", "maps/h/key", "maps/../../home/key", str(home / "key"), "maps/\0", 7]
    (strange / "summary.json").write_text(json.dumps(summary))
    before = contents(home)
    run(strange)
    assert contents(home) == before and not (strange / "maps" / "old.png").exists()


@pytest.mark.parametrize("run_id", ["../../home/x", "r1/../../../home", "", "r*", "..", "a/b"])
def test_a_run_with_another_name_gets_no_words(home: Path, strange: Path, run_id: str) -> None:
    """A table of a stranger tells which run its examples are of."""
    before = contents(home)
    with pytest.raises(OutputError, match="which no run is"):
        label(strange, run_id, merge_id="a.b.1", receiver="a", donor="b", verdict="right")
    assert contents(home) == before and contents(strange) == {}


def test_a_pipe_in_the_place_of_the_lock_is_not_waited_for(strange: Path) -> None:
    os.mkfifo(strange / LOCK)
    with pytest.raises(OutputError, match="cannot be written"):
        run(strange)


def test_the_folder_itself_may_be_a_link(tmp_path: Path) -> None:
    """The output is on another disk, say."""
    disk, out = tmp_path / "disk", tmp_path / "out"
    disk.mkdir()
    out.symlink_to(disk)
    for writer in (run, say, run, put_together, report):
        writer(out)
    assert (disk / "summary.json").is_file() and len(list(disk.glob("labels/run_id=r1/part-*"))) == 1
    assert not list(disk.rglob(f"*{SUFFIX}"))
    (disk / f"a{SUFFIX}").write_text("new")
    (disk / "b").write_text("old")
    begin(disk, {f"a{SUFFIX}": "a"}, ["b"])
    settled(out)
    assert (disk / "a").read_text() == "new" and not (disk / "b").exists() and not (disk / JOURNAL).exists()


def test_only_words_are_settled_by_who_puts_words_together(strange: Path) -> None:
    """What a killed run had begun waits for who writes runs, or looks at them."""
    say(strange)
    for name in (f"a{SUFFIX}", "b"):
        (strange / name).write_text("theirs")
    begin(strange, {f"a{SUFFIX}": "a"}, ["b"])
    assert not gather(strange, "r1", at_least=1)
    assert (strange / JOURNAL).exists() and (strange / "b").exists()
    begin(strange, None, ["labels/run_id=r1/part-00000-1.parquet"])
    assert gather(strange, "r1", at_least=1)
    assert not (strange / JOURNAL).exists()
