"""``mapgraft experiment``: a published experiment, run again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from mapgraft.commands.progress import counting
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.evaluation.courses import load_courses
from mapgraft.experiments.andersone2021 import Laboratory, Settings, conduct
from mapgraft.experiments.andersone2021.recordings import chosen
from mapgraft.job import as_config, provenance_of
from mapgraft.outputs.lock import locked
from mapgraft.outputs.staging import Staging, writing
from mapgraft.plugins import load_plugins


def conduct_and_show(
    files: Sequence[Path],
    config: Path | None,
    out: Path,
    settings: Settings,
    *,
    quiet: bool,
    as_json: bool,
    without: Sequence[str],
) -> None:
    """Conduct the experiment, write its folder, and print what came of it."""
    from mapgraft.experiments.andersone2021.store import parquet_files
    from mapgraft.experiments.andersone2021.telling.presentation import present
    from mapgraft.experiments.andersone2021.telling.summary import show

    plugins, checked = load_plugins(without), as_config(config)
    for broken in plugins.broken:
        remarks().print(cell(f"the plugin {broken.origin.plugin} could not be loaded: {broken.reason}"), style="yellow")
    paths, why = list(files), ""
    if not paths:
        paths, why = chosen()
        remarks().print(cell(why))
    laboratory = Laboratory.of(load_courses(paths, checked, plugins), checked, settings, plugins)
    with locked(out):
        with counting("merges (kernels compile on first use)", "merges", quiet=quiet or as_json) as progress:
            experiment = conduct(laboratory, progress)
        told = present(experiment, laboratory, provenance_of(paths, checked, plugins, laboratory.table), why)
        _write(out, {**told, **parquet_files(experiment)})
    if as_json:
        print_json(json.loads(told["experiment.json"]))
    else:
        show(experiment, results(), out)


def _write(out: Path, files: Mapping[str, bytes]) -> None:
    """Write a whole folder; nothing of it is half-written at any time."""
    with writing(out):
        staging = Staging(out)
        for name, content in files.items():
            staging.write(name, content)
        staging.publish()
