"""A small experiment on the demo recordings."""

from __future__ import annotations

import pytest

from mapgraft.config import parse_config
from mapgraft.evaluation import load_courses
from mapgraft.experiments.andersone2021 import Experiment, Laboratory, Settings, conduct
from mapgraft.plugins import load_plugins
from mapgraft_recordings import demo_files


@pytest.fixture(scope="session")
def laboratory() -> Laboratory:
    """Two right and two wrong merges are wanted of each combination."""
    config, plugins = parse_config({}), load_plugins()
    return Laboratory.of(load_courses(demo_files()[0], config, plugins), config, Settings(right=2, wrong=2), plugins)


@pytest.fixture(scope="session")
def experiment(laboratory: Laboratory) -> Experiment:
    return conduct(laboratory)
