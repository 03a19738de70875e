"""Finished folders of missions that are told, not replayed, and a reader of pages that is strict."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path

import pytest
from plots import START_NS, Plot, PlotType, S, provenance, tell, told

from mapgraft.config import Config
from mapgraft.contracts import Exactness, Measurement, Transform
from mapgraft.events import DonorMap, Event, Snapshot
from mapgraft.outputs.run_folder import RunFolder
from mapgraft.remember import remembered_text

_VOID = {"meta", "img", "br", "hr", "link", "input", "base", "col", "area", "embed", "source", "track", "wbr"}
_BLOCKS = {
    "p",
    "div",
    "table",
    "ul",
    "ol",
    "dl",
    "pre",
    "section",
    "article",
    "figure",
    "details",
    "h1",
    "h2",
    "h3",
    "h4",
}


class Page(HTMLParser):
    """Reads a page; raises AssertionError where tags are not closed in order, or a paragraph holds a block."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == [], self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag not in _BLOCKS or "p" not in self.open, f"a <{tag}> in a <p>"
        assert len({name for name, _ in attrs}) == len(attrs), f"an attribute of <{tag}> twice"
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop() == tag, f"</{tag}> at {self.getpos()}"

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words.append(data)

    @property
    def text(self) -> str:
        """What a person reads, with single spaces."""
        return " ".join(" ".join(self.words).split())

    def attributes(self, name: str) -> list[str]:
        return [attrs[name] for _, attrs in self.tags if name in attrs]


@pytest.fixture(scope="session")
def read() -> Callable[[str], Page]:
    return Page


def finished(folder: Path, story: Sequence[object], config: Config | None = None, report: bool = False) -> Path:
    """A run's folder in which a mission was told."""
    with RunFolder(folder, "demo", "r0123456789abcde", provenance(), report=report) as sink:
        tell(sink, story)
        sink.keep("mission.json", remembered_text([Path("/home/somebody/a.mcap")], config or Config()).encode())
        sink.noticed(["a.mcap: 3 scans were left out"])
    return folder


@pytest.fixture(scope="session")
def finish() -> Callable[..., Path]:
    return finished


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the mission of ``plots``; tests must not change it."""
    return finished(tmp_path_factory.mktemp("report") / "out", list(told()))


@pytest.fixture(scope="session")
def many() -> Callable[..., list[Event | Snapshot]]:
    return _many


def _many(
    merges: int, receiver: str = "alpha", donor: str = "bravo", reverted_every: int = 3
) -> list[Event | Snapshot]:
    """One merge after the other between two robots, every so many of them reverted."""
    return list(_story(merges, receiver, donor, reverted_every))


def _story(merges: int, receiver: str, donor: str, reverted_every: int) -> Iterator[Event | Snapshot]:
    seq, kind = 0, PlotType()
    own = Plot({(x, y): 100 if x % 7 == 0 else 0 for x in range(30) for y in range(20)})
    other = Plot({(x, y): 100 if x % 5 == 0 else 0 for x in range(10, 45) for y in range(5, 25)})
    for n in range(merges):
        merge_id, stamp_ns = f"{receiver}.{donor}.{n + 1}", START_NS + n * S
        fields = {"receiver": receiver, "donor": donor, "merge_id": merge_id, "reversal": "ledger"}
        fields["T_receiver_donor"] = Transform.planar(float(n), 1.0, 0.1)

        def shot(why, stamp_ns=stamp_ns, merge_id=merge_id):
            fused = own if why in ("before merge", "after revert") else Plot(own.cells | other.cells)
            donors = {} if why == "after revert" else {donor: DonorMap(kind, other)}
            metadata = kind.metadata(own)
            return Snapshot(receiver, stamp_ns, why, kind, own, fused, kind.encode(own), metadata, 5, merge_id, donors)

        yield shot("before merge")
        yield Event(seq, stamp_ns, "merged", state="provisional", reason=f"merged because of {n}", **fields)
        yield shot("after merge")
        for look in range(4):
            seq += 1
            measured = (Measurement("similarity", 0.9 - 0.1 * look, "1", 50, "higher"),)
            evidence = {"log_odds": look - 2.0, "log_odds.revert_at": 1.5, "similarity.confirm_at": 0.85}
            at_ns = stamp_ns + (look + 1) * S // 8
            yield Event(seq, at_ns, "verified", state="provisional", measurements=measured, evidence=evidence, **fields)
        if n % reverted_every == 0:
            seq += 1
            at_ns = stamp_ns + 7 * S // 8
            yield shot("before revert", at_ns)
            left = Exactness(True, 0, 0, 0, "it was kept apart")
            reason = f"reverted because of {n}"
            yield Event(seq, at_ns, "reverted", state="reverted", reason=reason, exactness=left, **fields)
            yield shot("after revert", at_ns)
        seq += 1


@pytest.fixture
def summary() -> Callable[[Path], dict[str, object]]:
    return lambda folder: json.loads((folder / "summary.json").read_text(encoding="utf-8"))
