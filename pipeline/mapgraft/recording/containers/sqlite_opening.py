"""Opening a database that a stranger made: nothing in it is computed, and no question takes longer than its size."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path

from mapgraft.contracts.sources import ReadFaults
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.limits import ReadLimits

MAGIC = b"SQLite format 3\0"

FREE_STEPS = 10_000_000
"""So many steps of SQLite a question may take, however small the database is; a second or so."""

_STEPS_PER_BYTE = 20  # a row takes about 20 steps, and no row has fewer than 8 bytes
_STEPS_AT_ONCE = 100_000
_LEAST_BYTES = 1 << 20  # of one value that may be read, whatever the limits: names and definitions are values, too
_ROOM_BYTES = 1 << 10  # what SQLite keeps of a row beside its largest value
_SQL_BYTES = 1 << 20  # of one statement, ours or of the schema
_SCHEMA = "SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL"
_PLAIN = re.compile(r"CREATE\s+(?:(TABLE)\b.*|(?:UNIQUE\s+)?INDEX\b[^()]*\([\w\s,\"`\[\]]*\)\s*)", re.DOTALL | re.I)
_READ = ("topics", "messages", "message_definitions")


def open_database(path: Path, faults: ReadFaults, limits: ReadLimits) -> sqlite3.Connection:
    """Open a database read-only; what a killed recorder left in its write-ahead log is read where the folder allows it.

    No value may be larger than ``limits.chunk_bytes``. Raises RecordingError when the file cannot be read or is no
    database; what is broken in it raises sqlite3.Error later.
    """
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    if head != MAGIC:
        what = "empty (0 bytes)" if not head else "not a database"
        raise RecordingError(f"{path} is {what}: it cannot be a ROS 2 bag")
    address, log = path.resolve().as_uri() + "?mode=ro", log_of(path)
    if log.is_file() and log.stat().st_size:
        database = _bounded(address, limits)
        try:
            database.execute(_SCHEMA).fetchall()
            return database
        except (sqlite3.Error, MemoryError, UnicodeDecodeError):  # SQLite's own sentences quote what they complain of
            database.close()
            faults.add("log_unread", f"{log.name} beside the bag cannot be read: the last messages may be missing")
    return _bounded(f"{address}&immutable=1", limits)


def log_of(path: Path) -> Path:
    """Where the write-ahead log of a database lies."""
    return path.with_name(path.name + "-wal")


def _bounded(address: str, limits: ReadLimits) -> sqlite3.Connection:
    database = sqlite3.connect(address, uri=True, check_same_thread=False)
    most = max(limits.chunk_bytes, _LEAST_BYTES) + _ROOM_BYTES
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(most, 2**31 - 1))
    database.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, _SQL_BYTES)
    try:
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA cell_size_check = ON")
    except (sqlite3.Error, MemoryError, UnicodeDecodeError):  # a broken database says so when it is read
        pass
    return database


class StepLimit:
    """Ends a question to a database that takes more steps than a sound one of this size can need.

    The pages of a damaged or hostile one may be linked in a way that its rows have no end.
    """

    def __init__(self, database: sqlite3.Connection, path: Path) -> None:
        log = log_of(path)
        self.stored_bytes = path.stat().st_size + (log.stat().st_size if log.is_file() else 0)
        self._most = FREE_STEPS + _STEPS_PER_BYTE * self.stored_bytes
        self._taken = 0
        database.set_progress_handler(self._is_over, _STEPS_AT_ONCE)

    def begin(self) -> None:
        """Count anew: a question begins."""
        self._taken = 0

    def _is_over(self) -> bool:
        self._taken += _STEPS_AT_ONCE
        return self._taken > self._most


def plain_tables(database: sqlite3.Connection) -> tuple[set[str], str]:
    """The tables of a database, and what in its schema is computed when it is read (empty: nothing).

    Recorders write tables, and indexes of their columns. Views, triggers, virtual tables and generated columns run
    what a stranger wrote. Raises sqlite3.Error when the schema cannot be read.
    """
    tables = set[str]()
    for name, sql in database.execute(_SCHEMA):
        plain = _PLAIN.fullmatch(str(sql))
        if plain is None:
            return tables, repr(str(name)[:80])
        if plain[1]:
            tables.add(str(name))
    for table in (name for name in _READ if name in tables):
        for column in database.execute(f"PRAGMA table_xinfo({table})"):
            if column[6]:  # hidden: it is generated
                return tables, f"{table}.{column[1]}"
    return tables, ""
