"""Who writes as which source: the same for all who have heard the same, in whatever order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mapgraft.graph.claims import Source
from mapgraft.network import writers
from mapgraft.network.writers import NOBODY, Writers

HEARD = st.lists(
    st.tuples(st.builds(Source, st.sampled_from("ab"), st.integers(1, 2)), st.sampled_from([b"1", b"2", b"3"]))
)


@given(HEARD, st.randoms(use_true_random=False))
def test_the_smallest_writer_is_the_source_whoever_was_heard_first(heard, random):
    one, other = Writers(), Writers()
    for source, writer in heard:
        one.hear(source, writer)
    for source, writer in random.sample(heard, len(heard)):
        is_its = other.hear(source, writer)
        assert is_its == (other.of(source) == writer)
    assert one == other
    by_source = {source: {writer for told, writer in heard if told == source} for source, _ in heard}
    assert {source: one.of(source) for source in by_source} == {source: min(by_source[source]) for source in by_source}
    assert one.shared == {source for source, told in by_source.items() if len(told) > 1}


def test_of_whom_nothing_was_heard_nobody_writes():
    assert Writers().of(Source("a", 1)) == NOBODY
    heard = Writers()
    assert heard.hear(Source("a", 1), NOBODY) and not heard.sources


def test_that_there_are_several_is_told_on_by_who_has_heard_of_one():
    heard = Writers()
    assert heard.hear(Source("a", 1), b"1", of_several=True)
    assert heard.shared == {Source("a", 1)}


def test_no_more_sources_are_kept_than_anybody_has_use_for(monkeypatch):
    monkeypatch.setattr(writers, "MOST_SOURCES", 2)
    heard = Writers()
    for name in "abcd":
        assert heard.hear(Source(name, 1), b"2", of_several=True)
    assert not heard.hear(Source("a", 1), b"3")
    assert heard.sources == {Source("a", 1), Source("b", 1)} == heard.shared
