"""Compiled kernels on disk: processes that compile at once, are killed, or find rests, never run the wrong code."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import textwrap
import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from mapgraft.contracts.kernels import SharedCacheFile, share_cache

ONE, OTHER = "one", "other"


@pytest.fixture(autouse=True)
def _shared() -> None:
    share_cache()


@dataclass
class Turn:
    """Something to be pickled that lets another thread go on, and waits for it, while it is."""

    text: str
    tells: threading.Event = field(default_factory=threading.Event)
    waits: threading.Event | None = None

    def __hash__(self) -> int:
        return hash(self.text)

    def __eq__(self, other: object) -> bool:
        return str(other) == self.text

    def __str__(self) -> str:
        return self.text

    def __reduce__(self) -> tuple[type, tuple[str]]:
        self.tells.set()
        if self.waits is not None:
            self.waits.wait(10.0)  # whoever goes on first, it has to be right
        return str, (self.text,)


def write(path: Path, key: object, data: object, stamp: str = "source") -> None:
    SharedCacheFile(str(path), "kernel-1.py311", stamp).save(key, data)


def read(path: Path, key: object, stamp: str = "source") -> object:
    return SharedCacheFile(str(path), "kernel-1.py311", stamp).load(key)


def test_two_that_write_at_once_leave_no_name_of_the_others_code(tmp_path: Path) -> None:
    keys, codes = [Turn(ONE), Turn(OTHER)], [Turn(f"code of {ONE}"), Turn(f"code of {OTHER}")]
    done = threading.Event()
    keys[0].waits = keys[1].tells  # where the index is read first, both have read it before either writes it
    keys[1].waits = codes[0].tells  # the other one's index is the last one
    codes[0].waits = done  # and its code is not

    def write_other() -> None:
        write(tmp_path, keys[1], codes[1])
        done.set()

    writers = [threading.Thread(target=write, args=(tmp_path, keys[0], codes[0])), threading.Thread(target=write_other)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    found = {name: read(tmp_path, name) for name in (ONE, OTHER)}
    assert any(found.values())
    assert all(code in (None, f"code of {name}") for name, code in found.items())


class Deadly:
    """Something to be pickled that ends the process."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __reduce__(self) -> tuple[type, tuple[str]]:
        if self.text == "die":
            raise SystemExit
        return str, (self.text,)


def test_whoever_is_killed_on_the_way_leaves_no_name_of_older_code(tmp_path: Path) -> None:
    write(tmp_path, ONE, "code of the old source", stamp="old")
    for key, data in ((Deadly("die"), "new"), (ONE, Deadly("die"))):
        with pytest.raises(SystemExit):
            write(tmp_path, key, data, stamp="new")
        assert read(tmp_path, ONE, stamp="new") is None


def test_what_a_power_cut_has_spoiled_is_compiled_again(tmp_path: Path) -> None:
    write(tmp_path, ONE, "code")
    (code,) = tmp_path.glob("*.nbc")
    (index,) = tmp_path.glob("*.nbi")
    whole = {path: path.read_bytes() for path in (code, index)}
    for path, content in whole.items():
        for spoiled in (b"", content[: len(content) // 2], bytes(len(content))):
            path.write_bytes(spoiled)
            assert read(tmp_path, ONE) is None
            write(tmp_path, OTHER, "code of another")
            assert read(tmp_path, OTHER) == "code of another"
            write(tmp_path, ONE, "code")
            assert read(tmp_path, ONE) == "code"
    code.unlink()
    assert read(tmp_path, ONE) is None


def test_numbered_files_of_before_are_not_trusted(tmp_path: Path) -> None:
    SharedCacheFile.numbered(str(tmp_path), "kernel-1.py311", "source").save(ONE, "code")
    assert pickle.loads((tmp_path / "kernel-1.py311.1.nbc").read_bytes()) == "code"
    assert read(tmp_path, ONE) is None


KERNEL = """
    import os, sys, time
    from pathlib import Path
    from mapgraft.contracts.kernels import share_cache

    share_cache()
    sys.path.insert(0, sys.argv[1])
    from kernel_of_the_test import double

    ready = Path(sys.argv[1], f"ready{sys.argv[2]}")
    ready.touch()
    while len(list(Path(sys.argv[1]).glob("ready*"))) < int(sys.argv[3]):
        time.sleep(0.01)
    for value in ((3, 1.5), (3,), (1.5,))[int(sys.argv[2])]:
        print(double(value))
    print(sum(double.stats.cache_hits.values()))
"""


def test_processes_that_compile_at_once_share_what_they_have_compiled(tmp_path: Path) -> None:
    (tmp_path / "kernel_of_the_test.py").write_text(
        "from numba import njit\n\n\n@njit(cache=True)\ndef double(x):\n    return x + x\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def compiled(*roles: int) -> list[list[str]]:
        for ready in tmp_path.glob("ready*"):
            ready.unlink()
        command = [sys.executable, "-c", textwrap.dedent(KERNEL), str(tmp_path)]
        several = [
            subprocess.Popen([*command, str(n), str(len(roles))], env=environment, stdout=subprocess.PIPE, text=True)
            for n in roles
        ]
        return [process.communicate(timeout=120)[0].split() for process in several]

    assert compiled(1, 2) == [["6", "0"], ["3.0", "0"]]
    ((*values, hits),) = compiled(0)
    assert values == ["6", "3.0"] and hits in ("1", "2")  # of two who write at once one may lose its entry
    assert len(list((tmp_path / "cache").rglob("*.nbi"))) == 1


def test_the_package_of_our_kernels_shares_its_cache() -> None:
    code = "import mapgraft_grid.kernels.rays as r; print(type(r.project._cache._cache_file).__name__)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=60)
    assert done.stdout == "SharedCacheFile\n"
