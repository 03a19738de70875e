"""Writing a folder so that nobody ever sees half of a file, nor half of what belongs together.

Files are written under ``.partial`` names and synced. What is to be renamed and removed is then put down in a journal,
which appears at once; from that moment on the new files count. Whoever is killed while renaming leaves the journal, and
the next one who writes the folder carries it out. All of it stays in the folder (``fence``), whoever wrote the journal.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from mapgraft.errors import OutputError
from mapgraft.outputs.fence import file_in, is_name

SUFFIX = ".partial"
JOURNAL = ".mapgraft.publishing"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_REFUSED = (errno.EACCES, errno.EPERM, errno.EROFS)


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Turns what the operating system refuses inside into an OutputError of one sentence about the folder ``out``."""
    try:
        yield
    except OSError as error:
        raise OutputError(_sentence(out, error)) from error


class Staging:
    """The files of one run in one folder: written under ``.partial`` names, renamed together when all are whole.

    Methods raise OSError; put them inside ``writing``. They raise OutputError where a name or a link leads elsewhere.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        self._final: dict[str, str] = {}  # name while partial → final name, relative to the folder

    def create(self, name: str) -> BinaryIO:
        """A new file, opened for writing, that will be called ``name`` (relative, with '/')."""
        path = file_in(self._out, name + SUFFIX)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._final[name] = name
        return new_file(path)

    def write(self, name: str, data: bytes) -> None:
        """A whole file at once, on disk when this returns."""
        with self.create(name) as stream:
            stream.write(data)
            sync(stream)

    def partial(self, name: str) -> Path:
        """Where the file is until it is published."""
        return self._out / (name + SUFFIX)

    def call(self, name: str, final: str) -> None:
        """Give a file that was created as ``name`` another final name, in the same folder."""
        self._final[name] = final

    def remove(self) -> None:
        """Take away the partial files of what will not be published, as far as the folder lets us."""
        for name in self._final:
            with suppress(OSError):
                self.partial(name).unlink()
        self._final.clear()

    @property
    def names(self) -> list[str]:
        """Final names of all files so far, sorted."""
        return sorted(self._final.values())

    def publish(self, gone: Iterable[str] = ()) -> list[str]:
        """Rename all files to their final names and remove ``gone`` (relative names), all of it or nothing.

        What comes stays, also where ``gone`` has it. The files must be closed and on disk. Where there is more than one
        thing to do, the caller must hold the lock of the folder. Returns the names, sorted.
        """
        published = self.names
        renamed = {name + SUFFIX: final for name, final in self._final.items()}
        plan = _Plan(renamed, tuple(sorted({*gone} - {*renamed, *published})))
        _require_within(self._out, plan)
        journalled = len(plan.renamed) + len(plan.gone) > 1
        if journalled:
            _write_journal(self._out, plan)
        try:
            _carry_out(self._out, plan, journalled)
        except KeyboardInterrupt:  # a few renames, which must not stop half-way because somebody is in a hurry
            _carry_out(self._out, plan, journalled)
            raise
        self._final.clear()
        return published


@dataclass(frozen=True, slots=True)
class _Plan:
    """What there is to do to make a folder's new files count: partial name → final name, and names that go."""

    renamed: Mapping[str, str]
    gone: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Every name of a file that something is done to."""
        return (*self.renamed, *self.renamed.values(), *self.gone)

    def is_sound(self) -> bool:
        """Whether doing it twice is doing it once: each file is named once, and is renamed in the folder it is in."""
        return (
            all(map(is_name, self.names))
            and len({*self.names}) == len(self.names)
            and all(partial.endswith(SUFFIX) for partial in self.renamed)
            and all(_folder(partial) == _folder(final) for partial, final in self.renamed.items())
        )


def settle(out: Path) -> None:
    """Carry out what a process had begun to publish when it was killed; nothing where there is no journal.

    The caller must hold the lock of the folder. Raises OSError, and OutputError when the journal is none of ours, or
    leads out of the folder; then nothing of it was done.
    """
    plan = _begun(out)
    if plan is not None:
        _require_within(out, plan)
        _carry_out(out, plan, journalled=True)


def begun(out: Path) -> tuple[str, ...]:
    """The names of the files that ``settle`` would rename, bring and remove; raises as it does."""
    plan = _begun(out)
    return () if plan is None else plan.names


def _begun(out: Path) -> _Plan | None:
    journal = out / JOURNAL
    if not journal.is_file():
        return None
    with suppress(ValueError, KeyError, TypeError, RecursionError):
        told = json.loads(journal.read_text(encoding="utf-8"))
        plan = _Plan(dict(told["renamed"]), tuple(told["gone"]))
        if plan.is_sound() and not journal.is_symlink():
            return plan
    raise OutputError(f"{journal} is not what a run writes there: remove it, or choose another folder")


def _require_within(out: Path, plan: _Plan) -> None:
    """Raises OutputError where something that is to be done would be done outside of the folder."""
    for name in plan.names:
        file_in(out, name)


def _write_journal(out: Path, plan: _Plan) -> None:
    partial = out / (JOURNAL + SUFFIX)
    with new_file(partial) as stream:
        stream.write(json.dumps({"renamed": plan.renamed, "gone": plan.gone}).encode())
        sync(stream)
    for folder in _folders(out, plan.renamed):  # the partial files' own names
        sync_folder(folder)
    partial.replace(out / JOURNAL)
    sync_folder(out)


def _carry_out(out: Path, plan: _Plan, journalled: bool) -> None:
    """Do what is left to do; doing it twice does no harm."""
    for partial, final in plan.renamed.items():
        with suppress(FileNotFoundError):  # it has been renamed before
            os.replace(out / partial, out / final)  # noqa: PTH105 (says what it does: atomic)
    for name in plan.gone:
        (out / name).unlink(missing_ok=True)
    for folder in _folders(out, (*plan.renamed.values(), *plan.gone)):
        sync_folder(folder)
    if journalled:
        (out / JOURNAL).unlink(missing_ok=True)
        sync_folder(out)


def _folders(out: Path, names: Iterable[str]) -> list[Path]:
    """The folders in which these files are, and those above them in ``out``, deepest first."""
    below = {folder for name in names for folder in PurePosixPath(name).parents}
    return [folder for name in sorted(below, reverse=True) if (folder := out / name).is_dir()]


def _folder(name: str) -> PurePosixPath:
    return PurePosixPath(name).parent


def new_file(path: Path) -> BinaryIO:
    """A new file, opened for writing. What has its name goes: a rest, or a link, through which nothing is written."""
    try:
        return path.open("xb")
    except FileExistsError:
        path.unlink()
        return path.open("xb")


def sync(stream: BinaryIO) -> None:
    """Everything written so far is on disk when this returns."""
    stream.flush()
    os.fsync(stream.fileno())


def close_quietly(stream: BinaryIO) -> None:
    """Close a file that could not be written, also where its last bytes cannot be written either."""
    with suppress(OSError):
        stream.close()


def sync_folder(folder: Path) -> None:
    """Renames and removals in the folder are on disk when this returns."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sha256_of(path: Path) -> str:
    """The digest of a file's bytes in hex, read in pieces."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _sentence(out: Path, error: OSError) -> str:
    where = f"{out} ({error.filename})" if error.filename and str(error.filename) != str(out) else str(out)
    if error.errno in _FULL:
        return f"{where} cannot be written because the disk or the quota is full: make room and run again"
    if error.errno in _REFUSED:
        return f"{where} cannot be written because it is read-only for this user: choose another output folder"
    if error.errno == errno.ELOOP:
        return f"{where} cannot be written because a link is in its place: remove it, or choose another folder"
    if error.errno in (errno.ENOTDIR, errno.EEXIST, errno.EISDIR):
        return f"{where} cannot be written because a file or folder of that name is in the way: choose another folder"
    return f"{where} cannot be written: {error.strerror or error}"
