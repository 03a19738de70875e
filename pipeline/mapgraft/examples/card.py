"""The data card of a dataset: what is in it, how it was made, how its labels came about, and what it cannot tell."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final

import pyarrow as pa

from mapgraft.evaluation.truth import RIGHT_DEG, RIGHT_M
from mapgraft.examples import looks, pictures, window
from mapgraft.examples.splits import SPLITS
from mapgraft_schemas import Column, table

CARD: Final = "README.md"
_BEGIN, _END = "<!-- your own words: they stay as they are -->", "<!-- end of your own words -->"
_NOBODY: Final = """\
Nobody has written anything here yet. Say who recorded what, where, with which robots and sensors, who labelled, and
under which licence others may use it; this part stays as it is when the dataset is published again."""
_SIZES: Final = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


@dataclass(slots=True)
class Tally:
    """What a card counts of the rows of a dataset."""

    COLUMNS: ClassVar = (
        *("environment", "label", "label_by", "labels", "truth_by", "verdict", "state", "receiver_type"),
        *("donor_type", "software", "rule"),
    )

    rows: Counter[str] = field(default_factory=Counter)
    labels: Counter[tuple[str, str]] = field(default_factory=Counter)  # split, label
    buildings: dict[str, Counter[str]] = field(default_factory=dict)  # split → environment
    came: Counter[str] = field(default_factory=Counter)  # how labels came about
    became: Counter[str] = field(default_factory=Counter)
    types: Counter[str] = field(default_factory=Counter)
    software: set[str] = field(default_factory=set)
    persons: set[str] = field(default_factory=set)
    words: int = 0

    @property
    def environments(self) -> set[str]:
        """Every building of which there are examples."""
        return {name for counted in self.buildings.values() for joined in counted for name in joined.split("+")}

    def add(self, split: str, rows: pa.Table) -> None:
        """Count some rows of a split."""
        told = {name: rows[name].to_pylist() for name in self.COLUMNS if name != "labels"}
        self.rows[split] += len(rows)
        self.labels.update((split, label or "nobody knows") for label in told["label"])
        self.buildings.setdefault(split, Counter()).update(told["environment"])
        for by, truth_by in zip(told["label_by"], told["truth_by"], strict=True):
            self.came[truth_by if by == "truth" else "persons" if by else "nobody knows"] += 1
        self.became.update(
            f"{verdict}, {state}" if state else verdict
            for verdict, state in zip(told["verdict"], told["state"], strict=True)
        )
        self.types.update(
            f"{receiver or 'unknown'} ← {donor or 'unknown'}"
            for receiver, donor in zip(told["receiver_type"], told["donor_type"], strict=True)
        )
        self.software |= {version for version in told["software"] if version}
        annotators = rows["labels"].combine_chunks().flatten().field("annotator").to_pylist()
        self.words += len(annotators)
        self.persons |= set(annotators)


def card(tally: Tally, left_out: Mapping[str, int], licence: str | None, earlier: str) -> str:
    """The text of ``README.md``; what persons have written into an ``earlier`` one stays."""
    sections = [
        _header(tally, licence),
        "# Attempts to merge the maps of robots, labelled",
        "Each row is one attempt of a robot to find its place for another robot's map: both maps as pictures and as "
        "classes, every transform that was considered, the evidence for and against, what was decided, what "
        "verification measured from then on, what became of it, and whether it was right. Made with "
        f"mapgraft {', '.join(sorted(tally.software)) or '(version unknown)'}.",
        f"{_BEGIN}\n\n{_own_words(earlier)}\n\n{_END}",
        _splits(tally, sum(left_out.values())),
        _labels(tally),
        _contents(tally),
        _columns(),
        _reading(),
        _limits(tally),
    ]
    return "\n\n".join(sections) + "\n"


def _header(tally: Tally, licence: str | None) -> str:
    """The YAML that Hugging Face reads: which files are which split."""
    total = sum(tally.rows.values())
    size = next((name for least, name in _SIZES if total < least), "1M<n<10M")
    files = [line for split in SPLITS if tally.rows[split] for line in _files(split)]
    lines = [
        "---",
        *([f"license: {json.dumps(licence)}"] if licence else []),
        "pretty_name: Labelled merges of robots' maps",
        "tags: [robotics, slam, map-merging, mapgraft]",
        f"size_categories: [{size}]",
        *(["configs:", "- config_name: default", "  data_files:", *files] if files else []),
        "---",
    ]
    return "\n".join(lines)


def _files(split: str) -> list[str]:
    return [f"  - split: {split}", f"    path: examples/split={split}/*.parquet"]


def _own_words(earlier: str) -> str:
    found = re.search(f"{re.escape(_BEGIN)}(.*?){re.escape(_END)}", earlier, flags=re.DOTALL)
    return (found[1].strip() if found else "") or _NOBODY


def _splits(tally: Tally, left_out: int) -> str:
    words = ("right", "wrong", "unsure", "nobody knows")
    lines = [
        "## Splits",
        "",
        "A building is in one split only, whatever its recordings: what is learned on some buildings is tested on "
        "others. Its name decides (70, 15 and 15 of a hundred, by a hash), unless whoever published it said otherwise; "
        "it stays where it is when others come. Two maps of two buildings are an example (`a+b`) where both are in one "
        "split.",
        "",
        f"| split | examples | {' | '.join(words)} | buildings |",
        "|---|---|---|---|---|---|---|",
    ]
    for split in SPLITS:
        counted = tally.buildings.get(split, Counter())
        buildings = ", ".join(f"{_said(name)} ({count})" for name, count in sorted(counted.items()) if "+" not in name)
        pairs = sum(count for name, count in counted.items() if "+" in name)
        buildings += f"; of two buildings {pairs}" if pairs else ""
        numbers = " | ".join(str(tally.labels[split, word]) for word in words)
        lines.append(f"| {split} | {tally.rows[split]} | {numbers} | {buildings or '–'} |")
    lines += ["", f"{left_out} examples of two buildings in different splits were left out."]
    return "\n".join(lines)


def _labels(tally: Tally) -> str:
    came = [(name, tally.came[name]) for name in ("recorded poses", "given", "persons", "nobody knows")]
    meaning = {
        "recorded poses": "the recordings' own poses, which whoever recorded them trusts, tell how the two maps lie",
        "given": "somebody gave the true transform, as a person who put the maps in place",
        "persons": "what more of the persons say who looked at it",
        "nobody knows": "no label",
    }
    lines = [
        "## How the labels came about",
        "",
        f"`label` is the truth where it is known, else what persons say. By the truth a transform is right when the "
        f"donor's walls lie within {RIGHT_M:g} m (mean) and {RIGHT_DEG:g}° of where they belong, and wrong when they "
        "do not, or the two maps do not belong together.",
        "",
        "| by | examples | |",
        "|---|---|---|",
        *(f"| {name} | {count} | {meaning[name]} |" for name, count in came),
        "",
        f"{len(tally.persons)} persons have judged, {tally.words} words in all (column `labels`), by the names that "
        "they gave. `mapgraft annotate` shows both maps, and neither score nor verdict before an answer.",
    ]
    return "\n".join(lines)


def _contents(tally: Tally) -> str:
    return "\n".join(
        [
            "## What is in it",
            "",
            *_counted("what became of the attempt", tally.became),
            "",
            *_counted("map types, receiver ← donor", tally.types),
        ]
    )


def _counted(title: str, counter: Mapping[str, int]) -> Iterable[str]:
    yield f"| {title} | examples |"
    yield "|---|---|"
    for name, count in sorted(counter.items(), key=lambda item: (-item[1], item[0])):
        yield f"| {_said(name)} | {count} |"


def _columns() -> str:
    lines = [
        "## Columns",
        "",
        "`T_a_b` takes points of b's frame to a's (`p_a = T_a_b · p_b`, 4 × 4, row-major); metres, radians, data time.",
        "",
        "| column | type | unit | meaning |",
        "|---|---|---|---|",
        *(_column(column) for column in table("dataset").columns),
    ]
    return "\n".join(lines)


def _column(column: Column) -> str:
    doc = column.doc + (f"; {column.convention}" if column.convention else "")
    return f"| `{column.name}` | `{column.type}` | {column.unit or '–'} | {doc} |"


def _reading() -> str:
    return """## Reading it

```python
import datasets  # pictures come as PIL images

train = datasets.load_dataset("DATASET", split="train")
```

```python
import polars

rows = polars.read_parquet("DATASET/examples/**/*.parquet", hive_partitioning=True)
```

```sql
SELECT split, environment, label, count(*)
FROM read_parquet('DATASET/examples/**/*.parquet', hive_partitioning = true)
GROUP BY ALL ORDER BY ALL;
```

A picture's palette holds what it says: `numpy.asarray(image)` of an image as it comes is 0 (unknown), 1 (free), 2 and
above (walls), the top row at the greatest y. `numpy.reshape(row["classes_own"], (row["window_px_h"],
row["window_px_w"]))` has the least y first."""


def _limits(tally: Tally) -> str:
    lines: Sequence[str] = (
        "## Limits",
        "",
        f"* Pictures are at most {pictures.LARGEST_PX} pixels wide and high, windows {window.LARGEST_PX}: of large "
        "maps they show less than was matched. Evidence was measured on the maps themselves.",
        f"* Of a merge that was looked at more than {2 * looks.MOST} times `history` has every second look, or fewer; "
        "those that turned the verdict are all there.",
        "* Pairs that the decision table turned away have no hypothesis, and no picture of the donor's map, which was "
        "never sent. Of a pair that was turned away again and again there is one example.",
        "* A pair that is tried again, and the same two robots the other way round, are examples of their own: they "
        "are not independent of each other.",
        "* Recorded poses are taken for true. Where they drift, so do the labels.",
        f"* {len(tally.environments)} buildings: what was learned here need not hold in others.",
    )
    return "\n".join(lines)


def _said(text: str) -> str:
    """A name from a recording as text of a page: nothing in it is markup."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return re.sub(r"([\\`*_{}\[\]<>()#+!|&~-])", r"\\\1", plain) if re.search(r"[^\w .←,-]", plain) else plain
