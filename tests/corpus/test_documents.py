"""What a corpus is: the missions and configurations of a document or a folder, and the jobs they make."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.corpus.document import read_plan
from mapgraft.corpus.places import local, stand_in, whole
from mapgraft.corpus.plan import Mission, Setting, jobs_of, laid_over, named
from mapgraft.corpus.recordings import recordings_in
from mapgraft.errors import ConfigError, DecisionTableError, RecordingError, UsageError

MAPPINGS: st.SearchStrategy[Any] = st.recursive(
    st.dictionaries(st.sampled_from("abc"), st.integers(), max_size=3),
    lambda inner: st.dictionaries(st.sampled_from("abc"), inner | st.integers(), max_size=3),
)


def touched(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    return folder


def written(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_a_folder_is_a_mission_per_recording(tmp_path: Path) -> None:
    bag = ("bag/metadata.yaml", "bag/bag_0.mcap", "bag/bag_1.mcap")
    more = ("b.mcap", "deep/a.BAG", "deep/c.log.gz", ".hidden/x.mcap", "out/b.merge.mcap", "notes.txt", "map.yaml")
    folder = touched(tmp_path, *bag, *more)
    assert recordings_in(str(folder)) == [
        str(folder / name) for name in ("b.mcap", "bag", "deep/a.BAG", "deep/c.log.gz")
    ]
    assert recordings_in(str(folder), [".txt"])[-1] == str(folder / "notes.txt")
    jobs = read_plan(str(folder))
    assert [job.mission for job in jobs] == ["b", "bag", "a", "c"]
    assert {job.config for job in jobs} == {"default"}


def test_a_document_gives_missions_times_configurations(tmp_path: Path) -> None:
    touched(tmp_path, "a.mcap", "b.mcap", "many/1.mcap", "many/2.mcap", "poses.tum")
    written(tmp_path / "fine.toml", "[map]\nresolution_m = 0.02\n")
    text = """
missions:
  - {name: office, files: [a.mcap, b.mcap], config: {robots: {r: {files: [a.mcap], poses: {file: poses.tum}}}}}
  - {each: many}
  - {files: ["many/*.mcap"]}
  - {files: [s3://bucket/far.mcap]}
configs:
  fine: fine.toml
  two: {reversal: multi_map}
"""
    jobs = read_plan(written(tmp_path / "corpus.yaml", text))
    missions = [job.mission for job in jobs[::2]]
    assert missions[0] == "office" and missions[2:] == ["2", missions[3], "far"]
    assert [(job.mission, job.config) for job in jobs] == [(m, c) for m in missions for c in ("fine", "two")]
    assert jobs[0].files == (str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap"))
    assert jobs[0].content == {
        "map": {"resolution_m": 0.02},
        "robots": {"r": {"files": [str(tmp_path / "a.mcap")], "poses": {"file": str(tmp_path / "poses.tum")}}},
    }
    assert jobs[1].content["reversal"] == "multi_map" and "map" not in jobs[1].content
    assert len(jobs[6].files) == 2
    assert jobs[8].files == ("s3://bucket/far.mcap",)
    assert len({job.mission for job in jobs}) == 5 and len({job.id for job in jobs}) == 10
    assert pickle.loads(pickle.dumps(jobs)) == jobs


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("missions: []", "missions: .*at least 1"),
        ("missions: [{name: x}]\nmore: 1", r"has 2 faults(.|\n)*more: there is no such key"),
        ("missions: [{files: [a.mcap], each: [b]}]", "either files, or each"),
        ("missions: [{each: [a.mcap], name: x}]", "name is for the one mission of files"),
        ("missions: [{files: [a.mcap], name: x}, {files: [b.mcap], name: x}]", "two missions are called x"),
        ("missions: [{files: [a.mcap]}]\nconfigs: {c: {mapp: {}}}", r"configuration c of the mission a(.|\n)*mapp"),
        ("missions: [{files: [no*.mcap]}]", "matches nothing"),
        ("missions: [{each: empty}]", "holds no recording"),
        ("missions: [{each: em*}]", "holds no recording"),
        ("missions: [{files: [a.mcap]}]\njob_time_limit_s: 0", "job_time_limit_s: .*greater than 0"),
        ("missions: [{files: [a.mcap]}]\njob_time_limit_s: .inf", "job_time_limit_s: .*finite"),
        ("missions: [{files: [a.mcap]}]\nconfigs: {c: {rules: [{name: x, mach: no}]}}", "mission a: .*\n.*rule 1"),
    ],
)
def test_what_is_wrong_with_a_document_is_told_before_anything_is_run(tmp_path: Path, text: str, said: str) -> None:
    touched(tmp_path, "a.mcap", "b.mcap", "empty/readme.txt")
    with pytest.raises((ConfigError, DecisionTableError, RecordingError), match=said):
        read_plan(written(tmp_path / "corpus.yaml", text))


def test_everything_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    touched(tmp_path, *(f"{name}.mcap" for name in "abcdef"))
    written(tmp_path / "rules.yaml", "[{name: never, mach: no}]")
    text = """
missions:
  - {each: ["[a-e].mcap"]}
  - {files: [f.mcap, no*.mcap, none*.mcap], config: {mapp: {}}}
  - {name: twice, files: [f.mcap], config: {rules: rules.yaml, priors: 3}}
  - {name: twice, files: [f.mcap], config: gone.yaml}
configs:
  one: {reversal: nonsense}
  two: {reversal: nonsense}
  three: {consistency: {margin: -3}}
  four: lost.yaml
"""
    with pytest.raises(ConfigError) as told:
        read_plan(written(tmp_path / "corpus.yaml", text))
    said = str(told.value)
    for fault in (
        f"there is no file {tmp_path / 'lost.yaml'}",
        f"{tmp_path / 'no*.mcap'} matches nothing",
        f"{tmp_path / 'none*.mcap'} matches nothing",
        f"there is no file {tmp_path / 'gone.yaml'}",
        "two missions are called twice",
        "the configurations one, two of the missions a.mcap, b.mcap, c.mcap and 5 more: reversal: ",
        "the configuration three of the missions a.mcap, b.mcap, c.mcap and 5 more: consistency.margin: ",
        "the configurations one, two, three and 1 more of the mission f.mcap: mapp: ",
        "the configurations one, two, three and 1 more of the mission twice: priors: ",
        f"of the mission twice: the decision table {tmp_path / 'rules.yaml'} has 1 fault(s):\n  rule 1 (never)",
    ):
        assert said.count(fault) == 1, fault
    assert said.count("\n") == 10


def test_a_pattern_is_looked_for_wherever_it_stands(tmp_path: Path) -> None:
    folder = touched(
        tmp_path / "run [1]",
        *("m1/lidar.mcap", "m1/camera.mcap", "m2/lidar.mcap", "m2/deep/x.bag", "empty/notes.txt", "odd[1].mcap"),
        *("bags/one/metadata.yaml", "bags/one/one_0.db3", "bags/one/one_1.db3"),
    )
    written(folder / "bags/one/metadata.yaml", "rosbag2_bagfile_information: {}")

    def files(entry: str) -> list[tuple[str, ...]]:
        plan = read_plan(written(folder / "corpus.yaml", f"missions: [{{{entry}}}]"))
        return [tuple(str(Path(file).relative_to(folder)) for file in job.files) for job in plan]

    both = ("m1/lidar.mcap", "m2/lidar.mcap")
    assert files('each: "*/lidar.mcap"') == [(file,) for file in both]
    assert files('files: ["*/lidar.mcap"]') == [both]
    assert files(f'each: "{folder.parent}/run ?1?/m*/lidar.mcap"') == [(file,) for file in both]
    assert files('each: "m?"') == [("m1/camera.mcap",), ("m1/lidar.mcap",), ("m2/deep/x.bag",), ("m2/lidar.mcap",)]
    assert files('each: ["bags/*", bags/one, bags]') == [("bags/one",)]
    assert files('files: ["odd[1].mcap"]') == files('each: "odd[1].mcap"') == [("odd[1].mcap",)]
    assert [job.files for job in read_plan(str(folder / "m1"))] == [
        (str(folder / f"m1/{n}.mcap"),) for n in ("camera", "lidar")
    ]
    written(folder / "metadata.yaml", "of: another kind")
    assert len(read_plan(str(folder))) == 6


def test_paths_are_relative_to_the_file_they_stand_in(tmp_path: Path) -> None:
    touched(tmp_path, "a.mcap", "said/labels.csv", "said/poses.tum")
    config = "examples: {truth: labels.csv}\nrobots: {r: {poses: {file: poses.tum}}}"
    written(tmp_path / "said" / "labels.yaml", config)
    text = "missions: [{files: [a.mcap], config: {examples: {truth: here.csv}}}]\nconfigs: {said: said/labels.yaml}"
    (job,) = read_plan(written(tmp_path / "corpus.yaml", text))
    assert job.content["examples"] == {"truth": str(tmp_path / "here.csv")}
    assert job.content["robots"]["r"]["poses"] == {"file": str(tmp_path / "said" / "poses.tum")}
    (job,) = read_plan(str(tmp_path), [str(tmp_path / "said" / "labels.yaml")])
    assert job.content["examples"] == {"truth": str(tmp_path / "said" / "labels.csv")}


def test_a_time_limit_is_every_jobs_and_makes_it_no_other(tmp_path: Path) -> None:
    touched(tmp_path, "a.mcap", "b.mcap")
    text = "missions: [{each: [a.mcap, b.mcap]}]"
    free = read_plan(written(tmp_path / "corpus.yaml", text))
    limited = read_plan(written(tmp_path / "corpus.yaml", f"{text}\njob_time_limit_s: 90"))
    assert [job.time_limit_s for job in free] == [None, None]
    assert [job.time_limit_s for job in limited] == [90.0, 90.0]
    assert [job.id for job in free] == [job.id for job in limited]


def test_configurations_are_given_in_one_place_and_have_names_of_their_own(tmp_path: Path) -> None:
    touched(tmp_path, "a.mcap")
    one, other = written(tmp_path / "c.yaml", "{}"), written(tmp_path / "c.toml", "")
    document = written(tmp_path / "corpus.yaml", "missions: [{files: [a.mcap]}]\nconfigs: {d: c.yaml}")
    with pytest.raises(ConfigError, match="has configs of its own"):
        read_plan(document, [one])
    with pytest.raises(ConfigError, match="two configurations are called c"):
        read_plan(str(tmp_path), [one, other])
    with pytest.raises(ConfigError, match="neither a folder of recordings nor a document"):
        read_plan(str(tmp_path / "a.mcap"))


def test_a_decision_table_travels_with_its_job(tmp_path: Path) -> None:
    touched(tmp_path, "a.mcap")
    rules = tmp_path / "rules.yaml"
    rules.write_text("- {name: never, when: {own.type: none}, mach: no}\n")
    config = written(tmp_path / "c.yaml", "rules: rules.yaml")
    with pytest.raises(DecisionTableError, match="rule 1"):
        read_plan(str(tmp_path), [config])
    rules.write_text("[]\n")
    (job,) = read_plan(str(tmp_path), [config])
    assert job.rules_text == "[]\n" and job.content == {}


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(MAPPINGS, MAPPINGS)
def test_what_is_laid_over_counts_and_everything_else_stays(under: Any, over: Any) -> None:
    both = laid_over(under, over)
    assert laid_over(both, over) == both and laid_over(under, {}) == under == laid_over({}, under)
    for key in under.keys() | over.keys():
        if key not in over:
            assert both[key] == under[key]
        elif isinstance(over[key], Mapping) and isinstance(under.get(key), Mapping):
            assert both[key] == laid_over(under[key], over[key])
        else:
            assert both[key] == over[key]


def test_equal_jobs_come_once_and_names_do_not_clash() -> None:
    missions = [Mission("", ("/x/a.mcap",), {}), Mission("a", ("/y/b.mcap",), {}), Mission("", ("/z/a.mcap",), {})]
    assert [mission.name for mission in named(missions)] == ["x_a", "a", "z_a"]
    alone = named([missions[0], missions[1]])
    assert [mission.name for mission in alone] == ["a_2", "a"]
    assert len(jobs_of([missions[1], missions[1]], [Setting("one", {}), Setting("same", {})])) == 1


def test_places_mean_the_same_from_everywhere(tmp_path: Path) -> None:
    assert whole("x/../y", str(tmp_path)) == f"{tmp_path}/x/../y"
    assert whole("y.mcap", "s3://bucket/folder") == "s3://bucket/folder/y.mcap"
    assert whole(f"file://{tmp_path}/a") == f"{tmp_path}/a" == whole(f"{tmp_path}/a", "/elsewhere")
    assert whole("gs://b/a", "/elsewhere") == "gs://b/a" == whole("gs://b/a/")
    assert whole("gs://") == "gs://" and whole(f"{tmp_path}/a/") == f"{tmp_path}/a"
    with pytest.raises(UsageError, match="names another machine"):
        local("file://other/a")
    assert stand_in(Path("/root"), "s3://b/../../etc/passwd") == Path("/root/s3/b/etc/passwd")
