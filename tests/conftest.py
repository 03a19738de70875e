"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

WORKER = os.environ.get("PYTEST_XDIST_WORKER")
SHARED_DATA = Path(__file__).parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Give every test process a cache of compiled kernels of its own.

    Numba numbers the files of a function's signatures without a lock: two processes that compile different signatures
    at the same time leave an index that names the wrong file, and whoever loads that one dies.
    """
    if WORKER is not None and config.cache is not None:
        os.environ["NUMBA_CACHE_DIR"] = str(config.cache.mkdir(f"numba-{WORKER}"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings and maps beside the checkout; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the real recordings and maps in ../shared/data, which are not part of the repository")
    return SHARED_DATA
