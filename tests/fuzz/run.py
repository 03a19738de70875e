"""Fuzz one kind of input for a long time, then tell which branches of the code it is after were taken.

    python tests/fuzz/run.py HARNESS --executions N [--corpus FOLDER] [--seed S]

Guided by coverage with atheris (``pip install 'mapgraft[fuzz]'``), or with ``--engine plain`` by chance alone. Inputs
that reach something new are kept in the corpus, and executions add up in ``executions.json`` beside it: started again
with the same folder it goes on. A crash, a hang of more than 5 s, or more than 500 MB end the run; the input that did
it lies in the corpus folder as ``crash-*``, ``timeout-*`` or ``oom-*``. ``--executions 0`` only measures the branches.
Prints one JSON document.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import importlib.util
import inspect
import json
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from fuzz_mutations import mutated
from fuzz_targets import HARNESSES, Harness, bounded

LONGEST_S, MOST_MB = 5, 500
SLICE = 25_000
"""Executions of one process: by then they are counted, whatever comes, and the engine gives its memory back."""


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
    from fuzz_stock import SEEDS

    for number, seed in enumerate(SEEDS[harness.name]()):
        (corpus / f"seed-{number:03}").write_bytes(seed[: harness.max_bytes])
    ledger, code = corpus.with_name(corpus.name + ".executions.json"), _digest(harness)
    runs = json.loads(ledger.read_text()) if ledger.exists() else []
    me = [sys.executable, __file__, harness.name, "--corpus", str(corpus), "--engine", asked.engine]
    failed, left = False, asked.executions
    while left > 0 and not failed:
        more, seed = min(left, SLICE), asked.seed + len(runs)
        began_s = time.monotonic()
        told, failed = _slice([*me, "--step", "fuzz", "--executions", str(more), "--seed", str(seed)])
        done = told.get("number_of_executed_units", 0)
        seconds = round(time.monotonic() - began_s)
        runs.append({"executions": done, "seconds": seconds, "peak_rss_mb": told.get("peak_rss_mb"), "code": code})
        ledger.write_text(json.dumps(runs, indent=1))
        left -= more
    counted = [run for run in runs if run["code"] == code]
    report = {
        "harness": harness.name,
        "engine": asked.engine,
        "executions": sum(run["executions"] for run in counted),
        "executions_of_other_code": sum(run["executions"] for run in runs if run["code"] != code),
        "failed": failed,
        "peak_rss_mb": max((run["peak_rss_mb"] or 0 for run in counted), default=0),
        "seconds": sum(run["seconds"] for run in counted),
        "code": code,
        "corpus": str(corpus),
    }
    covered = subprocess.run([*me, "--step", "cover"], stdout=subprocess.PIPE, text=True, check=False)
    report |= json.loads(covered.stdout) if covered.returncode == 0 else {"branches": "could not be measured"}
    sys.stdout.write(json.dumps(report, indent=2) + "\n")
    return 1 if failed else 0


def _slice(command: list[str]) -> tuple[dict[str, int], bool]:
    """What the engine tells of one process, and whether it found something."""
    fuzz = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
    if fuzz.returncode != 0:
        sys.stderr.write(fuzz.stderr[-3000:] + fuzz.stdout[-3000:])
    told = re.findall(r"stat::(\w+):\s+(\d+)", fuzz.stderr)
    return {name: int(value) for name, value in told}, fuzz.returncode != 0


def _digest(harness: Harness) -> str:
    """A name for what is run: the code that the harness is after, what calls it, and its bounds."""
    specs = map(importlib.util.find_spec, harness.modules)
    files = [Path(spec.origin) for spec in specs if spec and spec.origin]
    texts = [path.read_bytes() for path in (*files, Path(inspect.getfile(harness.build)))]
    return hashlib.sha256(b"\0".join((*texts, repr(dict(harness.bounds)).encode()))).hexdigest()[:12]


def _guided(harness: Harness, corpus: Path, executions: int, seed: int) -> None:
    import atheris

    for module in harness.plain:
        importlib.import_module(module)
    for module in harness.modules:
        sys.modules.pop(module, None)  # to be imported once more, watched
    with atheris.instrument_imports(include=[*harness.modules]):
        for module in harness.modules:
            importlib.import_module(module)
        with bounded(harness):
            run = harness.build()
            seeds = [path.read_bytes() for path in sorted(corpus.glob("seed-*"))]
            for data in seeds:
                run(data)  # compiles what is compiled at first use, which takes longer than any input may
            atheris.Setup([sys.argv[0], *_options(harness, corpus, executions, seed)], run, **_damage(harness))
            atheris.Fuzz()


def _options(harness: Harness, corpus: Path, executions: int, seed: int) -> list[str]:
    words = corpus.with_name(corpus.name + ".words")
    spelt = ("".join(f"\\x{octet:02x}" for octet in word.encode()) for word in harness.words)
    words.write_text("".join(f'"{word}"\n' for word in spelt))
    return [
        f"-runs={executions}",
        f"-seed={seed}",
        f"-max_len={harness.max_bytes}",
        f"-timeout={LONGEST_S}",
        f"-rss_limit_mb={MOST_MB}",
        f"-artifact_prefix={corpus}/",
        f"-dict={words}",
        "-print_final_stats=1",
        "-len_control=0",
        str(corpus),
    ]


def _damage(harness: Harness) -> dict[str, Callable[[bytes, int, int], bytes]]:
    """The harness's own way to change inputs, as the engine takes it; nothing where it has none."""
    import atheris

    damage = harness.damage
    if damage is None:
        return {}

    def mutator(data: bytes, most: int, seed: int) -> bytes:
        chance = random.Random(seed)
        return damage(data, chance, lambda part: atheris.Mutate(part, max(len(part) + 16, 32)))[:most]

    return {"custom_mutator": mutator}


def _blind(harness: Harness, corpus: Path, executions: int, seed: int) -> None:
    import faulthandler

    chance, seeds = random.Random(seed), [path.read_bytes() for path in sorted(corpus.iterdir())]
    with bounded(harness):
        run = harness.build()
        for number in range(executions):
            data = mutated(seeds, chance, harness.damage)[: harness.max_bytes]
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
    for module in harness.modules:
        importlib.import_module(module)
    with bounded(harness):
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
        f"{Path(name).parent.name}.{Path(name).stem}": [f"{a}→{b}" for a, b in file["missing_branches"]]
        for name, file in found["files"].items()
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
