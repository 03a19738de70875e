"""Planar lidars: beams, field of view, limits, noise, lost beams, mounting, and beams fired one after another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_recordings.simulator.driving import Trajectory
from mapgraft_recordings.simulator.raycast import Segments, cast_fan, cast_rays, unit_vectors

_FULL_TURN_RAD = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Mount:
    """Where the lidar sits on the robot's body, and whether it hangs upside down (rolled by half a turn)."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.2
    yaw_rad: float = 0.0
    upside_down: bool = False

    @property
    def T_base_sensor(self) -> Transform:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        flip = -1.0 if self.upside_down else 1.0
        return Transform.from_matrix(
            np.array([[c, -s * flip, 0.0, self.x_m], [s, c * flip, 0.0, self.y_m], [0.0, 0.0, flip, self.z_m]])
        )


@dataclass(frozen=True, slots=True)
class Lidar:
    """A lidar; what it reports follows REP 117: ``inf`` where nothing came back, NaN where a beam was lost.

    The first of ``beams`` points to minus half the field of view; a full turn has no beam twice. The noise is Gaussian,
    ``step_m`` is the resolution of a reported range, ``dropout`` the share of lost beams. ``sweep_s`` is the time from
    the first beam to the last; 0 means that all are fired at once.
    """

    beams: int
    field_of_view_rad: float
    range_min_m: float
    range_max_m: float
    rate_hz: float
    noise_sigma_m: float = 0.01
    dropout: float = 0.0
    sweep_s: float = 0.0
    step_m: float = 0.001
    mount: Mount = Mount()

    @property
    def angle_min_rad(self) -> float:
        return -self.field_of_view_rad / 2

    @property
    def angle_increment_rad(self) -> float:
        full = self.field_of_view_rad > _FULL_TURN_RAD - 1e-9
        return self.field_of_view_rad / (self.beams if full else self.beams - 1)

    @property
    def time_increment_s(self) -> float:
        return self.sweep_s / (self.beams - 1)

    def angles_rad(self) -> NDArray[np.float64]:
        """Where the beams point in the sensor's frame, (n,)."""
        return np.arange(self.beams, dtype=np.float64) * self.angle_increment_rad + self.angle_min_rad

    def sense(
        self, segments: Segments, trajectory: Trajectory, time_s: float, rng: np.random.Generator
    ) -> NDArray[np.float32]:
        """One sweep that starts at ``time_s``: ranges (n,) float32 in metres, as a driver reports them."""
        true_m = self._true_ranges(segments, trajectory, time_s)
        measured = true_m + rng.normal(0.0, self.noise_sigma_m, self.beams)
        lost = rng.random(self.beams) < self.dropout
        measured = np.round(np.maximum(measured, 0.0) / self.step_m) * self.step_m
        measured[measured > self.range_max_m] = np.inf
        measured[lost] = np.nan
        return measured.astype(np.float32)

    def _true_ranges(self, segments: Segments, trajectory: Trajectory, time_s: float) -> NDArray[np.float64]:
        reach_m = self.range_max_m + 10 * self.noise_sigma_m
        sign = -1.0 if self.mount.upside_down else 1.0
        if self.sweep_s == 0.0:
            x, y, yaw = trajectory.at(np.array([time_s]))[0]
            c, s = math.cos(yaw), math.sin(yaw)
            first = yaw + self.mount.yaw_rad + sign * self.angle_min_rad
            increment = sign * self.angle_increment_rad
            directions = unit_vectors(first + increment * np.arange(self.beams))
            ox = x + c * self.mount.x_m - s * self.mount.y_m
            oy = y + s * self.mount.x_m + c * self.mount.y_m
            return cast_fan(ox, oy, first, increment, directions, segments, reach_m)
        bases = trajectory.at(np.arange(self.beams, dtype=np.float64) * self.time_increment_s + time_s)
        ahead = unit_vectors(bases[:, 2])
        left = np.stack((-ahead[:, 1], ahead[:, 0]), axis=1)
        origins = bases[:, :2] + ahead * self.mount.x_m + left * self.mount.y_m
        directions = unit_vectors(bases[:, 2] + self.mount.yaw_rad + sign * self.angles_rad())
        return cast_rays(origins, directions, segments, reach_m)
