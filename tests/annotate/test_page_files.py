"""What the page is made of: files of ours and one of a stranger's, none of which does what the policy forbids."""

from __future__ import annotations

import hashlib
import re
from importlib.resources import files

import pytest

HTMX_SHA256 = "d6fdc75f204e6bdefa99b69bf1e6d4ac69b8a364f77929f45c13476b4000f717"  # of htmx.org 2.0.11 on npm
FOLDER = files("mapgraft.annotate")
TEMPLATES = sorted(entry.name for entry in (FOLDER / "templates").iterdir() if entry.name.endswith(".html"))
SCRIPTS = sorted(
    entry.name for entry in (FOLDER / "static").iterdir() if entry.name.endswith(".js") and entry.name != "htmx.min.js"
)


def test_htmx_is_the_published_one_and_its_licence_lies_beside_it() -> None:
    static = FOLDER / "static"
    assert hashlib.sha256((static / "htmx.min.js").read_bytes()).hexdigest() == HTMX_SHA256
    assert "Zero-Clause BSD" in (static / "htmx-LICENSE.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", TEMPLATES)
def test_templates_hold_no_script_no_style_and_nothing_from_elsewhere(name: str) -> None:
    text = (FOLDER / "templates" / name).read_text(encoding="utf-8")
    assert all('src="/static/' in tag for tag in re.findall(r"<script[^>]*>", text))
    assert not re.search(r"<style|\sstyle=|\son[a-z]+=|hx-on|javascript:|hx-vals=.js|\|\s*safe\b", text)
    assert not re.search(r"(src|href|action)=[\"']?(https?:)?//", text)
    assert "autoescape false" not in text


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_make_no_markup_of_text_and_ask_nobody_else(name: str) -> None:
    text = (FOLDER / "static" / name).read_text(encoding="utf-8")
    assert not re.search(r"\.innerHTML|\.outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text)
    assert "://" not in text
    assert len(text.splitlines()) <= 400


def test_the_style_sheet_loads_nothing() -> None:
    text = (FOLDER / "static" / "annotate.css").read_text(encoding="utf-8")
    assert "@import" not in text
    assert "url(" not in text
