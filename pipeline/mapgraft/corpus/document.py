"""The file that says what a corpus is, and the folder that says it by what is in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from mapgraft.config import Section, path_of, read_mapping, text_of
from mapgraft.corpus.faults import Faults
from mapgraft.corpus.patterns import matching, recordings_of
from mapgraft.corpus.places import is_url, local, name_of, whole
from mapgraft.corpus.plan import Content, Job, Mission, Setting, jobs_of, named
from mapgraft.errors import ConfigError
from mapgraft.plugins import Plugins
from mapgraft.recording.naming import stem

DOCUMENTS = (".yaml", ".yml", ".toml")
DEFAULT = "default"  # the name of the configuration where none is given


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
    """A corpus: every mission is run with every one of ``configs`` (a file or its content, by name).

    A job that takes longer than ``job_time_limit_s`` is ended, where it runs in a process that can be ended.
    """

    missions: list[MissionEntry] = Field(min_length=1)
    configs: dict[str, dict[str, Any] | str] = Field(default_factory=dict)
    job_time_limit_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None


def read_plan(source: str, configs: Sequence[str] = (), plugins: Plugins | None = None) -> list[Job]:
    """The jobs of a corpus: ``source`` is the document that describes it, or a folder of recordings, here or elsewhere.

    ``configs`` are files with configurations, called by their stems, where the document has none. ``plugins`` tell of
    further kinds of recordings. Raises ConfigError with every fault of the document at once, and where it has none,
    with every fault of all that it names; RecordingError where nothing is wrong but that folders or patterns hold
    nothing.
    """
    suffixes = [end for offered in (plugins or Plugins()).of_kind("reader") for end in offered.descriptor.accepts]
    faults = Faults()
    given = [_setting(stem(Path(file)), file, "", faults) for file in configs]
    if is_url(source) or local(source).is_dir():
        missions = _missions(MissionEntry(each=[source]), "", suffixes, faults)
        return _jobs(missions, given, None, faults)
    if not name_of(source).endswith(DOCUMENTS):
        raise ConfigError(f"{source} is neither a folder of recordings nor a document ({', '.join(DOCUMENTS)})")
    path = local(source)
    document = _checked(read_mapping(path), str(path))
    if given and document.configs:
        raise ConfigError(f"{source} has configs of its own: leave --config out, or take them out of the document")
    folder = str(path.parent)
    told = [_setting(name, content, folder, faults) for name, content in document.configs.items()]
    missions = [one for entry in document.missions for one in _missions(entry, folder, suffixes, faults)]
    return _jobs(missions, told or given, document.job_time_limit_s, faults)


def _setting(name: str, given: Mapping[str, Any] | str, folder: str, faults: Faults) -> Setting:
    """A configuration by name; an empty one in the place of one that cannot be read."""
    content: Content = {}
    with faults.noted():
        content = _content(given, folder)
    return Setting(name, content)


def _jobs(
    missions: Sequence[Mission], settings: Sequence[Setting], time_limit_s: float | None, faults: Faults
) -> list[Job]:
    """The jobs, where nothing is wrong with what they are made of; raises all that is."""
    jobs = list[Job]()
    names = [setting.name for setting in settings]
    with faults.noted():
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ConfigError(f"two configurations are called {', '.join(twice)}: rename a file, or write a document")
    with faults.noted():
        missions = named(missions)
    with faults.noted():
        jobs = jobs_of(missions, settings or [Setting(DEFAULT, {})], time_limit_s)
    faults.tell()
    return jobs


def _checked(given: Mapping[str, Any], origin: str) -> CorpusDocument:
    try:
        return CorpusDocument.model_validate(given)
    except ValidationError as error:
        faults = [f"  {path_of(fault['loc'])}: {text_of(fault)}" for fault in error.errors()]
        raise ConfigError(f"{origin} has {len(faults)} fault{'s' * (len(faults) > 1)}:\n" + "\n".join(faults)) from None


def _missions(entry: MissionEntry, folder: str, suffixes: Sequence[str], faults: Faults) -> list[Mission]:
    content = _setting("", entry.config, folder, faults).content
    each = [entry.each] if isinstance(entry.each, str) else entry.each
    found = list[str]()
    for given in entry.files or each:
        with faults.noted():
            found += matching(given, folder) if entry.files else recordings_of(given, folder, suffixes)
    places = tuple(dict.fromkeys(found))
    if entry.files:
        return [Mission(entry.name or "", places, content)] if places else []
    return [Mission("", (place,), content) for place in places]


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
    if isinstance(examples := out.get("examples"), Mapping) and isinstance(truth := examples.get("truth"), str):
        out["examples"] = {**examples, "truth": whole(truth, folder)}
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
