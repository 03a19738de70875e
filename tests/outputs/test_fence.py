"""Names and links that lead out of a folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.errors import OutputError
from mapgraft.outputs.fence import file_in, folder_in, is_name, lies_in

PIECES = st.sampled_from(["a", "b.c", "..", ".", "", "...", " ", "..a", "ä"])


@given(st.lists(PIECES, max_size=5).map("/".join))
def test_a_name_is_spelt_in_one_way_and_stays_below(name: str) -> None:
    """``normpath`` goes up where '..' does, and changes what is not spelt in the one way."""
    below = os.path.normpath(f"/out/{name}")
    assert is_name(name) == (below == f"/out/{name}" and below != "/out/")


@given(st.text(), st.text())
def test_two_names_are_two_files(one: str, other: str) -> None:
    if is_name(one) and is_name(other) and one != other:
        assert file_in(Path("/nowhere"), one) != file_in(Path("/nowhere"), other)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "/", "/a", "a/../b", "a/..", "a//b", "a/", "./a", "a\0", "\ud800", None, 7, b"a", ["a"]]
)
def test_what_is_no_name(tmp_path: Path, name: object) -> None:
    assert not is_name(name) and not lies_in(tmp_path, name)
    if isinstance(name, str):
        with pytest.raises(OutputError, match="is not the name of a file below"):
            file_in(tmp_path, name)


def test_names_that_are_not_utf_8_are_names(tmp_path: Path) -> None:
    assert is_name(os.fsdecode(b"r\xe9union.merge.mcap"))


def test_links_on_the_way_and_in_the_place(tmp_path: Path) -> None:
    (tmp_path / "out" / "a").mkdir(parents=True)
    (tmp_path / "here").symlink_to(tmp_path / "out")
    for out in (tmp_path / "out", tmp_path / "here"):
        assert file_in(out, "a/b/c") == out / "a/b/c"
        assert folder_in(out, "a/b") == out / "a/b"
    (tmp_path / "out" / "link").symlink_to(tmp_path / "out" / "a")
    (tmp_path / "out" / "a" / "gone").symlink_to(tmp_path / "not there")
    for name in ("link/b", "a/gone/b", "link/a/b"):
        with pytest.raises(OutputError, match="is a link, which may lead out of"):
            file_in(tmp_path / "here", name)
        assert not lies_in(tmp_path / "here", name)
    assert file_in(tmp_path / "here", "link") == tmp_path / "here" / "link"
    with pytest.raises(OutputError, match="is a link"):
        folder_in(tmp_path / "here", "link")
