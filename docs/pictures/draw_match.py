"""Draws match.png: two maps of the demo, with cells of 5 and of 10 cm, as ``mapgraft match`` lays them on each other.

python docs/pictures/draw_match.py
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from mapgraft.cli import invoke


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        out, match = Path(folder) / "demo", Path(folder) / "match"
        maps = [str(out / "maps" / f"{robot}.yaml") for robot in ("alpha", "charlie")]
        for arguments in (["run", "--quiet", "-o", str(out)], ["match", *maps, "-o", str(match)]):
            if invoke(arguments):
                raise SystemExit(f"mapgraft {' '.join(arguments)} failed")
        shutil.copyfile(match / "overlay.png", Path(__file__).with_name("match.png"))


if __name__ == "__main__":
    main()
