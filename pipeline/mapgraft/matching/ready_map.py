"""A ready map from a file, held as the robot would hold it that had observed it."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mapgraft.assembly import map_type_of
from mapgraft.config import Config
from mapgraft.contracts import Layer, Map, MapError, MapMetadata, MapType, Observation, Transform
from mapgraft.matching.pixels import Frame, frame_of
from mapgraft.plugins import Plugins
from mapgraft.procedures import Workshop
from mapgraft.recording.naming import real_path
from mapgraft.recording.reach import is_file, require_readable
from mapgraft.recording.robots.library import Library
from mapgraft.reversal import Ledger

RESOLUTION = "resolution_m"  # the option of formats whose files do not tell it
FORMAT = "format"  # the option that names the format, where the file's name would tell another
_NOBODY = Transform.identity()


@dataclass(frozen=True, slots=True, eq=False)
class ReadyMap:
    """One map file. ``image`` is how its pixels lie in its map frame, None where its format has no pixels.

    ``remarks`` says in sentences what is probably not meant as the file says.
    """

    name: str
    path: Path
    format: str
    map_type: MapType
    ledger: Ledger
    metadata: MapMetadata
    image: Frame | None
    remarks: tuple[str, ...] = ()

    @property
    def layer(self) -> Layer:
        return self.ledger.offered_layer()

    @property
    def view(self) -> Map:
        return self.ledger.own()


@dataclass(slots=True)
class Shelf:
    """Reads map files with the installed formats, each file with the same options once.

    A configuration's ``robots.<file's stem>`` holds options and map type of one file, its ``map`` those of all.
    """

    plugins: Plugins
    config: Config
    workshop: Workshop
    _library: Library = field(init=False)
    _read: dict[tuple[Path, str], ReadyMap] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._library = Library(self.plugins, self.config.mission.typestore, self.config.limits, self.workshop.guard)

    def takes(self, path: Path, option: str, form: str | None = None) -> bool:
        """Whether the format of a file, or the one that is named, has that option; MapError when no format reads it."""
        chosen = form or self._format_of(path)
        return option == FORMAT or option in inspect.signature(self.plugins.function("format", chosen)).parameters

    def read(self, path: Path, options: Mapping[str, object]) -> ReadyMap:
        """The map in a file; ``options`` go before the configured ones.

        Raises MapError when the file is missing, cannot be read, or holds nothing that could be matched, ConfigError
        when an option is missing or impossible, FailedPluginError when a plugin fails.
        """
        key = (real_path(path), repr(sorted(options.items())))
        if key not in self._read:
            self._read[key] = self._made(path, options)
        return self._read[key]

    def _made(self, path: Path, options: Mapping[str, object]) -> ReadyMap:
        name, remarks = path.stem, list[str]()
        robot = self.config.robots.get(name)
        told = {**(robot.options if robot else {}), **options}
        form = str(told[FORMAT]) if FORMAT in told and is_file(path) else self._format_of(path)
        kind, payload = self._library.read_map(path, told, remarks.append)
        map_type = map_type_of(name, [kind], self.config, self.workshop)
        with self.workshop.guard.calling("map type", map_type.name):
            ledger = Ledger(map_type)
            ledger.observe(Observation(name, 0, 0, path.name, kind, payload, _NOBODY, _NOBODY))
            _require_content(path, map_type, ledger.own())
            metadata = map_type.metadata(ledger.offered_layer())
        image = frame_of(payload)
        return ReadyMap(name, path, form, map_type, ledger, metadata, image, tuple(remarks))

    def _format_of(self, path: Path) -> str:
        require_readable(path)
        if not path.is_file():
            raise MapError(
                f"{path} is a folder: name a map file in it" if path.is_dir() else f"there is no file {path}"
            )
        form = self._library.format_of(path)
        if form is None:
            offered = [offered.descriptor for offered in self.plugins.of_kind("format")]
            known = ", ".join(f"{descriptor.name} ({' '.join(descriptor.accepts)})" for descriptor in offered)
            raise MapError(
                f"{path.name} is no map file that an installed format reads ({known or 'none is installed'}): "
                "a recording is mapped with 'mapgraft run' first"
            )
        return form


def _require_content(path: Path, map_type: MapType, view: Map) -> None:
    if view.known() == 0:
        raise MapError(f"{path.name} knows nothing: all of it is unknown; check its grays or its description")
    if not len(map_type.structure(view)):
        raise MapError(
            f"{path.name} has no walls: nothing in it is occupied, so nothing can be matched; check its grays "
            "or its description"
        )
