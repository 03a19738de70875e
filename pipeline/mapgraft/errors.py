"""Every error mapgraft raises on purpose.

MapgraftError                  exit code 1; one sentence: what, what was found, what to do
├── UsageError                 exit code 2; the command line or the configuration is wrong
│   ├── ConfigError            the configuration does not fit its schema (all faults at once)
│   └── DecisionTableError     the decision table does not fit its schema
├── RecordingError             a file cannot be read as a recording, or holds nothing to map
│   └── NothingToMapError      the files can be read, and no robot in them can be mapped
├── PluginError                a plugin is missing, broken, or broke its contract
│   ├── FailedPluginError      one plugin failed while the run was under way; the run goes on without it
│   └── SetAsideError          a plugin failed so often before, or took so long, that it was not asked this time
├── TransformError             a matrix is not a rigid transform, or a pose is not finite
├── MapError                   a map cannot be read, is empty, or does not fit the operation
│   └── EmptyMapError          the map knows nothing yet
├── ReversalError              a merge cannot be made, replaced or taken out
│   └── IrreversibleError      a map type failed to take a merge out again, which therefore stands
└── OutputError                the output folder cannot be written
"""

from __future__ import annotations


class MapgraftError(Exception):
    """Something that a person can mend; its text is shown as it is."""

    exit_code = 1


class UsageError(MapgraftError):
    """The command line or the configuration is wrong."""

    exit_code = 2


class ConfigError(UsageError):
    """The configuration does not fit its schema; the text lists all faults with their paths."""


class DecisionTableError(UsageError):
    """A decision table does not fit its schema."""


class RecordingError(MapgraftError):
    """A file cannot be read as a recording, or holds nothing to map."""


class NothingToMapError(RecordingError):
    """The files can be read, and no robot in them can be mapped."""


class PluginError(MapgraftError):
    """A plugin is missing, broken, or broke its contract."""


class FailedPluginError(PluginError):
    """One plugin failed while the run was under way.

    ``plugin`` is its kind and name, ``method`` what it was asked for, where it is asked for many things.
    """

    def __init__(
        self, sentence: str, plugin: tuple[str, str], method: str = "", *, took_too_long: bool = False
    ) -> None:
        super().__init__(sentence)
        self.plugin, self.method = plugin, method
        self.took_too_long = took_too_long


class SetAsideError(PluginError):
    """A plugin was not asked, because it failed too often before or took too long; ``plugin`` is its kind and name."""

    def __init__(self, sentence: str, plugin: tuple[str, str]) -> None:
        super().__init__(sentence)
        self.plugin = plugin


class TransformError(MapgraftError):
    """A matrix is not a rigid transform, or a pose is not finite."""


class MapError(MapgraftError):
    """A map cannot be read, or does not fit what was asked of it."""


class EmptyMapError(MapError):
    """The map knows nothing yet, so it can neither be matched nor fused."""


class ReversalError(MapgraftError):
    """A merge cannot be made, replaced or taken out."""


class IrreversibleError(ReversalError):
    """A map type failed to take a merge out again, which therefore stands; an event tells it."""


class OutputError(MapgraftError):
    """The output folder cannot be written."""
