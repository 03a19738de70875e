"""Installing packages as a stranger does, and running mapgraft beside them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

Run = Callable[..., subprocess.CompletedProcess[str]]
Place = Callable[..., Path]
STARTUP_S = 600  # a subprocess that takes longer hangs; kernels may have to be compiled first


@pytest.fixture(scope="session")
def pip_install(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Installs a package's source folder with pip, without network, into a folder of its own; returns that folder."""

    def install(source: Path) -> Path:
        target = tmp_path_factory.mktemp("installed")
        options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet"]
        command = [sys.executable, "-m", "pip", "install", *options, "--target", str(target), str(source)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=STARTUP_S, check=False)
        assert done.returncode == 0, f"{' '.join(command)}\n{done.stderr}"
        return target

    return install


@pytest.fixture(scope="session")
def lay_out(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Puts one module with an entry point into a folder of its own, as if installed; returns that folder."""

    def lay(module: str, text: str) -> Path:
        folder = tmp_path_factory.mktemp(module)
        (folder / f"{module}.py").write_text(text, encoding="utf-8")
        about = folder / f"mapgraft_{module}-0.1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: mapgraft-{module}\nVersion: 0.1\n")
        (about / "entry_points.txt").write_text(f"[mapgraft]\n{module} = {module}\n")
        return folder

    return lay


@pytest.fixture(scope="session")
def mapgraft() -> Run:
    """Runs the command line in a process that finds the given folders' packages; returns what it said."""

    def run(
        arguments: Sequence[str], installed: Sequence[Path] = (), environment: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        paths = os.pathsep.join(str(folder) for folder in installed)
        return subprocess.run(
            [sys.executable, "-m", "mapgraft", *arguments],
            env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "200", **(environment or {})},
            capture_output=True,
            text=True,
            timeout=STARTUP_S,
            check=False,
        )

    return run
