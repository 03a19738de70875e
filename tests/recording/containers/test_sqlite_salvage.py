"""Databases of ROS 2 bags that were cut off or damaged: the rows of all pages that are left are read."""

from __future__ import annotations

import random
import sqlite3
import struct
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.bag_folder import BagFolderSource
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.sqlite_file import SqliteSource

THOROUGH = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
PAGE = 4096
TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL,
  offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""

Row = tuple[str, int, bytes]


class Bag:
    """A database, what it holds, and by log time the pages that each message lies on."""

    def __init__(self, whole: bytes, rows: list[Row], pages: dict[int, set[int]]) -> None:
        self.whole, self.rows, self.pages = whole, rows, pages


def given_by(source: Source) -> list[Row]:
    return [(m.channel.topic, m.log_ns, bytes(m.data)) for m in source.messages()]


def changed(bag: Bag, path: Path, command: str) -> None:
    """The database with one command carried out in it."""
    path.write_bytes(bag.whole)
    with sqlite3.connect(path) as database:
        database.execute(command)
    database.close()


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Bag:
    """A database of 400 messages of 20 to 20 000 bytes on two topics, written in transactions as a recorder does."""
    path, seeds, rows = tmp_path_factory.mktemp("bag") / "made.db3", random.Random(3), list[Row]()
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA page_size={PAGE}")
    database.executescript(TABLES)
    topics = {1: "/a", 2: "/b"}
    for number, name in topics.items():
        values = (number, name, "sensor_msgs/msg/LaserScan", "cdr", "")
        database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", values)
    for n in range(400):
        topic = 1 + n % 2
        data = seeds.randbytes(seeds.choice([20, 90, 700, 3000, 20_000]))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", (topic, 10 * n, data))
        rows.append((topics[topic], 10 * n, data))
        if n % 25 == 0:
            database.commit()
    database.commit()
    database.close()
    whole = path.read_bytes()
    return Bag(whole, rows, {log_ns: pages_of(whole, data) for _, log_ns, data in rows})


def pages_of(whole: bytes, data: bytes) -> set[int]:
    """The pages that a message lies on: its pieces are random, so each is found where it is and nowhere else."""
    found, at = set[int](), 0
    while at < len(data):
        where = whole.index(data[at : at + 20])
        found.add(where // PAGE)
        there = where
        while at < len(data) and there // PAGE == where // PAGE and whole[there] == data[at]:
            at, there = at + 1, there + 1
    return found


@THOROUGH
@given(where=st.floats(0.05, 1))
def test_cut_anywhere(bag: Bag, tmp_path: Path, where: float) -> None:
    length = int(where * (len(bag.whole) - 1))
    path = tmp_path / "cut.db3"
    path.write_bytes(bag.whole[:length])
    expected = [row[1] for row in bag.rows if max(bag.pages[row[1]]) < length // PAGE]
    with SqliteSource(path) as source:
        found = given_by(source)
        assert [row[1] for row in found] == expected
        assert set(found) <= set(bag.rows)
        assert [row[1] for row in given_by(source)] == expected
        assert {c.topic for c in source.channels} == {"/a", "/b"}
        assert source.faults.count("database_damaged") == 1
        counted = sum(c.count or 0 for c in source.channels)
        assert counted == len(found) + source.faults.count("messages_lost")


@THOROUGH
@given(hits=st.sets(st.integers(8, 250), min_size=1, max_size=5))
def test_pages_overwritten(bag: Bag, tmp_path: Path, hits: set[int]) -> None:
    """Only rows with a part on such a page are lost, and no other is given in their place."""
    hurt, known = bytearray(bag.whole), set(bag.rows)
    for page in hits:
        hurt[page * PAGE : (page + 1) * PAGE] = b"\xee" * PAGE
    path = tmp_path / "hurt.db3"
    path.write_bytes(hurt)
    with SqliteSource(path) as source:
        found = Counter(given_by(source))
    for row in bag.rows:
        if not bag.pages[row[1]] & hits:
            assert found[row] == 1
    assert {row[:2] for row in found} <= {row[:2] for row in bag.rows}
    assert all(bag.pages[row[1]] & hits for row in found if row not in known)


def test_a_cut_database_in_a_folder_without_metadata(bag: Bag, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "bag_0.db3").write_bytes(bag.whole[: len(bag.whole) // 2])
    with BagFolderSource(folder) as source:
        found = given_by(source)
        assert found == [row for row in bag.rows if row in found]
        assert len(bag.rows) // 3 < len(found) < len(bag.rows)
        assert {f.cause for f in source.faults} >= {"database_damaged", "metadata_missing"}


def test_rows_that_hold_something_else(bag: Bag, tmp_path: Path) -> None:
    path = tmp_path / "odd.db3"
    path.write_bytes(bag.whole)
    database = sqlite3.connect(path)
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 55, 'text')")
    database.commit()
    with SqliteSource(path) as source:
        assert given_by(source) == bag.rows
        assert source.faults.count("row_broken") == 1
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 'noon', x'00')")
    database.commit()
    database.close()
    with SqliteSource(path) as source:
        assert given_by(source) == bag.rows


def test_loops_and_lies_end(bag: Bag, tmp_path: Path) -> None:
    """Overflow pages that lead back to themselves, sizes and counts beyond the file."""
    seeds = random.Random(9)
    for _ in range(60):
        hurt = bytearray(bag.whole)
        for _ in range(40):
            page = seeds.randrange(3, len(bag.whole) // PAGE)
            at = page * PAGE + seeds.randrange(0, 12)
            hurt[at : at + 4] = seeds.choice([b"\xff" * 4, (page + 1).to_bytes(4, "big"), b"\r\x00\x00\xff"])
        path = tmp_path / "lies.db3"
        path.write_bytes(hurt)
        try:
            with SqliteSource(path) as source:
                assert len(given_by(source)) <= 2 * len(bag.rows)
        except RecordingError as error:
            assert "cannot be read as a ROS 2 bag" in str(error)


def test_no_message_is_made_larger_than_the_limits(bag: Bag, tmp_path: Path) -> None:
    path = tmp_path / "large.db3"
    changed(bag, path, "INSERT INTO messages VALUES (1000, 1, 55, zeroblob(2000000))")
    with SqliteSource(path, limits=ReadLimits(chunk_bytes=1 << 20)) as source:
        assert given_by(source) == bag.rows
        assert source.faults.count("messages_lost") == 1
    with SqliteSource(path) as source:
        assert len(given_by(source)) == len(bag.rows) + 1


def test_what_a_schema_computes_is_not_read(bag: Bag, tmp_path: Path) -> None:
    """A few bytes of schema may stand for gigabytes in each row."""
    path = tmp_path / "computed.db3"
    changed(bag, path, "ALTER TABLE messages ADD COLUMN more BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL")
    with pytest.raises(RecordingError, match=r"computes messages\.more"):
        SqliteSource(path)


def test_topics_without_a_type_are_no_topics(bag: Bag, tmp_path: Path) -> None:
    path = tmp_path / "typeless.db3"
    path.write_bytes(bag.whole)
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA writable_schema = ON")
        database.execute("UPDATE sqlite_master SET sql = replace(sql, ' NOT NULL', '') WHERE name = 'topics'")
    database.close()
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET type = NULL WHERE id = 2")
    database.close()
    with SqliteSource(path) as source:
        assert given_by(source) == [row for row in bag.rows if row[0] == "/a"]
        assert source.faults.count("database_damaged") == 1


@pytest.mark.parametrize(
    "command",
    [
        "CREATE VIEW more AS SELECT * FROM messages",
        "CREATE TRIGGER more AFTER INSERT ON messages BEGIN SELECT 1; END",
        "CREATE INDEX more ON messages (length(data))",
        "CREATE INDEX more ON messages (timestamp) WHERE abs(timestamp) > 5",
        "CREATE VIRTUAL TABLE more USING fts5(data)",
    ],
)
def test_a_schema_that_runs_something_is_not_read(bag: Bag, tmp_path: Path, command: str) -> None:
    path = tmp_path / "running.db3"
    changed(bag, path, command)
    with pytest.raises(RecordingError, match=r"computes 'more' where recorders write"):
        SqliteSource(path)


def test_a_table_that_is_a_view_is_not_read(bag: Bag, tmp_path: Path) -> None:
    """What the schema says of a thing beside its text may be a lie; the rows of the pages are no lie."""
    path = tmp_path / "view.db3"
    path.write_bytes(bag.whole)
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA writable_schema = ON")
        text = "CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 1 AS timestamp, zeroblob(900000000) AS data"
        database.execute("DELETE FROM sqlite_master WHERE name = 'timestamp_idx'")
        database.execute("UPDATE sqlite_master SET sql = ?, rootpage = 0 WHERE name = 'messages'", [text])
    database.close()
    with SqliteSource(path) as source:
        assert given_by(source) == bag.rows
        assert source.faults.count("database_damaged") == 1


def small_bag(path: Path, messages: int = 300, data: bytes = b"scan") -> int:
    """A database of small pages; returns the first page of its messages, counted from 1."""
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA page_size=512")
        database.executescript(TABLES)
        database.execute("INSERT INTO topics VALUES (1, '/a', 'sensor_msgs/msg/LaserScan', 'cdr', '')")
        rows = [(1, n, data) for n in range(messages)]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        ((root,),) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchall()
    database.close()
    return int(root)


def test_a_tree_whose_rows_have_no_end_is_left_for_its_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages that each lead 60 times to the next one: 60 to the power of 4 leaves in two thousand bytes."""
    path = tmp_path / "endless.db3"
    root = small_bag(path)
    whole = bytearray(path.read_bytes())
    first = len(whole) // 512 + 1
    pages = [root, first, first + 1, first + 2]
    whole += bytes(512 * 3)
    leaf = next(n for n in range(root, first) if whole[512 * n] == 0x0D) + 1
    for page, child in zip(pages, [*pages[1:], leaf], strict=True):
        cells, at = bytearray(), 12 + 2 * 60
        head = b"\x05\0\0" + (60).to_bytes(2, "big") + at.to_bytes(2, "big") + b"\0" + child.to_bytes(4, "big")
        for k in range(60):
            head += (at + len(cells)).to_bytes(2, "big")
            cells += child.to_bytes(4, "big") + bytes([k + 1])
        whole[512 * (page - 1) : 512 * page] = (head + cells).ljust(512, b"\0")
    whole[28:32] = (len(whole) // 512).to_bytes(4, "big")
    path.write_bytes(whole)
    monkeypatch.setattr("mapgraft.recording.containers.sqlite_opening.FREE_STEPS", 300_000)
    with SqliteSource(path) as source:
        times = [log_ns for _, log_ns, _ in given_by(source)]
        (fault,) = (fault for fault in source.faults if fault.cause == "database_damaged")
    assert "interrupted" in fault.sentence
    assert times == list(range(300))


def test_rows_that_share_pages_unpack_to_no_more_than_the_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One row, put down nine times on its page."""
    path, data = tmp_path / "shared.db3", b"x" * 19_844  # so many that hardly any of them lie on that page
    leaf = 512 * (small_bag(path, 1, data) - 1)
    whole = bytearray(path.read_bytes())
    (at,) = struct.unpack_from(">H", whole, leaf + 8)
    cell = bytes(whole[leaf + at : leaf + 512])
    cells = [cell[:3] + bytes([n]) + cell[4:] for n in range(1, 10)]  # its size takes three bytes, its number one
    places = [512 - len(cell) * n for n in range(1, 10)]
    for place, one in zip(places, cells, strict=True):
        whole[leaf + place : leaf + place + len(one)] = one
    whole[leaf + 3 : leaf + 7] = struct.pack(">HH", 9, places[-1])
    whole[leaf + 8 : leaf + 26] = struct.pack(">9H", *places)
    path.write_bytes(whole)
    with SqliteSource(path) as source:
        assert given_by(source) == 9 * [("/a", 0, data)]
        assert "its rows share pages" in next(iter(source.faults)).sentence
    monkeypatch.setattr("mapgraft.recording.containers.limits.FREE_BYTES", 100_000)
    with pytest.raises(RecordingError, match=r"raise limits\.expansion"):
        SqliteSource(path, limits=ReadLimits(expansion=2.0))


def test_definitions_that_share_pages_are_kept_as_far_as_the_limits_allow(tmp_path: Path) -> None:
    path = tmp_path / "defined.db3"
    small_bag(path, 5)
    with sqlite3.connect(path) as database:
        database.execute(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT, "
            "encoded_message_definition TEXT, type_description_hash TEXT)"
        )
        rows = [(f"a/msg/A{n}", "ros2msg", "x" * 100_000, "") for n in range(20)]
        database.executemany(
            "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition, type_description_hash) "
            "VALUES (?, ?, ?, ?)",
            rows,
        )
    database.close()
    with SqliteSource(path, limits=ReadLimits(chunk_bytes=1 << 20)) as source:
        assert len(given_by(source)) == 5
        assert "topics have more than" in next(iter(source.faults)).sentence
    with SqliteSource(path) as source:
        assert len(given_by(source)) == 5 and not len(source.faults)
