"""Which recordings are taken when none is named."""

from __future__ import annotations

from mapgraft.experiments.andersone2021.recordings import DATA, chosen
from mapgraft_recordings import demo_files


def test_the_demo_where_there_is_no_intel_log(tmp_path):
    files, why = chosen(tmp_path, {})
    assert files == list(demo_files()[0])
    assert "the Intel log is not here" in why and DATA in why and "http://" in why


def test_the_log_in_the_folder_goes_before_one_below_the_data_folder(tmp_path):
    here, kept = tmp_path / "here", tmp_path / "kept"
    for path in (here / "data" / "intel.clf", kept / "deep" / "carmen" / "intel-raw.log.gz"):
        path.parent.mkdir(parents=True)
        path.touch()
    (kept / "intel.log.gz").mkdir()  # a folder is no log
    assert chosen(here, {DATA: str(kept)}).files == [here / "data" / "intel.clf"]
    assert chosen(kept / "deep", {DATA: str(kept)}).files == [kept / "deep" / "carmen" / "intel-raw.log.gz"]
    corrected = kept / "deep" / "intel-corrected.log"
    corrected.touch()
    found = chosen(here, {DATA: str(kept)})
    assert found.files == [corrected] and corrected.name in found.why
