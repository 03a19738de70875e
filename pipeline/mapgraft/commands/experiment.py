"""``mapgraft experiment``: a published experiment, run again."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from mapgraft.commands.progress import counting
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.evaluation.courses import load_courses
from mapgraft.experiments.andersone2021 import Laboratory, Settings, conduct
from mapgraft.experiments.andersone2021.recordings import chosen
from mapgraft.experiments.andersone2021.timing import timing
from mapgraft.job import as_config, provenance_of
from mapgraft.outputs.lock import EXPERIMENT, locked, require_kind
from mapgraft.outputs.staging import Staging, writing
from mapgraft.plugins import load_plugins

if TYPE_CHECKING:
    from mapgraft.experiments.andersone2021.telling.presentation import Presentation


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
    from mapgraft.experiments.andersone2021.telling.document import DOCUMENT
    from mapgraft.experiments.andersone2021.telling.presentation import present
    from mapgraft.experiments.andersone2021.telling.summary import show

    with writing(out):
        require_kind(out, EXPERIMENT)
    began_s = perf_counter()
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
            experiment = conduct(
                laboratory, lambda found, wanted, drawn: progress(found, wanted, f"merges of {drawn} pairs")
            )
        told = present(experiment, laboratory, provenance_of(paths, checked, plugins, laboratory.table), why)
        last = _write(out, told, parquet_files(experiment), began_s)
    if as_json:
        print_json(json.loads(last[DOCUMENT]))
    else:
        show(experiment, results(), out)


def _write(out: Path, told: Presentation, merges: Mapping[str, bytes], began_s: float) -> Mapping[str, bytes]:
    """Write a whole folder; nothing of it is half-written at any time. Returns the files that tell the time.

    These are written twice: at first to take the time of it as well, and then with the time.
    """
    with writing(out):
        staging = Staging(out)
        for name, content in {**told.files, **merges, **told.last()}.items():
            staging.write(name, content)
        last = told.last(timing(perf_counter() - began_s))
        for name, content in last.items():
            staging.write(name, content)
        staging.publish()
    return last
