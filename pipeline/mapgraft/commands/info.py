"""``mapgraft info``: what is in a recording, what would be used of it, and what is wrong with it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.table import Table

from mapgraft.check import check
from mapgraft.console import cell, print_json, results
from mapgraft.errors import NothingToMapError
from mapgraft.evaluation.tables import wide
from mapgraft.job import as_config, demo
from mapgraft.plugins import load_plugins

if TYPE_CHECKING:
    from mapgraft.recording.survey import Survey, SurveyedFile, SurveyedRobot


def show_info(files: Sequence[Path], config: Path | None, *, as_json: bool, without: Sequence[str]) -> None:
    """Print the survey of some recordings; without any, of the demo recording.

    Raises NothingToMapError where no robot can be mapped, after the files and their topics have been printed.
    """
    from mapgraft.recording.survey import files_alone, survey

    paths = list(files)
    if not paths:
        paths, demo_config = demo()
        config = config or demo_config
    checked, plugins = as_config(config), load_plugins(without)
    try:
        used = check(paths, checked, plugins)
    except NothingToMapError:
        if not as_json:
            _print_files(files_alone(paths, checked, plugins=plugins))
        raise
    found = survey(paths, checked, plugins=plugins)
    if as_json:
        print_json({**dataclasses.asdict(found), "used": used})
        return
    console = _print_files(found.files)
    for robot in found.robots:
        _print_robot(console, robot, used["robots"][robot.source.name])
    _print_mission(console, found)
    exchange = ", ".join(f"{key} {value}" for key, value in used["exchange"].items() if key != "use")
    console.print(cell(f"  exchange: {used['exchange']['use']}" + (f" ({exchange})" if exchange else "")))
    console.print(cell(f"  rules: {len(used['rules'])}; 'mapgraft decide FILE…' says which of them applies, and why"))


def _print_files(files: Sequence[SurveyedFile]) -> Console:
    """Every file with its topics, whole: names are cut nowhere."""
    console = wide(results())
    for file in files:
        _print_file(console, file)
    return console


def _print_file(console: Console, file: SurveyedFile) -> None:
    size = f"{file.size_bytes / 1e6:,.1f} MB" if file.size_bytes >= 1e5 else f"{file.size_bytes / 1e3:,.1f} kB"
    console.print(
        cell(f"{file.path}  {file.container}, {size}, {file.duration_s:,.1f} s from {_date(file.start_ns)}"),
        style="bold",
    )
    table = Table(box=None, header_style="dim", pad_edge=False)
    for column in ("topic", "type", "messages", "used by"):
        table.add_column(column, justify="right" if column == "messages" else "left", overflow="fold")
    for topic in file.topics:
        count = "?" if topic.count is None else f"{topic.count:,}"
        used = ", ".join(topic.used_by) or topic.note
        table.add_row(cell(topic.topic), cell(topic.message_type), count, cell(used))
    console.print(Padding(table, (0, 0, 0, 2), expand=False))


def _print_robot(console: Console, robot: SurveyedRobot, used: Mapping[str, str]) -> None:
    source = robot.source
    console.print(cell(f"robot {source.name}"), style="bold")
    seen = f"{', '.join(source.kinds)} on {', '.join(source.topics)}"
    lines = [
        f"observes  {seen}: {robot.placed:,} of {robot.read:,} have a pose",
        f"poses     {source.poses}",
        f"map       {used['map']}, reversal {used['reversal']}",
        f"sharpness {robot.smear}",
    ]
    if robot.path_m:
        lines.append(f"path      {robot.path_m:,.1f} m from {_date(source.start_ns)} to {_date(source.end_ns)}")
    for line in (*lines, *(f"note      {remark}" for remark in source.remarks)):
        console.print(cell(f"  {line}"))


def _print_mission(console: Console, found: Survey) -> None:
    duration_s = (found.end_ns - found.start_ns) / 1e9
    robots = f"{len(found.robots)} robot{'s' * (len(found.robots) != 1)}"
    console.print(cell(f"mission of {robots}, {duration_s:,.1f} s"), style="bold")
    for remark in found.remarks:
        console.print(cell(f"  {remark}"))
    for problem in found.problems:
        console.print(cell(f"  {problem}"), style="yellow")


def _date(stamp_ns: int | None) -> str:
    """UTC where the stamp looks like one, else plain seconds."""
    if stamp_ns is None:
        return "?"
    seconds = stamp_ns / 1e9
    if seconds < 1e8:  # before 1973: seconds since something else
        return f"{seconds:,.1f} s"
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
