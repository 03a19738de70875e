"""Ctrl-C where a recording has just been created, and at every other line that opens, fills and finishes a folder."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from itertools import islice
from pathlib import Path

import pytest
from interrupting import Line, interrupted, of_modules
from plots import provenance, tell, told

from mapgraft import job
from mapgraft.events import Event
from mapgraft.outputs.lock import locked, settled
from mapgraft.outputs.read_back import read_events
from mapgraft.outputs.run_folder import ROUTINE, RunFolder
from mapgraft.outputs.staging import SUFFIX

MCAP = "demo.merge.mcap"
END = b"\x89MCAP0\r\n"
WRITERS = of_modules(
    *("run_folder.py", "staging.py", "mcap_log.py", "parquet_log.py", "unfinished.py", "lock.py", "poses.py")
)


def write(folder: Path, decided: list[int], length: int = 300) -> None:
    """Tell the beginning of the story to a folder, as a run does; ``decided`` gets the decisions that were reported."""
    with ExitStack() as stack:
        sink = RunFolder(folder, "demo", "r1", provenance())
        stack.push(sink)
        sink.open()
        sink.keep("mission.json", b"{}")
        for item in islice(told(), length):
            tell(sink, [item])
            if isinstance(item, Event) and item.kind not in ROUTINE:
                decided.append(item.seq)
        sink.finish()


def check(folder: Path, decided: list[int]) -> str:
    """What a folder in which somebody was interrupted holds, which must be whole; ``decided`` is in it."""
    settled(folder)
    if (folder / MCAP).exists():
        assert (folder / "summary.json").exists() and not list(folder.rglob(f"*{SUFFIX}"))
        return "finished"
    rests = sorted(folder.rglob(f"*{SUFFIX}"))
    partial = folder / f"{MCAP}{SUFFIX}"
    assert all(path in rests or path.name.startswith(".mapgraft") for path in folder.rglob("*") if path.is_file())
    if partial not in rests:
        assert not decided and not rests
        return "nothing"
    assert partial.read_bytes().endswith(END) and not partial.read_bytes().endswith(END * 2)
    assert {*decided} <= {event.seq for event in read_events(partial)}
    return "ended"


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # where it comes, Python may be the one who closes
def test_wherever_it_comes_a_recording_has_its_end_or_was_not_begun(tmp_path: Path) -> None:
    with interrupted(WRITERS) as lines:
        write(tmp_path / "undisturbed", [])
    begun = next(n for n, (file, _) in enumerate(lines) if file.endswith("poses.py"))
    assert begun > 100 and len(lines) > begun + 200
    found = []
    for n, line in enumerate([*lines[:begun:2], *lines[begun::5]]):
        folder, decided = tmp_path / f"{n:03d}", list[int]()
        with pytest.raises(KeyboardInterrupt), interrupted(WRITERS, line):
            write(folder, decided)
        if folder.is_dir():
            found.append(check(folder, decided))
            with locked(folder):  # the lock was given back
                pass
    assert {*found} == {"nothing", "ended", "finished"}
    assert min(map(found.count, found)) > 2
    with RunFolder(folder, "demo", "r1", provenance()):
        pass
    assert not list(folder.rglob(f"*{SUFFIX}"))


def test_a_run_hands_its_folder_to_nobody_who_does_not_close_it(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    log.write_text("".join(f"FLASER 4 1 2 1 2 {n} 0 0 {n} 0 0 {n} h {n}\n" for n in range(5)))

    def run(folder: Path, at: Line | None = None) -> list[Line]:
        config = {"rules": [], "output": {"report": False}}
        with interrupted(lambda code: code.co_filename == job.__file__ and code.co_name == "run", at) as lines:
            job.run(log, config, folder)
        return lines

    lines, found = run(tmp_path / "undisturbed"), []
    source = Path(job.__file__).read_text().splitlines()
    first = next(n for n, (_, line) in enumerate(lines) if "_output(" in source[line - 1])
    for n, line in enumerate(lines[first : first + 18]):
        folder = tmp_path / f"{n:02d}"
        with pytest.raises(KeyboardInterrupt):
            run(folder, line)
        with suppress(StopIteration):
            partial = next(folder.glob("*.merge.mcap.partial"))
            found.append(partial.read_bytes().endswith(END))
    assert len(found) > 5 and all(found)
