"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

if WORKER := os.environ.get("PYTEST_XDIST_WORKER"):
    # Every test process compiles into a cache of its own, told before any kernel is imported. Numba numbers the files
    # of a function's signatures without a lock: two processes that compile different ones at the same time can leave an
    # index that names the wrong file, and whoever loads that one dies.
    os.environ["NUMBA_CACHE_DIR"] = str(Path(__file__).parents[1] / ".pytest_cache" / f"numba-{WORKER}")

SHARED_DATA = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings and maps beside the checkout; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the real recordings and maps in ../shared/data, which are not part of the repository")
    return SHARED_DATA
