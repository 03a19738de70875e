"""The command line as a person uses it: results on stdout, sentences on stderr, exit codes, no traceback."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import mapgraft
from mapgraft.cli import invoke
from mapgraft_recordings import demo_files


@pytest.fixture(scope="module")
def demo_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one run of the demo, made by the command line."""
    out = tmp_path_factory.mktemp("demo") / "out"
    assert invoke(["run", "-q", "-o", str(out)]) == 0
    return out


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = invoke(list(arguments))
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return code, out, err


def wrong(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """The exit code and the sentence of something that cannot work; nothing on stdout."""
    code, out, err = said(capsys, *arguments)
    assert out == ""
    assert err.startswith("mapgraft: ")
    return code, err


def test_help_and_version(capsys):
    code, out, _ = said(capsys, "--help")
    assert code == 0
    for command in ("info", "run", "revert", "confirm", "forbid", "convert", "decide", "plugins"):
        assert command in out
    assert said(capsys, "--version")[1].startswith("mapgraft 0.")


def test_help_of_run_tells_what_is_written_unasked(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    help_ = said(capsys, "run", "--help")[1]
    assert "else what output.report says: yes" in help_
    assert "else what output.examples says: yes" in help_


def test_help_imports_nothing_heavy():
    code = "import sys; from mapgraft.cli import invoke; invoke(['--help']); print(sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    for heavy in ("numpy", "numba", "scipy", "pyarrow", "rosbags", "cv2", "pydantic", "matplotlib"):
        assert f"'{heavy}'" not in loaded, heavy


def test_run_tells_the_demos_story(demo_out, capsys):
    code, out, _ = said(capsys, "run", "-q", "-o", str(demo_out))
    assert code == 0
    assert "reverted at" in out
    assert "confirmed at" in out
    assert "merges standing" in out


def test_plugins_that_failed_are_told_of_at_the_end(tmp_path, monkeypatch, capsys):
    def broken(*_):
        raise IndexError("boom")

    monkeypatch.setattr("mapgraft_grid.correlation.Correlation.match", broken)
    code, out, _ = said(capsys, "run", "-q", "--end", "40", "--no-report", "-o", str(tmp_path / "out"))
    told = " ".join(out.split())
    assert code == 0
    assert "the matcher 'correlation' failed: IndexError: boom (3 times, the first at 30.0 s, alpha ← bravo)" in told
    assert "the matcher 'correlation' failed 3 times (limits.failures) and is not asked again" in told
    remarks = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["remarks"]
    assert any("IndexError: boom (3 times" in sentence for sentence in remarks)


def test_run_as_json(tmp_path, capsys):
    code, out, _ = said(capsys, "run", "--json", "-o", str(tmp_path / "out"), "--end", "60")
    document = json.loads(out)
    assert code == 0
    assert set(document["robots"]) == {"alpha", "bravo", "charlie"}
    assert {merge["state"] for merge in document["merges"]} <= {"provisional", "confirmed", "reverted"}


def test_a_persons_verdict_is_replayed_and_kept(demo_out, tmp_path, capsys):
    import shutil

    out = tmp_path / "out"
    shutil.copytree(demo_out, out)
    before = json.loads((out / "summary.json").read_text())
    merge = next(m for m in before["merges"] if m["state"] == "confirmed")
    code, text, _ = said(capsys, "revert", str(out), merge["merge_id"], "--by", "ann", "--reason", "no", "--json")
    after = json.loads(text)
    assert code == 0
    assert merge["merge_id"] not in after["standing"]
    reverted = next(m for m in after["merges"] if m["merge_id"] == merge["merge_id"])
    assert reverted["reason"] == "a person said revert: no"
    code, text, _ = said(capsys, "forbid", str(out), merge["merge_id"], "--json")
    pair = {merge["receiver"], merge["donor"]}
    assert all({m["receiver"], m["donor"]} != pair for m in json.loads(text)["merges"])
    code, text, _ = said(capsys, "confirm", str(out), json.loads(text)["standing"][0], "--json")
    assert code == 0


def test_verdicts_become_labels_and_two_on_one_pair_both_hold(demo_out, tmp_path, capsys):
    import shutil

    import pyarrow.dataset as ds

    out = tmp_path / "out"
    shutil.copytree(demo_out, out)
    for merge_id in ("alpha.bravo.2", "alpha.bravo.1"):
        assert said(capsys, "revert", str(out), merge_id, "--by", "ann", "--json")[0] == 0
    standing = json.loads((out / "summary.json").read_text())["merges"]
    assert not [m for m in standing if m["merge_id"].startswith("alpha.bravo.") and m["state"] != "reverted"]
    labels = ds.dataset(out / "labels", partitioning="hive").to_table().to_pylist()
    assert {row["merge_id"] for row in labels} == {"alpha.bravo.1", "alpha.bravo.2"}


def test_a_verdict_on_a_run_whose_recording_has_changed_is_refused(tmp_path, capsys):
    import shutil

    paths = [Path(shutil.copy(path, tmp_path)) for path in demo_files()[0][:2]]
    out = tmp_path / "out"
    assert said(capsys, "run", "-q", *map(str, paths), "-o", str(out), "--end", "60")[0] == 0
    before = (out / "summary.json").read_bytes()
    shutil.copy(paths[1], paths[0])
    merge = json.loads(before)["merges"][0]["merge_id"]
    code, text = wrong(capsys, "revert", str(out), merge)
    assert code == 2
    assert "have changed since" in text
    assert (out / "summary.json").read_bytes() == before


def test_verdicts_on_what_is_not_there(demo_out, tmp_path, capsys):
    assert wrong(capsys, "revert", str(tmp_path), "a.b.1") == (
        2, f"mapgraft: {tmp_path} is not the folder of a finished run: it has no readable mission.json\n"
    )  # fmt: skip
    (tmp_path / "mission.json.partial").touch()
    code, err = wrong(capsys, "revert", str(tmp_path), "a.b.1")
    assert code == 2
    assert "is not finished (mission.json.partial is there): wait for it, or run it again" in err
    code, text = wrong(capsys, "revert", str(demo_out), "a.b.1")
    assert code == 2
    assert "has no merge 'a.b.1': it made alpha." in text


def test_what_a_run_wrote_is_no_recording(demo_out, tmp_path, capsys):
    import shutil

    see = f"is what mapgraft run wrote: see {demo_out}/report.html, or give the recordings that it was made from"
    for path in (demo_out, demo_out / "alpha.merge.mcap"):
        for command in (["info"], ["run", "-o", str(tmp_path / "out")]):
            assert wrong(capsys, *command, str(path), str(demo_files()[0][0])) == (1, f"mapgraft: {path} {see}\n")
    renamed = Path(shutil.copy(demo_out / "alpha.merge.mcap", tmp_path / "renamed.mcap"))
    assert (
        "renamed.mcap is what mapgraft run wrote: 'mapgraft report' shows it" in wrong(capsys, "info", str(renamed))[1]
    )
    assert not (tmp_path / "out").exists()


def test_a_start_beyond_the_recording_is_told_with_its_length_and_touches_nothing(tmp_path, capsys):
    alpha, out = str(demo_files()[0][0]), tmp_path / "out"
    code, text = wrong(capsys, "run", alpha, "--start", "500", "-o", str(out))
    assert code == 1
    assert "outside the start and end asked for (500 s to the end): the recording lasts 239.0 s" in text
    assert not out.exists()


def test_a_map_file_that_is_probably_not_meant_so_is_told_by_run(tmp_path, capsys):
    (tmp_path / "plan.pgm").write_bytes(b"P5\n40 40\n255\n" + bytes([205, 0, 254, 254]) * 400)
    (tmp_path / "plan.yaml").write_text(
        "{image: plan.pgm, resolution: 0.05, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.25}"
    )
    files = (str(demo_files()[0][0]), str(tmp_path / "plan.yaml"))
    code, out, _ = said(capsys, "run", "-q", *files, "--end", "3", "-o", str(tmp_path / "out"), "--json")
    assert code == 0
    assert any(remark.startswith("plan: ") and "unknown_gray: 205" in remark for remark in json.loads(out)["remarks"])
    _, out, _ = said(capsys, "run", "-q", *files, "--end", "3", "-o", str(tmp_path / "out"))
    assert "unknown_gray: 205" in " ".join(out.split())


def test_a_bare_image_is_told_what_run_and_info_take(tmp_path, capsys):
    (tmp_path / "hall.pgm").write_bytes(b"P5\n40 40\n255\n" + bytes([205, 0, 254, 254]) * 400)
    config = tmp_path / "c.yaml"
    for command in (["info"], ["run", "-o", str(tmp_path / "out")]):
        code, text = wrong(capsys, *command, str(tmp_path / "hall.pgm"))
        assert code == 2
        assert "--resolution" not in text
        config.write_text(text[text.index("robots: ") :])
        assert said(capsys, *command, str(tmp_path / "hall.pgm"), "-c", str(config))[0] == 0


def test_one_path_is_a_recording_for_python_too():
    one = demo_files()[0][0]
    config = {"mission": {"end_s": 3}}
    assert mapgraft.run(str(one), config).run_id == mapgraft.run([one], config).run_id


def test_info(capsys):
    code, out, _ = said(capsys, "info", *map(str, demo_files()[0]))
    assert code == 0
    for part in ("robot alpha", "/charlie/scan", "SLAM", "mission of 3 robots"):
        assert part in out
    assert json.loads(said(capsys, "info", "--json")[1])["robots"][0]["source"]["name"] == "alpha"


def test_decide(capsys):
    grids = ["--own", "type=occupancy_grid", "--own", "known_area_m2=50", "--own", "resolution_m=0.05"]
    others = ["--other", "type=occupancy_grid", "--other", "known_area_m2=50", "--other", "resolution_m=0.1"]
    code, out, _ = said(capsys, "decide", *grids, *others)
    assert code == 0
    assert "✓ grids of any resolution: applies" in out
    answer = json.loads(said(capsys, "decide", "--json", "--own", "type=a", "--other", "type=b")[1])[0]
    assert answer["rejected"]
    assert answer["reason"].startswith("no rule takes a map of type b into one of type a, ")


def test_plugins(capsys):
    listed = json.loads(said(capsys, "plugins", "list", "--json")[1])
    assert {"carpin", "known_pose", "log_odds", "similarity", "distance", "occupancy_grid", "every", "at"} <= {
        offered["name"] for offered in listed["offered"]
    }
    assert listed["broken"] == []
    assert "resolution_m = 0.05" in said(capsys, "plugins", "show", "occupancy_grid")[1]
    assert wrong(capsys, "plugins", "show", "nothing")[0] == 1


def test_paragraphs_of_a_plugin_fill_the_lines(capsys):
    paragraphs = said(capsys, "plugins", "show", "carpin")[1].split("\n\n")[1:]
    full = [line for paragraph in paragraphs for line in paragraph.splitlines()[:-1]]
    assert len(full) > 5
    assert all(len(line) > 60 for line in full), full


def test_convert(tmp_path, capsys):
    log = tmp_path / "a.log"
    log.write_text("".join(f"FLASER 3 1 2 1 {n} 0 0 {n} 0 0 {n} h {n}\n" for n in range(5)))
    code, out, _ = said(capsys, "convert", str(log), str(tmp_path / "a.mcap"))
    assert code == 0
    assert "/scan (sensor_msgs/msg/LaserScan): 5" in out
    assert "robot a" in said(capsys, "info", str(tmp_path / "a.mcap"))[1]


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["frobnicate"], 2, "No such command 'frobnicate'"),
        (["frob"], 2, "No such command 'frob'. Did you mean 'forbid'? 'mapgraft --help' shows what there is"),
        (["run", "--zzz"], 2, "No such option: --zzz; 'mapgraft run --help' shows what there is"),
        (["run", "--ot", "x"], 2, "No such option: --ot. Did you mean '--out'? 'mapgraft run --help' shows"),
        (["info", "--config"], 2, "'--config' requires an argument; 'mapgraft info --help' shows"),
        (["plugins", "show", "--jsn"], 2, "Did you mean '--json'? 'mapgraft plugins show --help' shows"),
        (["run", "--every", "x"], 2, "--every"),
        (["run", "/there/is/no.mcap"], 1, "/there/is/no.mcap does not exist"),
        (["run", str(demo_files()[0][0]), str(demo_files()[0][0])], 1, "is given 2 times: name every file once"),
        (["run", "-c", "/there/is/no.yaml"], 2, "there is no file /there/is/no.yaml"),
        (["run", "--prior", "alpha,bravo=1,2"], 2, "--prior wants RECEIVER,DONOR=X,Y,YAW"),
        (["run", "--prior", "alpha,zulu=1,2,3"], 2, "there is no robot zulu: the recording has alpha, bravo, charlie"),
        (["run", "--forbid", "alpha"], 2, "--forbid wants two robots"),
        (["run", "--reversal", "undo"], 2, "reversal: Input should be 'ledger', 'single_map' or 'multi_map'"),
        (["run", "--start", "50", "--end", "10"], 2, "end_s must lie after start_s"),
        (["run", "--start", "-5"], 2, "mission.start_s"),
        (["run", "--prior", "alpha,bravo=1,2,400"], 2, "priors.0.yaw_rad"),
        (["run", "--demo", "lunar"], 2, "there is no demo 'lunar': choose one of grids, heterogeneous"),
        (["run", "--demo", "grids", "a.mcap"], 2, "--demo grids replays its own files, found a.mcap beside it"),
        (["run", "--no-plugin", "nosuch"], 1, "there is no plugin nosuch to leave out: installed are"),
        (["decide"], 2, "name recordings, or describe two maps"),
        (["decide", "--own", "x=1", "--other", "type=b"], 2, "--own needs the map's type"),
    ],
)
def test_what_cannot_work_is_one_sentence(tmp_path, capsys, arguments, code, sentence):
    more = ["-o", str(tmp_path / "out")] if arguments[0] == "run" else []
    found, text = wrong(capsys, *arguments, *more)
    assert found == code
    assert sentence in text
    assert not (tmp_path / "out").exists()


def test_config_faults_all_at_once(tmp_path, capsys):
    config = tmp_path / "c.yaml"
    config.write_text("misson: {}\nreversal: lodger\nrobots: {alpha: {map: {resolution_m: 0}}}\n")
    code, text = wrong(capsys, "run", "-c", str(config), "-o", str(tmp_path / "out"))
    assert code == 2
    assert "2 faults" in text
    config.write_text("robots: {alpha: {map: {resolution_m: 0}}}\n")
    code, text = wrong(capsys, "run", "-c", str(config), "-o", str(tmp_path / "out"))
    assert code == 2
    assert "robots.alpha.map: " in text
    config.write_text("exchange: {us: every, seconds: 3}\n")
    text = wrong(capsys, "info", "-c", str(config))[1]
    assert "exchange.use: Field required, found 'us': check the spelling" in text  # other keys may be parameters
    config.write_text("robots: {alpha: {map: {type: cubes}}}\n")
    assert (
        "there is no map type called 'cubes'" in wrong(capsys, "run", "-c", str(config), "-o", str(tmp_path / "out"))[1]
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("exchange: {use: whenever}", "exchange: there is no policy called 'whenever': did you mean 'every'"),
        ("exchange: {use: every, secnds: 3}", "exchange: the policy 'every' has no parameter 'secnds'"),
        ("map: {type: octree}", "map: there is no map type called 'octree'"),
        ("rules: there_is_no.yaml", "there_is_no.yaml"),
        (
            "rules: [{name: r, match: {use: carpin, hypothesis: 3}, fuse: {use: log_odds, qualty: none},"
            " accept: {use: thresholds}, verify: {use: thresholds, metrics: [similarity]}}]",
            "rule 'r': the matcher 'carpin' has no parameter 'hypothesis'",
        ),
    ],
)
def test_info_refuses_what_run_would_refuse(tmp_path, capsys, text, sentence):
    config = tmp_path / "c.yaml"
    config.write_text(text)
    for command in (["info"], ["run", "-o", str(tmp_path / "out")]):
        code, said_ = wrong(capsys, *command, "-c", str(config), *map(str, demo_files()[0]))
        assert code == 2
        assert sentence in said_
    if "qualty" in text:
        assert "the fuser 'log_odds' has no parameter 'qualty'" in said_  # all faults of all rules at once


def test_an_output_folder_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    code, text = wrong(capsys, "run", "-q", "-o", str(tmp_path / "file"))
    assert code == 1
    assert text.count("\n") == 1


def test_names_from_a_recording_cannot_steer_the_terminal(tmp_path, capsys):
    path = tmp_path / "x\x1b[31mred.mcap"
    path.write_bytes(b"nothing")
    code, text = wrong(capsys, "run", str(path), "-o", str(tmp_path / "out"))
    assert code == 1
    assert "\x1b" not in text
    assert "\\x1b" in text


@pytest.mark.parametrize(
    ("number", "said"),
    [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "ended by SIGTERM"), (signal.SIGHUP, "ended by SIGHUP")],
)
def test_whoever_ends_a_run_is_told_so_and_what_was_decided_stays(tmp_path, number, said):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "mapgraft", "run", "-q", "-o", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    deadline = time.monotonic() + 60
    while not (out / "mission.json.partial").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(number)
    if number != signal.SIGINT:
        process.send_signal(number)  # saying it twice makes it no faster
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert err == f"mapgraft: {said}; what was decided before, if anything, is on disk\n"
    assert not list(out.glob("*.merge.mcap"))
    (partial,) = out.glob("*.merge.mcap.partial")
    assert partial.read_bytes().endswith(b"\x89MCAP0\r\n"), "it was closed"
