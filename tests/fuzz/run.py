"""Fuzz one kind of input for a long time, then tell which branches of the code it is after were taken.

    python tests/fuzz/run.py HARNESS --executions N [--corpus FOLDER] [--seed S]

Guided by coverage with atheris (``pip install 'mapgraft[fuzz]'``), or with ``--engine plain`` by chance alone. Inputs
that reach something new are kept in the corpus. A crash, a hang of more than 5 s, or more than 500 MB end the run; the
input that did it lies in the corpus folder as ``crash-*``, ``timeout-*`` or ``oom-*``. Prints one JSON document.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from fuzz_mutations import mutated
from fuzz_targets import HARNESSES, Harness

LONGEST_S, MOST_MB = 5, 500


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("harness", choices=sorted(HARNESSES))
    parser.add_argument("--executions", type=int, default=100_000)
    parser.add_argument("--corpus", type=Path, help="where inputs are kept (default: a new folder)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--engine", choices=("atheris", "plain"), default="atheris")
    parser.add_argument("--step", choices=("fuzz", "cover"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    harness = HARNESSES[asked.harness]
    if asked.step == "fuzz":
        (_guided if asked.engine == "atheris" else _blind)(harness, asked.corpus, asked.executions, asked.seed)
        return 0
    if asked.step == "cover":
        return _cover(harness, asked.corpus)
    corpus = asked.corpus or Path(tempfile.mkdtemp(prefix=f"mapgraft-fuzz-{harness.name}-"))
    corpus.mkdir(parents=True, exist_ok=True)
    return _whole(harness, corpus, asked)


def _whole(harness: Harness, corpus: Path, asked: argparse.Namespace) -> int:
    """Both steps, each in a process of its own: engines end their process, and coverage must not slow them down."""
    from fuzz_seeds import SEEDS

    for number, seed in enumerate(SEEDS[harness.name]()):
        (corpus / f"seed-{number:03}").write_bytes(seed)
    me = [sys.executable, __file__, harness.name, "--corpus", str(corpus), "--seed", str(asked.seed)]
    began_s = time.monotonic()
    fuzz = subprocess.run(
        [*me, "--step", "fuzz", "--engine", asked.engine, "--executions", str(asked.executions)],
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        errors="replace",
    )
    told = {name: int(value) for name, value in re.findall(r"stat::(\w+):\s+(\d+)", fuzz.stderr)}
    report = {
        "harness": harness.name,
        "engine": asked.engine,
        "executions": told.get("number_of_executed_units", 0),
        "failed": fuzz.returncode != 0,
        "peak_rss_mb": told.get("peak_rss_mb"),
        "seconds": round(time.monotonic() - began_s),
        "corpus": str(corpus),
    }
    if fuzz.returncode != 0:
        sys.stderr.write(fuzz.stderr[-6000:])
    covered = subprocess.run([*me, "--step", "cover"], stdout=subprocess.PIPE, text=True, check=False)
    report |= json.loads(covered.stdout) if covered.returncode == 0 else {"branches": "could not be measured"}
    sys.stdout.write(json.dumps(report, indent=2) + "\n")
    return 1 if report["failed"] else 0


def _guided(harness: Harness, corpus: Path, executions: int, seed: int) -> None:
    import atheris

    for module in harness.plain:
        importlib.import_module(module)
    for module in harness.modules:
        sys.modules.pop(module, None)  # to be imported once more, watched
    with atheris.instrument_imports(include=[*harness.modules]):
        for module in harness.modules:
            importlib.import_module(module)
        run = harness.build()
    for path in sorted(corpus.glob("seed-*")):
        run(path.read_bytes())  # compiles what is compiled at first use, which takes longer than any input may
    options = [
        f"-runs={executions}",
        f"-seed={seed}",
        f"-max_len={harness.max_bytes}",
        f"-timeout={LONGEST_S}",
        f"-rss_limit_mb={MOST_MB}",
        f"-artifact_prefix={corpus}/",
        "-print_final_stats=1",
        "-len_control=0",
        str(corpus),
    ]
    atheris.Setup([sys.argv[0], *options], run)
    atheris.Fuzz()


def _blind(harness: Harness, corpus: Path, executions: int, seed: int) -> None:
    import faulthandler

    run, chance = harness.build(), random.Random(seed)
    seeds = [path.read_bytes() for path in sorted(corpus.iterdir())]
    for number in range(executions):
        data = mutated(seeds, chance)[: harness.max_bytes]
        faulthandler.dump_traceback_later(LONGEST_S, exit=True)
        try:
            run(data)
        except BaseException:
            (corpus / f"crash-{seed}-{number}").write_bytes(data)
            raise
        if number % 1000 == 0 and resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > MOST_MB * 1024:
            (corpus / f"oom-{seed}-{number}").write_bytes(data)
            raise MemoryError(f"more than {MOST_MB} MB")
    faulthandler.cancel_dump_traceback_later()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    sys.stderr.write(f"stat::number_of_executed_units: {executions}\nstat::peak_rss_mb: {peak_mb}\n")


def _cover(harness: Harness, corpus: Path) -> int:
    """Run the corpus once more, and print the share of branches taken, and those that were not."""
    import coverage

    files = [spec.origin for spec in map(importlib.util.find_spec, harness.modules) if spec and spec.origin]
    watcher = coverage.Coverage(branch=True, data_file=None, include=files, messages=False)
    watcher.start()
    run = harness.build()
    for path in sorted(corpus.iterdir()):
        if not path.name.startswith(("crash-", "timeout-", "oom-")):
            run(path.read_bytes())
    watcher.stop()
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        watcher.json_report(outfile=file.name, show_contexts=False)
        found = json.loads(Path(file.name).read_text())
    totals = found["totals"]
    missed = {
        Path(name).stem: [f"{a}→{b}" for a, b in file["missing_branches"]] for name, file in found["files"].items()
    }
    document = {
        "inputs": len(list(corpus.iterdir())),
        "branches": totals["num_branches"],
        "branches_taken": totals["covered_branches"],
        "branch_coverage_percent": round(100 * totals["covered_branches"] / max(totals["num_branches"], 1), 1),
        "line_coverage_percent": round(100 * totals["covered_lines"] / max(totals["num_statements"], 1), 1),
        "branches_missed": {name: arcs for name, arcs in missed.items() if arcs},
    }
    sys.stdout.write(json.dumps(document) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
