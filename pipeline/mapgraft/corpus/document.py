"""The file that says what a corpus is, and the folder that says it by what is in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from glob import glob
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, model_validator

from mapgraft.config import Section, path_of, read_mapping, text_of
from mapgraft.corpus.places import is_url, local, name_of, whole
from mapgraft.corpus.plan import Content, Job, Mission, Setting, jobs_of, named
from mapgraft.corpus.recordings import recordings_in
from mapgraft.corpus.stores import asking, filesystem_of
from mapgraft.errors import ConfigError, RecordingError
from mapgraft.plugins import Plugins
from mapgraft.recording.naming import stem

DOCUMENTS = (".yaml", ".yml", ".toml")
DEFAULT = "default"  # the name of the configuration where none is given
_PATTERN = "*?["


class MissionEntry(Section):
    """Missions of a corpus: ``files`` are those of one, ``each`` names many, one recording each.

    Both take paths, URLs and patterns; ``each`` takes folders, too. ``config`` (a file or its content) is laid over
    every configuration: what is true of these missions alone, such as the names of their robots.
    """

    name: str | None = Field(default=None, min_length=1)
    files: list[str] = Field(default_factory=list)
    each: list[str] | str = Field(default_factory=list)
    config: dict[str, Any] | str = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_way(self) -> MissionEntry:
        if bool(self.files) == bool(self.each):
            raise ValueError("a mission has either files, or each (one mission per recording)")
        if self.each and self.name:
            raise ValueError("name is for the one mission of files; those of each are called after their recordings")
        return self


class CorpusDocument(Section):
    """A corpus: every mission is run with every one of ``configs`` (a file or its content, by name)."""

    missions: list[MissionEntry] = Field(min_length=1)
    configs: dict[str, dict[str, Any] | str] = Field(default_factory=dict)


def read_plan(source: str, configs: Sequence[str] = (), plugins: Plugins | None = None) -> list[Job]:
    """The jobs of a corpus: ``source`` is the document that describes it, or a folder of recordings, here or elsewhere.

    ``configs`` are files with configurations, called by their stems, where the document has none. ``plugins`` tell of
    further kinds of recordings. Raises ConfigError with every fault of the document at once, RecordingError where a
    folder or a pattern holds nothing.
    """
    given = [Setting(stem(Path(file)), _content(file, "")) for file in configs]
    suffixes = [end for offered in (plugins or Plugins()).of_kind("reader") for end in offered.descriptor.accepts]
    if is_url(source) or local(source).is_dir():
        missions = [Mission("", (place,), {}) for place in _found(whole(source), suffixes)]
        return jobs_of(named(missions), _settings(given))
    if not name_of(source).endswith(DOCUMENTS):
        raise ConfigError(f"{source} is neither a folder of recordings nor a document ({', '.join(DOCUMENTS)})")
    path = local(source)
    document = _checked(read_mapping(path), str(path))
    if given and document.configs:
        raise ConfigError(f"{source} has configs of its own: leave --config out, or take them out of the document")
    folder = str(path.parent)
    told = [Setting(name, _content(content, folder)) for name, content in document.configs.items()]
    missions = [mission for entry in document.missions for mission in _missions(entry, folder, suffixes)]
    return jobs_of(named(missions), _settings(told or given))


def _settings(settings: Sequence[Setting]) -> Sequence[Setting]:
    names = [setting.name for setting in settings]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"two configurations are called {', '.join(twice)}: rename a file, or write a document")
    return settings or [Setting(DEFAULT, {})]


def _checked(given: Mapping[str, Any], origin: str) -> CorpusDocument:
    try:
        return CorpusDocument.model_validate(given)
    except ValidationError as error:
        faults = [f"  {path_of(fault['loc'])}: {text_of(fault)}" for fault in error.errors()]
        raise ConfigError(f"{origin} has {len(faults)} fault{'s' * (len(faults) > 1)}:\n" + "\n".join(faults)) from None


def _missions(entry: MissionEntry, folder: str, suffixes: Sequence[str]) -> list[Mission]:
    content = _content(entry.config, folder)
    if entry.files:
        files = [file for given in entry.files for file in _matching(whole(given, folder))]
        return [Mission(entry.name or "", tuple(dict.fromkeys(files)), content)]
    each = [entry.each] if isinstance(entry.each, str) else entry.each
    found = [place for given in each for place in _found(whole(given, folder), suffixes)]
    return [Mission("", (place,), content) for place in dict.fromkeys(found)]


def _found(place: str, suffixes: Sequence[str]) -> list[str]:
    """The recordings of a folder or a pattern, each of which is a mission; raises RecordingError when there is none."""
    if any(sign in name_of(place) for sign in _PATTERN):
        return _matching(place)
    if not is_url(place) and not local(place).is_dir():
        return [place]
    if not (found := recordings_in(place, suffixes)):
        raise RecordingError(f"{place} holds no recording: MCAP, ROS 1 bags, ROS 2 bags and CARMEN logs are looked for")
    return found


def _matching(place: str) -> list[str]:
    """The places that a pattern means, sorted; a place that is no pattern, itself."""
    if not any(sign in place for sign in _PATTERN):
        return [place]
    if is_url(place):
        filesystem, pattern = filesystem_of(place)
        with asking(f"{place} cannot be listed", RecordingError):
            filesystem.invalidate_cache()
            scheme = place.partition("://")[0]
            found = sorted(f"{scheme}://{str(name).lstrip('/')}" for name in filesystem.glob(pattern))
    else:
        found = sorted(glob(place, recursive=True))  # noqa: PTH207 (absolute patterns)
    if not found:
        raise RecordingError(f"{place} matches nothing")
    return found


def _content(given: Mapping[str, Any] | str, folder: str) -> Content:
    """A configuration as it is written in a file or in the document, with every path absolute."""
    if isinstance(given, str):
        path = local(whole(given, folder))
        return _anchored(read_mapping(path), str(path.parent))
    return _anchored(given, folder)


def _anchored(content: Content, folder: str) -> Content:
    """What is of another shape than a configuration is left as it is: the check of the whole tells of it."""
    out = dict(content)
    if isinstance(rules := out.get("rules"), str):
        out["rules"] = whole(rules, folder)
    if isinstance(robots := out.get("robots"), Mapping):
        out["robots"] = {name: _anchored_robot(robot, folder) for name, robot in robots.items()}
    return out


def _anchored_robot(robot: Any, folder: str) -> Any:
    if not isinstance(robot, Mapping):
        return robot
    out = dict(robot)
    if isinstance(files := out.get("files"), list):
        out["files"] = [_anchored_file(file, folder) for file in files]
    if isinstance(poses := out.get("poses"), Mapping) and isinstance(file := poses.get("file"), str):
        out["poses"] = {**poses, "file": whole(file, folder)}
    return out


def _anchored_file(file: Any, folder: str) -> Any:
    """A path where there is such a file; else it is a name or a pattern for the files of the mission."""
    if not isinstance(file, str) or is_url(file):
        return file
    path = whole(file, folder)
    return path if Path(path).exists() else file
