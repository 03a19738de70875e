"""Makes the demo recordings: ``python -m mapgraft_recordings.generate --demo heterogeneous --seed 0 -o DIR``."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from mapgraft.config import Section, read_mapping
from mapgraft.errors import MapgraftError
from mapgraft.events import Event
from mapgraft_recordings import DEMOS
from mapgraft_recordings.drawn_plan import DrawnPlan, as_svg
from mapgraft_recordings.mission import Mission, build_mission, load_mission_plan
from mapgraft_recordings.outcome import Outcome, describe, outcome_of, with_deviations, write_outcome
from mapgraft_recordings.simulator.messages import Message, ros_messages
from mapgraft_recordings.simulator.simulation import Pose, Robot, simulate
from mapgraft_recordings.simulator.world import checked, load_plan
from mapgraft_recordings.spinning import SpinningPlan, spinning_messages
from mapgraft_recordings.told_apart import told_apart
from mapgraft_recordings.writing import write_mcap

DEMO = Path(str(files("mapgraft_recordings") / "demo"))
HETEROGENEOUS = DEMO.with_name("heterogeneous")


class OtherLidars(Section):
    """Which robots of the mission carry a spinning lidar instead."""

    spinning: dict[str, SpinningPlan]


def generate(seed: int, folder: Path, demo: str = DEMOS[0]) -> tuple[Mission, list[Path]]:
    """Simulate a demo's mission and write one MCAP file per robot and the configuration into ``folder``.

    The heterogeneous demo has a drawing of the floor among its files. The same seed gives the same bytes. Returns the
    mission, which knows the truth, and the recording's files.
    """
    mission = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), seed)
    spinning = other_lidars() if demo == "heterogeneous" else {}
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for robot in mission.robots:
        paths.append(folder / f"{robot.name}.mcap")
        write_mcap(paths[-1], _messages(mission, robot, spinning.get(robot.name)))
    source = DEMO
    if demo == "heterogeneous":
        source = HETEROGENEOUS
        paths.append(folder / "plan.svg")
        paths[-1].write_text(as_svg(mission.world, drawn_plan()), encoding="utf-8")
    if folder.resolve() != source.resolve():
        shutil.copyfile(source / "config.yaml", folder / "config.yaml")
    return mission, paths


def drawn_plan() -> DrawnPlan:
    """How the floor plan of the heterogeneous demo differs from the floor."""
    return checked(DrawnPlan, read_mapping(HETEROGENEOUS / "plan.yaml"), "plan.yaml")


def other_lidars() -> dict[str, SpinningPlan]:
    """The robots of the heterogeneous demo that carry a spinning lidar."""
    return checked(OtherLidars, read_mapping(HETEROGENEOUS / "mission.yaml"), "mission.yaml").spinning


def _messages(mission: Mission, robot: Robot, spinning: SpinningPlan | None) -> Iterator[Message]:
    if spinning is not None:
        return spinning_messages(mission, robot, spinning)
    return ros_messages([robot], simulate(mission.world, [robot], mission.seed, mission.duration_s))


def expect(mission: Mission, paths: Sequence[Path], folder: Path, demo: str = DEMOS[0]) -> list[str]:
    """Run the main job on the recording and write what came of it to ``expected.json`` in ``folder``; told in lines."""
    from mapgraft.job import run

    events, truth = run(paths, folder / "config.yaml").events, frames(mission, paths)
    outcome = judged(events, truth, demo)
    write_outcome(folder / "expected.json", outcome)
    lines = describe(outcome)
    if demo == "heterogeneous":
        for robot, apart in told_apart(events, truth, drawn_plan(), mission.world).items():
            lines.append(
                f"{robot} found {apart.findings} deviations: {apart.mistakes} are mistakes of the plan, "
                f"{apart.furniture} furniture, {apart.neither} neither"
            )
    return lines


def judged(events: Sequence[Event], T_world_map: Mapping[str, Pose], demo: str = DEMOS[0]) -> Outcome:
    """What came of a run of a demo, held against the truth."""
    outcome = outcome_of(events, T_world_map)
    return with_deviations(outcome, events, drawn_plan()) if demo == "heterogeneous" else outcome


def frames(mission: Mission, paths: Sequence[Path]) -> dict[str, Pose]:
    """The truth that no robot knows: where every map's frame lies. A plan is drawn in the world's."""
    drawn = {path.stem: (0.0, 0.0, 0.0) for path in paths if path.suffix == ".svg"}
    return {**mission.T_world_map, **drawn}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="mapgraft_recordings.generate", description="Make a demo recording.")
    parser.add_argument("--demo", choices=DEMOS, default=DEMOS[0])
    parser.add_argument("--seed", type=int, default=0, help="varies noise, speeds, start poses and clutter")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")
    parser.add_argument("--expect", action="store_true", help="also run the main job and write expected.json")
    given = parser.parse_args(arguments)
    try:
        mission, paths = generate(given.seed, given.output, given.demo)
        lines = expect(mission, paths, given.output, given.demo) if given.expect else []
    except MapgraftError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    for path in paths:
        print(f"{path}  {path.stat().st_size / 1e6:.2f} MB")
    for line in lines:
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
