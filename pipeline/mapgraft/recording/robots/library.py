"""The files of a mission, each opened and looked into once, whoever asks for it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path

from mapgraft.config import LimitsConfig
from mapgraft.contracts import ConfigError, GridMessage, PluginError, RecordingError
from mapgraft.contracts.sources import Source
from mapgraft.errors import FailedPluginError
from mapgraft.guard import Guard
from mapgraft.plugins import Plugins
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.octets import Octets
from mapgraft.recording.containers.opening import Reader, is_named_as_recording, open_source
from mapgraft.recording.naming import real_path
from mapgraft.recording.reach import is_file, require_readable
from mapgraft.recording.robots.glimpse import Glimpse, glimpse
from mapgraft.recording.robots.payloads import Decoder, Payloads, checked_size
from mapgraft.recording.robots.strangers import GuardedSource, called, decoded

_GIVEN = ("warn", "most_cells")  # what a format is handed beside a person's options, if it takes it


class Library:
    """Opens recordings and ready-made map files, with what plugins add to both.

    ``typestore`` names the rosbags typestore for messages whose definition is not in their file. ``guard`` watches over
    plugins' readers, decoders and formats; where none is given there is a new one. ``octets`` holds the bytes of MCAP
    files that are not on this machine, by the path that stands for each.
    """

    def __init__(
        self,
        plugins: Plugins | None,
        typestore: str,
        limits: LimitsConfig | None = None,
        guard: Guard | None = None,
        octets: Mapping[Path, Octets] | None = None,
    ) -> None:
        self._plugins = plugins or Plugins()
        self._limits = limits or LimitsConfig()
        self.guard = guard or Guard(self._limits)
        self._typestore = typestore
        self._octets = {path.resolve(): known for path, known in (octets or {}).items()}
        self._glimpses: dict[Path, Glimpse] = {}
        self._readers = [
            Reader(offered.descriptor.accepts, self._reader(offered.descriptor.name))
            for offered in self._plugins.of_kind("reader")
        ]
        self.payloads = Payloads(
            {
                name: (offered.descriptor.gives, self._decoder(offered.descriptor.name, name))
                for offered in self._plugins.of_kind("decoder")
                for name in offered.descriptor.accepts
            },
            self._limits,
        )

    def look(self, path: Path) -> Glimpse:
        """The recording at a path, opened when it is asked for first; raises RecordingError when it cannot be read."""
        key = real_path(path)
        if key not in self._glimpses:
            bounds = ReadLimits(self._limits.chunk_bytes, self._limits.expansion)
            source = open_source(
                path, typestore=self._typestore, readers=self._readers, limits=bounds, octets=self._octets.get(key)
            )
            try:
                self._glimpses[key] = glimpse(source, self.payloads)
            except BaseException:
                source.close()
                raise
        return self._glimpses[key]

    def is_named_as_recording(self, path: Path) -> bool:
        """Whether there is something at the path that is called as recordings are, whatever it holds."""
        return is_named_as_recording(path, self._readers)

    def format_of(self, path: Path) -> str | None:
        """The name of the installed format that reads this kind of map file, None when the file is no map.

        Where several do it is the one that asks for the longest end of the name (``.plan.png`` before ``.png``).
        """
        if not is_file(path) or path.name == "metadata.yaml":
            return None
        best, name = 0, None
        for offered in self._plugins.of_kind("format"):
            fitting = [len(end) for end in offered.descriptor.accepts if path.name.lower().endswith(end)]
            if fitting and max(fitting) > best:
                best, name = max(fitting), offered.descriptor.name
        return name

    def read_map(self, path: Path, options: Mapping[str, object], warn: Callable[[str], None]) -> tuple[str, object]:
        """A ready-made map file as (kind of payload, payload); raises MapgraftError when it cannot be read.

        ``warn`` is handed to formats that take it, for what is probably not meant, and the limit of cells to those that
        take ``most_cells``. The option ``format`` names a format
        instead of the one that the file's name tells.
        """
        require_readable(path)
        if not path.is_file():  # a pipe would be waited for
            raise RecordingError(f"{path} is not a file: it cannot be a map")
        options = dict(options)
        name = str(options.pop("format", None) or self.format_of(path) or "") or None
        if name is None:
            raise RecordingError(f"no installed format reads {path}: see 'mapgraft plugins list'")
        read = self._plugins.function("format", name)
        known = inspect.signature(read).parameters
        if unknown := sorted(set(options) - (set(known) - set(_GIVEN))):
            offered = ", ".join(key for key in known if key not in ("path", *_GIVEN)) or "none"
            raise ConfigError(f"the format {name!r} has no option {', '.join(unknown)}: it has {offered}")
        ours = {"warn": warn, "most_cells": self._limits.grid_cells}
        given = {**options, **{key: ours[key] for key in _GIVEN if key in known}}
        try:
            payload = called(self.guard, "format", name, lambda: read(path, **given))
        except FailedPluginError as error:
            raise PluginError(f"{path} cannot be read: {error}") from error
        if isinstance(payload, GridMessage):
            checked_size(payload, self._limits, str(path))
        return self._plugins.find("format", name).descriptor.gives, payload

    def close(self) -> None:
        """Let go of all files."""
        for seen in self._glimpses.values():
            seen.source.close()

    def _decoder(self, name: str, message_type: str) -> Callable[[], Decoder]:
        """How to get a decoder that is watched; it is loaded when somebody asks for it."""

        def get() -> Decoder:
            decode = self._plugins.function("decoder", name)
            return lambda message: decoded(self.guard, name, decode, message, message_type)

        return get

    def _reader(self, name: str) -> Callable[[Path], object]:
        def read(path: Path) -> object:
            function = self._plugins.function("reader", name)  # not loaded before it is used
            try:
                source = called(self.guard, "reader", name, lambda: function(path))
            except FailedPluginError as error:
                raise PluginError(f"{path} cannot be read: {error}") from error
            return GuardedSource(source, name, self.guard) if isinstance(source, Source) else source

        return read
