"""Replay a recording and keep the cells of every robot's last fused map: RECORDING CONFIG OUT; a process of its own."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import mapgraft

recording, config, out = (Path(argument) for argument in sys.argv[1:])
result = mapgraft.run([recording], config, out)
for robot, snapshot in result.maps.items():
    if snapshot.map_type.name == "point_landmarks":
        cells = snapshot.fused.cells
        np.savez(out / f"{robot}.npz", keys=cells.keys, counts=cells.counts)
