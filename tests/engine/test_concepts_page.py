"""The page on concepts shows the rule that is really shipped."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from ruamel.yaml import YAML

PAGE = Path(__file__).parents[2] / "docs" / "concepts.md"


def test_the_default_rule_is_shown_as_it_is():
    yaml = YAML(typ="safe", pure=True)
    shown = yaml.load(re.search(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL).group(1))
    shipped = yaml.load((files("mapgraft_grid") / "rules.yaml").read_text(encoding="utf-8"))
    assert shown == [rule for rule in shipped if rule["name"] == shown[0]["name"]]
