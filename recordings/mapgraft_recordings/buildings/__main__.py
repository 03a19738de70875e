"""Writes the log of a drive through a random building: ``python -m mapgraft_recordings.buildings --seed 3 -o FILE``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from mapgraft.errors import MapgraftError
from mapgraft_recordings.buildings.building import building
from mapgraft_recordings.buildings.carmen import write_carmen
from mapgraft_recordings.buildings.cloud_messages import cloud_messages, first_place
from mapgraft_recordings.buildings.driving import record
from mapgraft_recordings.buildings.spatial import SpinningLidar, record_spatial
from mapgraft_recordings.buildings.traits import KINDS
from mapgraft_recordings.writing import write_mcap


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="mapgraft_recordings.buildings",
        description="Write the log of one drive through a random building, with corrected poses.",
    )
    parser.add_argument("--seed", type=int, default=0, help="which building")
    parser.add_argument("--kind", choices=KINDS, help="by the seed when not given")
    parser.add_argument("--drive", type=int, default=0, help="which drive through it")
    parser.add_argument("--scans", type=int, default=400, help="how many scans")
    parser.add_argument("--rings", type=int, help="write clouds of a spinning lidar with so many rings, into MCAP")
    parser.add_argument("--robot", default="robot", help="name of the robot in MCAP")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write: office.log.gz, or office.mcap")
    given = parser.parse_args(arguments)
    try:
        house = building(given.seed, given.kind)
        if given.rings is not None:
            lidar = SpinningLidar(rings=given.rings)
            spatial = record_spatial(house, given.drive, given.scans, lidar)
            write_mcap(given.output, cloud_messages(spatial, given.robot, first_place(spatial)))
            return 0
        made = record(house, given.drive, given.scans)
    except MapgraftError as error:
        sys.stderr.write(f"error: {error}\n")
        return error.exit_code
    write_carmen(given.output, made, given.drive)
    return 0


if __name__ == "__main__":
    sys.exit(main())
