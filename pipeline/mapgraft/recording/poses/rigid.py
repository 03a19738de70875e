"""Poses as seven plain floats: quick enough for one lookup per scan, exact enough for a law against scipy.

A ``Pose7`` is (x, y, z, qx, qy, qz, qw) of ``T_target_source``: metres and a unit quaternion. Tuples, because on single
poses Python's floats are several times faster than numpy's arrays.
"""

from __future__ import annotations

import math

import numpy as np

from mapgraft.contracts import Transform

Pose7 = tuple[float, float, float, float, float, float, float]

IDENTITY: Pose7 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NEARLY_PARALLEL = 1.0 - 1e-12  # above this cosine sin(angle) is lost in rounding, and a straight line is exact


def pose7(xyz_m: tuple[float, float, float], xyzw: tuple[float, float, float, float]) -> Pose7:
    """The pose with its quaternion normalised; the caller has checked that it has a length."""
    x, y, z, w = xyzw
    scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    return (xyz_m[0], xyz_m[1], xyz_m[2], x * scale, y * scale, z * scale, w * scale)


def believable(xyz_m: tuple[float, float, float], xyzw: tuple[float, float, float, float]) -> Pose7 | None:
    """The pose with its quaternion normalised; None when a number is not finite or the quaternion has no length."""
    x, y, z, w = xyzw
    square = x * x + y * y + z * z + w * w
    px, py, pz = xyz_m
    if not 1e-12 <= square < math.inf or not math.isfinite(px + py + pz):
        return None
    scale = 1.0 / math.sqrt(square)
    return (px, py, pz, x * scale, y * scale, z * scale, w * scale)


def planar(x_m: float, y_m: float, yaw_rad: float) -> Pose7:
    return (x_m, y_m, 0.0, 0.0, 0.0, math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad))


def compose(a: Pose7, b: Pose7) -> Pose7:
    """``T_r_t = T_r_s · T_s_t``."""
    ax, ay, az, ai, aj, ak, aw = a
    bx, by, bz, bi, bj, bk, bw = b
    ti, tj, tk = 2.0 * (aj * bz - ak * by), 2.0 * (ak * bx - ai * bz), 2.0 * (ai * by - aj * bx)
    return (
        ax + bx + aw * ti + aj * tk - ak * tj,
        ay + by + aw * tj + ak * ti - ai * tk,
        az + bz + aw * tk + ai * tj - aj * ti,
        aw * bi + ai * bw + aj * bk - ak * bj,
        aw * bj - ai * bk + aj * bw + ak * bi,
        aw * bk + ai * bj - aj * bi + ak * bw,
        aw * bw - ai * bi - aj * bj - ak * bk,
    )


def inverse(a: Pose7) -> Pose7:
    """``T_source_target`` of ``T_target_source``."""
    x, y, z, i, j, k, w = a
    ti, tj, tk = 2.0 * (k * y - j * z), 2.0 * (i * z - k * x), 2.0 * (j * x - i * y)
    return (
        -(x + w * ti - j * tk + k * tj),
        -(y + w * tj - k * ti + i * tk),
        -(z + w * tk - i * tj + j * ti),
        -i,
        -j,
        -k,
        w,
    )


def interpolate(a: Pose7, b: Pose7, u: float) -> Pose7:
    """The pose at the fraction ``u`` of the way from ``a`` to ``b``: straight line and slerp along the shorter arc."""
    ai, aj, ak, aw = a[3], a[4], a[5], a[6]
    bi, bj, bk, bw = b[3], b[4], b[5], b[6]
    cosine = ai * bi + aj * bj + ak * bk + aw * bw
    sign = 1.0
    if cosine < 0.0:
        cosine, sign = -cosine, -1.0
    if cosine > _NEARLY_PARALLEL:
        p, q = 1.0 - u, sign * u
    else:
        angle = math.acos(cosine)
        p, q = math.sin((1.0 - u) * angle), sign * math.sin(u * angle)
    i, j, k, w = p * ai + q * bi, p * aj + q * bj, p * ak + q * bk, p * aw + q * bw
    scale = 1.0 / math.sqrt(i * i + j * j + k * k + w * w)
    ax, ay, az = a[0], a[1], a[2]
    return (
        ax + u * (b[0] - ax),
        ay + u * (b[1] - ay),
        az + u * (b[2] - az),
        i * scale,
        j * scale,
        k * scale,
        w * scale,
    )


def yaw_of(a: Pose7) -> float:
    """The heading of the source's x axis in the target's plane, in radians."""
    i, j, k, w = a[3], a[4], a[5], a[6]
    return math.atan2(2.0 * (i * j + k * w), 1.0 - 2.0 * (j * j + k * k))


def levelled(a: Pose7) -> Pose7:
    """The pose's place and heading on the ground: z, roll and pitch dropped."""
    return planar(a[0], a[1], yaw_of(a))


def angle_of(a: Pose7) -> float:
    """How far the pose turns, in radians within [0, π]."""
    return 2.0 * math.atan2(math.sqrt(a[3] * a[3] + a[4] * a[4] + a[5] * a[5]), abs(a[6]))


def from_transform(T: Transform) -> Pose7:
    return pose7((T.x_m, T.y_m, T.z_m), T.quaternion_xyzw())


def to_transform(a: Pose7) -> Transform:
    x, y, z, i, j, k, w = a
    return Transform(
        np.array(
            (
                1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w), x,
                2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w), y,
                2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j), z,
                0.0, 0.0, 0.0, 1.0,
            )
        ).reshape(4, 4)
    )  # fmt: skip
