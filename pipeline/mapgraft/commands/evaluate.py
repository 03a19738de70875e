"""``mapgraft evaluate``: how good a matcher, an acceptor and a verifier are on recordings whose poses are trusted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from mapgraft.commands.progress import counting
from mapgraft.commands.written_file import require_writable
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.errors import UsageError
from mapgraft.evaluation.bench import Settings
from mapgraft.evaluation.document import document
from mapgraft.evaluation.evaluating import Evaluation, evaluate
from mapgraft.evaluation.tables import Column, print_tables
from mapgraft.job import as_config, provenance_of
from mapgraft.outputs.staging import writing
from mapgraft.plugins import load_plugins

STDOUT = "-"


def evaluate_and_show(
    files: Sequence[Path],
    config: Path | None,
    settings: Settings,
    *,
    jobs: int,
    quiet: bool,
    json_out: str | None,
    without: Sequence[str],
    truth: Path | None = None,
    examples: Path | None = None,
) -> None:
    """Evaluate, print the tables or JSON, and write JSON to a file and examples to a folder if they are named."""
    if not files:
        raise UsageError("name recordings whose poses can be trusted: mapgraft evaluate FILE…")
    if json_out is not None and json_out != STDOUT:
        require_writable("--json", Path(json_out))
    plugins, checked = load_plugins(without), as_config(config)
    for broken in plugins.broken:
        remarks().print(cell(f"the plugin {broken.origin.plugin} could not be loaded: {broken.reason}"), style="yellow")
    with counting("reading, then pairs (kernels compile on first use)", "pairs", quiet=quiet) as progress:
        evaluation = evaluate(
            files,
            checked,
            settings,
            plugins,
            jobs=jobs,
            progress=lambda done: progress(done, settings.drawing.pairs),
            truth=truth,
            examples=examples,
        )
    if json_out is not None:
        table = evaluation.bench.contenders[0].table
        content = document(evaluation, provenance_of(files, checked, plugins, table))
        if json_out == STDOUT:
            print_json(content)
            return
        _write(Path(json_out), json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    _show(evaluation)
    if json_out is not None:
        results().print(cell(f"Written to {json_out}"), soft_wrap=True)
    if examples is not None:
        results().print(cell(f"Examples written to {examples}"), soft_wrap=True)


def _show(evaluation: Evaluation) -> None:
    """The remarks, and the tables where there is anything to count; else a remark says why not."""
    for sentence in evaluation.remarks:
        remarks().print(cell(sentence), style="yellow")
    if all(summary.rejected == summary.pairs for summary in evaluation.summaries.values()):
        return
    print_tables(
        results(),
        [
            Column(title, evaluation.summaries[name], evaluation.times[name])
            for name, title in evaluation.titles.items()
        ],
    )


def _write(path: Path, text: str) -> None:
    with writing(path):
        path.write_text(text, encoding="utf-8")
