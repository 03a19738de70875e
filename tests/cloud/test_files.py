"""PCD and PLY files: read in all their forms, written, broken."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapgraft.contracts import ConfigError, MapError
from mapgraft_cloud.cloud_file import read
from mapgraft_cloud.pcd import Encoding, pcd_bytes
from mapgraft_cloud.ply import ply_bytes

POINTS = np.random.default_rng(3).uniform(-20, 20, (40, 3)).astype(np.float32)
FINITE = st.floats(-1e6, 1e6, width=32)


@settings(max_examples=40, deadline=None)
@given(points=arrays(np.float32, st.tuples(st.integers(1, 20), st.just(3)), elements=FINITE))
@pytest.mark.parametrize("encoding", ["ascii", "binary"])
@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
def test_what_is_written_reads_back_bit_by_bit(
    tmp_path_factory: pytest.TempPathFactory, points: np.ndarray, encoding: Encoding, suffix: str
) -> None:
    path = tmp_path_factory.mktemp("clouds") / f"map{suffix}"
    write = pcd_bytes if suffix == ".pcd" else ply_bytes
    path.write_bytes(write(points, None, encoding))
    cloud = read(path)
    assert np.array_equal(cloud.points_m, points)
    assert cloud.origin_m is None


def lzf_literals(data: bytes) -> bytes:
    """LZF without any copies, and one copy at the end when the last bytes repeat."""
    return b"".join(bytes([len(data[k : k + 32]) - 1]) + data[k : k + 32] for k in range(0, len(data), 32))


def test_compressed_pcd_with_copies(tmp_path: Path) -> None:
    zeros = np.zeros(64, np.float32).tobytes()
    columns = POINTS[:, 0].tobytes() + bytes(160) + POINTS[:, 2].tobytes()
    # 160 zeros: one literal, then copies of what is one byte back, of up to 264 bytes
    packed = lzf_literals(POINTS[:, 0].tobytes()) + b"\x00\x00" + bytes([7 << 5, 159 - 9, 0])
    packed += lzf_literals(POINTS[:, 2].tobytes())
    head = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40\nHEIGHT 1\nPOINTS 40\nDATA binary_compressed\n"
    path = tmp_path / "map.pcd"
    path.write_bytes(head.encode() + struct.pack("<II", len(packed), len(columns)) + packed)
    cloud = read(path)
    assert np.array_equal(cloud.points_m[:, [0, 2]], POINTS[:, [0, 2]])
    assert not cloud.points_m[:, 1].any()
    assert len(zeros) == 256
    path.write_bytes(head.encode() + struct.pack("<II", len(packed) - 3, len(columns)) + packed[:-3])
    with pytest.raises(MapError, match="compressed points are broken"):
        read(path)


def test_fields_of_several_numbers_and_padding_are_passed_over(tmp_path: Path) -> None:
    record = np.dtype([("a", "<f4", (3,)), ("x", "<f8"), ("p", "u1", (4,)), ("y", "<f4"), ("z", "<i2")])
    table = np.zeros(3, record)
    table["x"], table["y"], table["z"] = [1, 2, 3], [4, 5, 6], [7, 8, 9]
    head = "FIELDS normal x _ y z\nSIZE 4 8 1 4 2\nTYPE F F U F I\nCOUNT 3 1 4 1 1\nWIDTH 3\nHEIGHT 1\nDATA "
    (tmp_path / "b.pcd").write_bytes(f"{head}binary\n".encode() + table.tobytes())
    text = "\n".join(f"0 0 0 {k} 9 9 9 9 {k + 3} {k + 6}" for k in (1, 2, 3))
    (tmp_path / "a.pcd").write_bytes(f"# a comment\n{head}ascii\n{text}\n".encode())
    for name in ("a.pcd", "b.pcd"):
        assert read(tmp_path / name).points_m.tolist() == [[1, 4, 7], [2, 5, 8], [3, 6, 9]]


def test_big_endian_ply_behind_another_element(tmp_path: Path) -> None:
    head = (
        "ply\nformat binary_big_endian 1.0\ncomment x\nelement camera 2\nproperty double f\nelement vertex 40\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    )
    table = np.zeros(40, [("x", ">f4"), ("y", ">f4"), ("z", ">f4"), ("r", "u1"), ("g", "u1"), ("b", "u1")])
    for axis, name in enumerate("xyz"):
        table[name] = POINTS[:, axis]
    path = tmp_path / "map.ply"
    path.write_bytes(head.encode() + bytes(16) + table.tobytes())
    cloud = read(path)
    assert np.array_equal(cloud.points_m, POINTS)


def test_points_that_are_not_finite_are_said(tmp_path: Path) -> None:
    points, said = POINTS.copy(), list[str]()
    points[:5, 1] = np.nan
    (tmp_path / "map.ply").write_bytes(ply_bytes(points, None, "ascii"))
    assert len(read(tmp_path / "map.ply", warn=said.append).points_m) == 35
    assert said == ["map.ply: 5 points are left out, which are not finite or where the sensor is"]


def test_units_and_viewpoint(tmp_path: Path) -> None:
    said: list[str] = []
    (tmp_path / "map.pcd").write_bytes(pcd_bytes(POINTS * 1000))
    read(tmp_path / "map.pcd", warn=said.append)
    assert "are its numbers metres" in said[0]
    cloud = read(tmp_path / "map.pcd", unit_m=0.001, viewpoint=(1, 2, 3))
    assert np.allclose(cloud.points_m, POINTS, atol=1e-5)
    assert cloud.origin_m == (1.0, 2.0, 3.0)
    with pytest.raises(ConfigError, match=r"unit_m of map\.pcd must be above 0"):
        read(tmp_path / "map.pcd", unit_m=0)
    with pytest.raises(ConfigError, match=r"viewpoint of map\.pcd must be three numbers"):
        read(tmp_path / "map.pcd", viewpoint=(1, 2))


def test_a_viewpoint_that_a_file_names_is_told_unless_one_is_given(tmp_path: Path) -> None:
    path, said = tmp_path / "sweep.pcd", list[str]()
    path.write_bytes(pcd_bytes(POINTS).replace(b"VIEWPOINT 0 0 0 1 0 0 0", b"VIEWPOINT 4 -2 0.5 1 0 0 0"))
    assert read(path, warn=said.append).origin_m is None
    assert len(said) == 1
    assert "give viewpoint: [4, -2, 0.5]" in said[0]
    assert read(path, viewpoint=(4, -2, 0.5), warn=said.append).origin_m == (4.0, -2.0, 0.5)
    path.write_bytes(pcd_bytes(POINTS))
    read(path, warn=said.append)
    assert len(said) == 1


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.pcd", b"", "header has no line DATA"),
        ("a.pcd", b"FIELDS x y z\nDATA ascii\n", "no line SIZE"),
        ("a.pcd", pcd_bytes(POINTS)[:-7], "needs 480 bytes of points, has 473"),
        ("a.pcd", pcd_bytes(POINTS, None, "ascii")[:-40], "needs 40 rows of 3 numbers"),
        ("a.pcd", pcd_bytes(POINTS).replace(b"DATA binary", b"DATA zipped"), "'zipped', not ascii"),
        ("a.pcd", pcd_bytes(POINTS).replace(b"FIELDS x y z", b"FIELDS x y w"), "has no z: its fields are x, y, w"),
        ("a.pcd", pcd_bytes(POINTS[:0]), "a.pcd has no points"),
        ("a.pcd", pcd_bytes(np.full((4, 3), np.nan)), "none of its 4 points is finite and away"),
        ("a.ply", b"solid cube\n", "does not begin with a header"),
        ("a.ply", ply_bytes(POINTS)[:-1], "needs 480 bytes of vertices, has 479"),
        (
            "a.ply",
            ply_bytes(POINTS).replace(b"binary_little_endian", b"binary_middle"),
            "its format is 'binary_middle'",
        ),
        ("a.ply", ply_bytes(POINTS).replace(b"element vertex", b"element corner"), "has no vertices, only corner"),
        ("a.ply", ply_bytes(POINTS, None, "ascii").replace(b".", b"?", 2), "is no number"),
    ],
)
def test_broken_files_say_what_is_wrong(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MapError, match=said):
        read(tmp_path / name)
