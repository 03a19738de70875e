"""Rigid transforms, spelt ``T_target_source``: ``p_target = T_target_source.apply(p_source)``."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.errors import TransformError

Matrix4 = NDArray[np.float64]  # (4, 4), row-major, last row 0 0 0 1
Points = NDArray[np.float64]  # (n, 2) or (n, 3) metres, in the frame the name says

ROTATION_STEP = 2.0**-24  # fixed point of a rotation entry
TRANSLATION_STEP_M = 2.0**-16  # fixed point of a translation entry
_RIGID_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """A rigid transform in three dimensions; planar ones leave z, roll and pitch at zero.

    ``matrix`` is (4, 4) float64 and read-only. Build it with a classmethod: they check, the constructor trusts.
    """

    matrix: Matrix4

    def __post_init__(self) -> None:
        self.matrix.setflags(write=False)

    @classmethod
    def identity(cls) -> Transform:
        return cls(np.eye(4))

    @classmethod
    def planar(cls, x_m: float, y_m: float, yaw_rad: float) -> Transform:
        """The transform that turns by ``yaw_rad`` (counter-clockwise, z up) and then shifts by (``x_m``, ``y_m``).

        Raises TransformError when a number is not finite.
        """
        if not (math.isfinite(x_m) and math.isfinite(y_m) and math.isfinite(yaw_rad)):
            raise TransformError(f"a pose must be finite, found x={x_m}, y={y_m}, yaw={yaw_rad}")
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return cls(np.array([[c, -s, 0.0, x_m], [s, c, 0.0, y_m], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]))

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.floating]) -> Transform:
        """A checked copy of a (4, 4), (3, 4) or planar (3, 3) matrix; raises TransformError unless it is rigid."""
        given = np.asarray(matrix, dtype=np.float64)
        full = np.eye(4)
        if given.shape == (3, 3):
            full[:2, :2], full[:2, 3] = given[:2, :2], given[:2, 2]
        elif given.shape in ((4, 4), (3, 4)):
            full[:3] = given[:3]
        else:
            raise TransformError(
                f"a transform needs a (4, 4), (3, 4) or planar (3, 3) matrix, found shape {given.shape}"
            )
        rotation = full[:3, :3]
        if not np.isfinite(full).all():
            raise TransformError("a transform must be finite, found NaN or infinity")
        if abs(rotation @ rotation.T - np.eye(3)).max() > _RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
            raise TransformError("a transform must be rigid (a rotation and a shift), found scale, shear or reflection")
        return cls(full)

    @classmethod
    def from_quaternion(cls, xyz_m: tuple[float, float, float], xyzw: tuple[float, float, float, float]) -> Transform:
        """The transform of a ROS pose; the quaternion need not be normalised.

        Raises TransformError when a number is not finite or the quaternion has no length.
        """
        x, y, z, w = xyzw
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if not (all(map(math.isfinite, xyz_m)) and math.isfinite(norm)) or norm < 1e-6:
            raise TransformError(f"a pose must be finite with a unit quaternion, found {xyz_m}, {xyzw} (xyzw)")
        x, y, z, w = x / norm, y / norm, z / norm, w / norm
        return cls(
            np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), xyz_m[0]],
                    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), xyz_m[1]],
                    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), xyz_m[2]],
                    [0.0, 0.0, 0.0, 1.0],
                ]
            )
        )

    def __matmul__(self, other: Transform) -> Transform:
        return Transform(self.matrix @ other.matrix)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transform) and bool((self.matrix == other.matrix).all())

    def __hash__(self) -> int:
        return hash(self.matrix.tobytes())

    def __repr__(self) -> str:
        return f"Transform(x={self.x_m:.3f} m, y={self.y_m:.3f} m, yaw={math.degrees(self.yaw_rad):.2f}°)"

    def inverse(self) -> Transform:
        rotation = self.matrix[:3, :3].T
        out = np.eye(4)
        out[:3, :3] = rotation
        out[:3, 3] = -rotation @ self.matrix[:3, 3]
        return Transform(out)

    def apply(self, points: NDArray[np.floating]) -> Points:
        """Points (n, 2) or (n, 3) in metres, moved from the source frame to the target frame; same shape, float64."""
        d = points.shape[1]
        moved: Points = points @ self.matrix[:d, :d].T + self.matrix[:d, 3]
        return moved

    @property
    def x_m(self) -> float:
        return float(self.matrix[0, 3])

    @property
    def y_m(self) -> float:
        return float(self.matrix[1, 3])

    @property
    def z_m(self) -> float:
        return float(self.matrix[2, 3])

    @property
    def yaw_rad(self) -> float:
        return math.atan2(self.matrix[1, 0], self.matrix[0, 0])

    def quaternion_xyzw(self) -> tuple[float, float, float, float]:
        """The rotation as a unit quaternion with w ≥ 0."""
        m = self.matrix
        candidates = (
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        )
        largest = int(np.argmax(candidates))
        t = candidates[largest]
        xyzw = (
            (t, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]),
            (m[0, 1] + m[1, 0], t, m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]),
            (m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], t, m[1, 0] - m[0, 1]),
            (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], t),
        )[largest]
        half = 0.5 / math.sqrt(t) * (-1.0 if xyzw[3] < 0 else 1.0)
        return (xyzw[0] * half, xyzw[1] * half, xyzw[2] * half, xyzw[3] * half)

    def snapped(self) -> Transform:
        """The nearest transform in fixed point: rotation entries in 2⁻²⁴, translation in 2⁻¹⁶ m.

        Its entries are exact in float64, so integer kernels can take them without rounding.
        """
        out = np.eye(4)
        out[:3, :3] = np.round(self.matrix[:3, :3] / ROTATION_STEP) * ROTATION_STEP
        out[:3, 3] = np.round(self.matrix[:3, 3] / TRANSLATION_STEP_M) * TRANSLATION_STEP_M
        return Transform(out + 0.0)  # + 0.0 turns -0.0 into 0.0: equal transforms have equal bytes

    def difference(self, other: Transform) -> tuple[float, float]:
        """How far two transforms into the same frame lie apart: (metres between origins, radians of rotation)."""
        delta = self.inverse() @ other
        cosine = (np.trace(delta.matrix[:3, :3]) - 1.0) / 2.0
        skew = delta.matrix[:3, :3] - delta.matrix[:3, :3].T
        sine = 0.5 * math.sqrt(skew[2, 1] ** 2 + skew[0, 2] ** 2 + skew[1, 0] ** 2)
        return float(np.linalg.norm(delta.matrix[:3, 3])), math.atan2(sine, cosine)
