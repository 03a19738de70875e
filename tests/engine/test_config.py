"""The configuration says everything that is wrong with it at once, and where."""

from __future__ import annotations

import pytest

from mapgraft.config import load_config, parse_config
from mapgraft.contracts import ConfigError


def test_all_faults_at_once_with_their_paths():
    with pytest.raises(ConfigError) as error:
        parse_config(
            {
                "mission": {"start": "algned", "evry": 2},
                "robots": {"a": {"poses": {"max_gap_s": -1}, "window": {"start_s": 5, "end_s": 2}}},
                "reversal": "lodger",
            }
        )
    text = str(error.value)
    assert text.startswith("the configuration has 5 faults:")
    for part in ("mission.start: ", "mission.evry: there is no such key", "robots.a.poses.max_gap_s: ",
                 "robots.a.window: end_s must lie after start_s", "reversal: "):  # fmt: skip
        assert part in text


@pytest.mark.parametrize("name", ("", "..", "a/b", "a b", "\x1b[31m", "x" * 101))
def test_a_robots_name_must_do_as_a_file_name(name):
    with pytest.raises(ConfigError, match="a robot's name is letters, digits"):
        parse_config({"robots": {name: {}}})


@pytest.mark.parametrize(
    ("suffix", "text"),
    [(".yaml", "exchange: {use: every, seconds: 1e-3}\n"), (".toml", "[exchange]\nuse='every'\nseconds=1e-3\n")],
)
def test_yaml_and_toml(tmp_path, suffix, text):
    path = tmp_path / f"c{suffix}"
    path.write_text(text)
    assert load_config(path).exchange.parameters == {"seconds": 0.001}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: [1", "is not valid YAML at line"),
        ("- 1", "must hold a mapping"),
        ("a: 1\na: 2", "is not valid YAML"),
    ],
)
def test_files_that_are_no_configuration(tmp_path, text, sentence):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=sentence):
        load_config(path)


def test_a_missing_file_is_one_sentence(tmp_path):
    with pytest.raises(ConfigError, match=r"there is no file .*c\.yaml: check the path"):
        load_config(tmp_path / "c.yaml")


def test_paths_are_taken_from_the_files_own_folder(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("rules: rules.yaml\nrobots: {a: {poses: {file: slam.bag}}}\n")
    config = load_config(path)
    assert config.rules == tmp_path / "rules.yaml"
    assert config.robots["a"].poses.file == tmp_path / "slam.bag"
