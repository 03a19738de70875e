"""Others' tools read the examples of a run and a published dataset: Hugging Face, DuckDB, Polars, pandas, PyTorch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import datasets
import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pytest

from mapgraft.examples import ExampleFolder
from mapgraft.examples.publishing import publish


@pytest.fixture(scope="session")
def dataset(toys: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A published dataset of all splits; tests must not change it."""
    folder = tmp_path_factory.mktemp("dataset")
    publish([toys], folder, {"mit": "validation", "fr101": "test", "aces": "train", "intel": "train"})
    return folder


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", tmp_path / "cache")
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True)


def test_hugging_face_reads_the_splits_by_the_card_and_decodes_pictures(dataset, toys, tmp_path):
    loaded = datasets.load_dataset(str(dataset), cache_dir=str(tmp_path))
    assert set(loaded) == {"train", "validation", "test"}
    assert sum(split.num_rows for split in loaded.values()) == 150
    assert isinstance(loaded["train"].features["own_picture"], datasets.Image)
    for split, environments in (("test", {"fr101"}), ("validation", {"mit"})):
        assert environments <= set(loaded[split]["environment"])
        assert not environments & set(loaded["train"]["environment"])
    row = loaded["test"][3]
    assert row["own_picture"].mode == "P" and set(np.unique(np.asarray(row["own_picture"]))) == {0, 1, 2} - {0}
    window = np.reshape(row["classes_own"], (row["window_px_h"], row["window_px_w"]))
    assert set(np.unique(window)) <= {0, 1, 2}
    assert row["label"] in ("right", "wrong") and row["label_by"] == "truth"
    assert {pair["name"] for pair in row["evidence"]} >= {"score", "posterior"}


def test_hugging_face_reads_what_a_run_wrote(ran, tmp_path):
    files = str(ran.out / "examples/**/*.parquet")
    rows = datasets.load_dataset("parquet", data_files=files, split="train", cache_dir=str(tmp_path))
    assert rows.num_rows == len(ran.folder) and rows[0]["donor_picture"].size[0] > 10


def test_duckdb_reads_it(dataset):
    files = f"read_parquet('{dataset}/examples/**/*.parquet', hive_partitioning = true)"
    counts = dict(duckdb.sql(f"SELECT split, count(*) FROM {files} GROUP BY ALL").fetchall())
    assert sum(counts.values()) == 150 and set(counts) == {"train", "validation", "test"}
    posterior = f"SELECT label, avg(list_filter(evidence, lambda e: e.name = 'posterior')[1].value) AS p FROM {files}"
    told = dict(duckdb.sql(f"{posterior} GROUP BY label").fetchall())
    assert told["right"] > 0.6 > 0.4 > told["wrong"]
    pictures = duckdb.sql(f"SELECT octet_length(own_picture.bytes), len(classes_own) FROM {files} LIMIT 1").fetchall()
    assert pictures[0][0] > 50 and pictures[0][1] > 100


def test_polars_reads_it(dataset):
    rows = pl.read_parquet(f"{dataset}/examples/**/*.parquet", hive_partitioning=True)
    assert rows.height == 150 and rows["split"].n_unique() == 3
    assert rows["history"].list.len().max() > 5 and rows["T_receiver_donor"].to_numpy().shape == (150, 16)
    assert rows["own_picture"].struct.field("bytes").bin.starts_with(b"\x89PNG").all()


def test_pandas_reads_it(dataset):
    rows = pd.read_parquet(dataset / "examples")
    assert len(rows) == 150 and set(rows["split"]) == {"train", "validation", "test"}
    assert rows["own_picture"][0]["bytes"].startswith(b"\x89PNG") and rows["classes_own"][0].dtype == np.uint8
    assert set(rows["truth"]) == {"right", "wrong"} and str(rows["stamp"].dtype) == "datetime64[ns, UTC]"


def test_pytorch_trains_on_it(dataset, tmp_path):
    torch = pytest.importorskip("torch")
    rows = datasets.load_dataset(str(dataset), split="train", cache_dir=str(tmp_path))

    def pair(row: dict[str, Any]) -> Any:
        shape = (row["window_px_h"], row["window_px_w"])
        both = [np.reshape(row[name], shape)[:32, :32] for name in ("classes_own", "classes_donor")]
        return torch.from_numpy(np.stack(both)).float(), torch.tensor(float(row["label"] == "right"))

    loader = torch.utils.data.DataLoader(rows.with_format(None), batch_size=8, collate_fn=lambda b: list(map(pair, b)))
    maps, labels = (torch.stack(part) for part in zip(*next(iter(loader)), strict=True))
    assert maps.shape == (8, 2, 32, 32) and set(labels.tolist()) <= {0.0, 1.0}


def test_what_tools_read_is_what_the_folder_tells(dataset, toys):
    published, folder = ExampleFolder(dataset), ExampleFolder(toys)
    assert set(published.keys) == set(folder.keys)
    key = published.keys[17]
    for which in ("own", "donor", "overlay"):
        assert published.picture(key, which) == folder.picture(key, which)
    ours, theirs = folder.row(key), published.row(key)
    assert {name: str(value) for name, value in theirs.items() if name in ours} == {n: str(v) for n, v in ours.items()}
    table = published.rows(["example_id", "split", "environment"])
    assert table.num_rows == 150 and set(table["split"].to_pylist()) == {"train", "validation", "test"}
