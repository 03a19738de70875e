"""What a corpus is made of: missions, configurations, and the jobs that these are together."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path, PurePosixPath
from typing import Any

from mapgraft.config import parse_config
from mapgraft.corpus.faults import Faults, combination
from mapgraft.corpus.places import is_url, name_of, stand_in
from mapgraft.decision import check_rules, parse_rules
from mapgraft.documents import read_text
from mapgraft.errors import ConfigError, DecisionTableError
from mapgraft.recording.naming import told_apart

Content = Mapping[str, Any]  # of a configuration, as it was written; every path in it means the same from everywhere


@dataclass(frozen=True, slots=True)
class Mission:
    """One mission: its recordings (absolute paths or URLs), and what of the configuration is true of it alone."""

    name: str
    files: tuple[str, ...]
    content: Content


@dataclass(frozen=True, slots=True)
class Setting:
    """One configuration by name."""

    name: str
    content: Content


@dataclass(frozen=True, slots=True)
class Job:
    """One mission with one configuration: everything that a worker on another machine has to know.

    ``config_text`` is JSON, ``rules_text`` the decision table of a file that the configuration names, else empty. Jobs
    of equal files, configuration and rules have equal ids. Where the executor can end a call, a job is ended that takes
    longer than ``time_limit_s``.
    """

    mission: str
    config: str
    files: tuple[str, ...]
    config_text: str
    rules_text: str = ""
    time_limit_s: float | None = None

    @property
    def id(self) -> str:
        essence = json.dumps([self.files, self.config_text, self.rules_text])
        return "j" + hashlib.sha256(essence.encode()).hexdigest()[:15]

    @property
    def title(self) -> str:
        return f"{self.mission} × {self.config}"

    @property
    def content(self) -> dict[str, Any]:
        content: dict[str, Any] = json.loads(self.config_text)
        return content


def jobs_of(missions: Sequence[Mission], settings: Sequence[Setting], time_limit_s: float | None = None) -> list[Job]:
    """Every mission with every configuration, a mission's jobs behind each other; what is the same comes once.

    Raises ConfigError or DecisionTableError where configurations, with what missions lay over them, do not fit: with
    the faults of all, before anything is run.
    """
    jobs, faults = dict[str, Job](), Faults()
    for mission in missions:
        name = mission.name or name_of(mission.files[0])
        for setting in settings:
            content, rules_text = laid_over(setting.content, mission.content), ""
            with faults.noted_of(setting.name, name):
                parse_config(content, origin=combination(setting.name, name))
            with faults.noted_of(setting.name, name):
                rules_text = _without_rules(content)
            if not faults.found:
                text = json.dumps(content, sort_keys=True)
                job = Job(mission.name, setting.name, mission.files, text, rules_text, time_limit_s)
                jobs.setdefault(job.id, job)
    faults.tell()
    return list(jobs.values())


def _without_rules(content: dict[str, Any]) -> str:
    """The text of the decision table that a configuration names by its path, which is taken out of it.

    Raises DecisionTableError where that, or one in the configuration itself, does not fit.
    """
    rules = content.get("rules")
    if isinstance(rules, list) and all(isinstance(rule, Mapping) for rule in rules):
        check_rules(rules, "in it")
    if not isinstance(rules, str):
        return ""
    del content["rules"]
    text = read_text(Path(rules), f"the decision table {rules}", DecisionTableError)
    parse_rules(text, rules)
    return text


def laid_over(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration with another one over it: mappings are joined key by key, everything else is replaced."""
    joined = dict(under)
    for key, value in over.items():
        below = joined.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            joined[key] = laid_over(below, value)
        else:
            joined[key] = value
    return joined


def named(missions: Sequence[Mission]) -> list[Mission]:
    """The missions with names that tell them apart: those without one are called after their first file.

    Raises ConfigError when two were given the same name.
    """
    given = [mission.name for mission in missions if mission.name]
    if twice := sorted({name for name in given if given.count(name) > 1}):
        raise ConfigError(f"two missions are called {', '.join(twice)}: give each a name of its own")
    called = told_apart([_path(mission) for mission in missions])
    taken, out = set(given), list[Mission]()
    for mission, name in zip(missions, called, strict=True):
        if not mission.name:
            free = next(n for n in chain([name], (f"{name}_{k}" for k in count(2))) if n not in taken)
            taken.add(free)
            mission = replace(mission, name=free)
        out.append(mission)
    return out


def _path(mission: Mission) -> PurePosixPath:
    first = mission.files[0]
    return PurePosixPath(stand_in(Path("/"), first) if is_url(first) else first)
