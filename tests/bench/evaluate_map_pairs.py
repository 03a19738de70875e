"""Judges a matcher on the real map pairs of ``../shared/data/maps``, and on all pairs of them across buildings.

python tests/bench/evaluate_map_pairs.py [--matcher NAME] [--rules FILE] [--only grid|halmstad|across] [--out DIR]
    [--json DIR]

``grid`` are the 29 pairs with a transform and the 4 unrelated ones, ``halmstad`` the 12 sensor pairs of two flats with
keypoints, ``across`` every two maps of different buildings, several hundred, none of which may merge. With ``--json``
one file of each part is written instead of the tables, for ``tables_of_matching.py``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from mapgraft.cli import invoke

MAPS = Path(__file__).parents[2] / "../shared/data/maps"
HALMSTAD_M = 0.025  # nominal metres per pixel
BUILDINGS = {  # by the beginning of the file's name; what begins otherwise is a building that the pairs connect
    "c_robot": "cast",
    "c_mapa": "mapa",
    "c_intel": "intel",
    "f_Fr": "freiburg",
    "m_": "arena",  # one arena, driven, simulated and as a floor plan
    "t_hector": "rescue arena of team hector",
    "t_tiz": "rescue arena of team tiz",
    "HIH": "flat HIH",
    "KPT4A": "flat KPT4A",
}


def entries(part: str) -> list[dict[str, Any]]:
    """The entries of one list, with the files' full paths and their resolutions."""
    folder = MAPS / part
    found: list[dict[str, Any]] = json.loads((folder / "pairs.json").read_text(encoding="utf-8"))
    told = {"res_a": HALMSTAD_M, "res_b": HALMSTAD_M} if part == "halmstad" else {}
    return [{**entry, **told, **{side: str((folder / entry[side]).resolve()) for side in "ab"}} for entry in found]


def all_across() -> dict[str, Any]:
    """Every two files of different buildings."""
    pairs = entries("grid_pairs") + entries("halmstad")
    files = sorted({entry[side] for entry in pairs for side in "ab"})
    groups: dict[str, list[str]] = {}
    for file in files:
        name = next(building for start, building in BUILDINGS.items() if Path(file).name.startswith(start))
        groups.setdefault(name, []).append(file)
    members = {file: name for name, listed in groups.items() for file in listed}
    told = {entry[side]: entry[f"res_{side}"] for entry in pairs for side in "ab"}
    return {
        "pairs": [
            {"a": a, "b": b, "res_a": told[a], "res_b": told[b], "unrelated": True}
            for a in files
            for b in files
            if a < b and members[a] != members[b]
        ]
    }


def arguments_of(part: str, folder: Path) -> list[str]:
    """How ``mapgraft match`` is called for one part."""
    if part == "grid":
        lists = MAPS / "grid_pairs"
        return ["--pairs", str(lists / "pairs.json"), "--unrelated", str(lists / "unrelated.json")]
    if part == "halmstad":
        return ["--pairs", str(MAPS / "halmstad" / "pairs.json"), "--resolution", str(HALMSTAD_M)]
    path = folder / "across.json"
    path.write_text(json.dumps(all_across()), encoding="utf-8")
    return ["--pairs", str(path)]


def answered(arguments: list[str], part: str, folder: Path | None) -> int:
    """Call mapgraft with the tables printed or, with a folder, its JSON written there; returns the exit code."""
    if folder is None:
        print(f"\n{part}", flush=True)
        return invoke(arguments)
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{part}.json").open("w", encoding="utf-8") as file, contextlib.redirect_stdout(file):
        return invoke([*arguments, "--json"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--matcher", help="a matcher instead of the rules' own")
    parser.add_argument("--rules", help="a decision table instead of the default")
    parser.add_argument("--only", choices=("grid", "halmstad", "across"))
    parser.add_argument("--out", help="folder for pictures")
    parser.add_argument("--json", type=Path, help="folder for JSON, instead of tables")
    given = parser.parse_args()
    if not MAPS.is_dir():
        print(f"there are no maps in {MAPS}", file=sys.stderr)
        return 1
    options = [
        *(["--matcher", given.matcher] if given.matcher else []),
        *(["--rules", given.rules] if given.rules else []),
    ]
    with tempfile.TemporaryDirectory() as folder:
        for part in (given.only,) if given.only else ("grid", "halmstad", "across"):
            out = ["-o", str(Path(given.out) / part)] if given.out else []
            arguments = ["match", *arguments_of(part, Path(folder)), *options, *out]
            if code := answered(arguments, part, given.json):
                return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
