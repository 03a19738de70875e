"""``mapgraft run``: the main job, with progress and a summary a person can read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mapgraft.commands.overrides import Overrides
from mapgraft.commands.progress import ProgressSink
from mapgraft.commands.summary import as_json_summary, print_summary
from mapgraft.config import Config
from mapgraft.console import cell, print_json, remarks
from mapgraft.errors import ReversalError, UsageError
from mapgraft.job import Result, as_config, demo, run
from mapgraft.plugins import Plugins, load_plugins

__all__ = ["Overrides", "run_and_show"]


def run_and_show(
    files: Sequence[Path],
    config: Path | None,
    out: Path,
    overrides: Overrides,
    *,
    demo_name: str | None = None,
    quiet: bool,
    as_json: bool,
    without: Sequence[str],
    verify_ledger: bool = False,
) -> None:
    """Run, and print what came of it; without files a demo.

    Raises UsageError for files and a demo's name at once, ReversalError when a ledger differs from what is recomputed.
    """
    if files and demo_name is not None:
        raise UsageError(f"--demo {demo_name} replays its own files, found {files[0]} beside it: leave one of them out")
    plugins = load_plugins(without)
    for broken in plugins.broken:
        remarks().print(cell(f"the plugin {broken.origin.plugin} could not be loaded: {broken.reason}"), style="yellow")
    paths = list(files)
    if not paths:
        paths, demo_config = demo(demo_name)
        config = config or demo_config
    checked = overrides.apply(as_config(config))
    result = run_with_progress(paths, checked, out, plugins, quiet=quiet or as_json, verify_ledger=verify_ledger)
    if as_json:
        print_json(as_json_summary(result))
    else:
        print_summary(result)
    if wrong := [finding for finding in result.ledgers if not finding.sound]:
        said = "; ".join(f"{finding.robot}: {finding.sentence}" for finding in wrong)
        raise ReversalError(f"the ledgers do not hold what the recording says: {said}; please report this")


def run_with_progress(
    files: Sequence[Path], config: Config, out: Path, plugins: Plugins, *, quiet: bool, verify_ledger: bool = False
) -> Result:
    """Run with a bar on stderr."""
    with ProgressSink(quiet=quiet) as progress:
        return run(
            files, config, out, plugins=plugins, sinks=[progress], opened=progress.spans, verify_ledger=verify_ledger
        )
