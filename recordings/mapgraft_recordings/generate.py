"""Makes the demo recording: ``python -m mapgraft_recordings.generate --seed 0 -o DIR``."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from mapgraft.errors import MapgraftError
from mapgraft_recordings.mission import Mission, build_mission, load_mission_plan
from mapgraft_recordings.outcome import Outcome, describe, outcome_of, write_outcome
from mapgraft_recordings.simulator.messages import ros_messages
from mapgraft_recordings.simulator.simulation import simulate
from mapgraft_recordings.simulator.world import load_plan
from mapgraft_recordings.writing import write_mcap

DEMO = Path(str(files("mapgraft_recordings") / "demo"))


def generate(seed: int, folder: Path) -> tuple[Mission, list[Path]]:
    """Simulate the demo mission and write one MCAP file per robot and the configuration into ``folder``.

    The same seed gives the same bytes. Returns the mission, which knows the truth, and the recording's files.
    """
    mission = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), seed)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for robot in mission.robots:
        paths.append(folder / f"{robot.name}.mcap")
        readings = simulate(mission.world, [robot], seed, mission.duration_s)
        write_mcap(paths[-1], ros_messages([robot], readings))
    if folder.resolve() != DEMO.resolve():
        shutil.copyfile(DEMO / "config.yaml", folder / "config.yaml")
    return mission, paths


def expect(mission: Mission, paths: Sequence[Path], folder: Path) -> Outcome:
    """Run the main job on the recording and write what came of it to ``expected.json`` in ``folder``."""
    from mapgraft.job import run

    outcome = outcome_of(run(paths, folder / "config.yaml").events, mission.T_world_map)
    write_outcome(folder / "expected.json", outcome)
    return outcome


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="mapgraft_recordings.generate", description="Make the demo recording.")
    parser.add_argument("--seed", type=int, default=0, help="varies noise, speeds, start poses and clutter")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")
    parser.add_argument("--expect", action="store_true", help="also run the main job and write expected.json")
    given = parser.parse_args(arguments)
    try:
        mission, paths = generate(given.seed, given.output)
        outcome = expect(mission, paths, given.output) if given.expect else None
    except MapgraftError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    for path in paths:
        print(f"{path}  {path.stat().st_size / 1e6:.2f} MB")
    if outcome is not None:
        print("\n".join(describe(outcome)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
