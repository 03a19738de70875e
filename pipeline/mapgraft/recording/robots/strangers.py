"""Plugins' readers and decoders at work: what they raise is named, and what takes too long is ended."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from mapgraft.contracts.sources import (
    Channel,
    RawMessage,
    ReadFaults,
    RecordedScan,
    ScanMessage,
    SchemaText,
    Source,
)
from mapgraft.errors import FailedPluginError, MapgraftError, PluginError, RecordingError
from mapgraft.guard import Guard

R = TypeVar("R")


def called(guard: Guard, kind: str, name: str, function: Callable[[], R]) -> R:
    """What a plugin's function gives; a MapgraftError that it raises on purpose comes through.

    Raises FailedPluginError for anything else, and when it takes too long.
    """
    with guard.calling(kind, name):
        try:
            return function()
        except MapgraftError as error:
            told = error
    raise told


def decoded(guard: Guard, name: str, decode: Callable[[Any], object], message: object, message_type: str) -> object:
    """A payload by a plugin's decoder.

    Raises RecordingError when the message cannot be decoded, or when the decoder took too long before, and what else
    the decoder raises on purpose.
    """
    if said := guard.set_aside.get(("decoder", name)):
        raise RecordingError(said)
    try:
        return called(guard, "decoder", name, lambda: decode(message))
    except FailedPluginError as error:
        if error.took_too_long:
            guard.note(error)
        raise RecordingError(f"a message of type {message_type} cannot be decoded ({error})") from error


class GuardedSource:
    """A plugin's source that cannot end a run: where it fails or takes too long its recording ends, which is a fault.

    Only what it does to open is not caught: nothing can be had of a file that cannot be opened.
    """

    def __init__(self, source: Source, name: str, guard: Guard) -> None:
        self._source = source
        self._name = name
        self._guard = guard

    @property
    def path(self) -> Path:
        return self._source.path

    @property
    def container(self) -> str:
        return self._source.container

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._source.channels

    @property
    def start_ns(self) -> int | None:
        return self._source.start_ns

    @property
    def end_ns(self) -> int | None:
        return self._source.end_ns

    @property
    def faults(self) -> ReadFaults:
        return self._source.faults

    def schema(self, channel: Channel) -> SchemaText | None:
        """See ``Source.schema``."""
        return self._called(lambda: self._source.schema(channel))

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``."""
        return self._passed(lambda: self._source.messages(topics, start_ns, end_ns))

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        return self._passed(lambda: self._source.scans(topics, start_ns, end_ns))

    def decode(self, message: RawMessage) -> object:
        """See ``Source.decode``."""
        return self._decoded(lambda: self._source.decode(message))

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """See ``Source.decode_scan``."""
        return self._decoded(lambda: self._source.decode_scan(message))

    def close(self) -> None:
        """See ``Source.close``."""
        self._called(self._source.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _passed(self, begin: Callable[[], Iterator[R]]) -> Iterator[R]:
        try:
            if said := self._guard.set_aside.get(("reader", self._name)):
                raise PluginError(said)
            stream = self._called(lambda: iter(begin()))
            while (item := self._called(lambda: next(stream, None))) is not None:
                yield item
        except PluginError as error:
            self._guard.note(error)
            self.faults.add("reader_failed", f"{error}: the recording ends there", place=0)

    def _decoded(self, decode: Callable[[], R]) -> R:
        if said := self._guard.set_aside.get(("reader", self._name)):
            raise RecordingError(said)
        try:
            return self._called(decode)
        except FailedPluginError as error:
            if error.took_too_long:
                self._guard.note(error)
            raise RecordingError(str(error)) from error

    def _called(self, function: Callable[[], R]) -> R:
        return called(self._guard, "reader", self._name, function)
