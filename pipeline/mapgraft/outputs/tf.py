"""Transforms as ``tf2_msgs/msg/TFMessage`` in CDR, many at a time."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

TF_TYPE = "tf2_msgs/msg/TFMessage"
_STAMP_AT = 8  # behind the encapsulation (4 bytes) and the count of transforms (4 bytes)
_NUMBERS = 7 * 8  # translation x, y, z and rotation x, y, z, w as float64, at the end of the message


class FramePair:
    """Encodes transforms between two fixed frames: all messages have one length and differ in stamp and numbers only.

    ``parent`` is the target, ``child`` the source of the transforms, as tf has it: ``T_parent_child``.
    """

    def __init__(self, parent: str, child: str) -> None:
        self._template = np.frombuffer(_message(parent, child), dtype=np.uint8)

    def encode(self, stamps_ns: NDArray[np.int64], numbers: NDArray[np.float64]) -> list[bytes]:
        """One message per row; ``numbers`` is (n, 7): x, y, z in metres and the unit quaternion x, y, z, w."""
        out = np.tile(self._template, (len(stamps_ns), 1))
        times = np.stack((stamps_ns // 1_000_000_000, stamps_ns % 1_000_000_000), axis=1).astype("<u4")
        out[:, _STAMP_AT : _STAMP_AT + 8] = times.view(np.uint8).reshape(-1, 8)
        out[:, -_NUMBERS:] = np.ascontiguousarray(numbers, dtype="<f8").view(np.uint8).reshape(-1, _NUMBERS)
        return [row.tobytes() for row in out]


def pose_numbers(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 7) x, y, z in metres and the unit quaternion x, y, z, w with w ≥ 0, of rigid (n, 4, 4) matrices."""
    m = matrices[:, :3, :3]
    d0, d1, d2 = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    squares = np.stack((1 + d0 - d1 - d2, 1 - d0 + d1 - d2, 1 - d0 - d1 + d2, 1 + d0 + d1 + d2), axis=1)
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    wx, wy, wz = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    x, y, z, w = squares.T
    rows = np.array([[x, xy, xz, wx], [xy, y, yz, wy], [xz, yz, z, wz], [wx, wy, wz, w]]).transpose(2, 0, 1)
    largest = squares.argmax(axis=1)  # the best conditioned of the four ways to write the same quaternion
    at = np.arange(len(m))
    q = rows[at, largest] * (0.5 / np.sqrt(squares[at, largest]))[:, None]
    q[q[:, 3] < 0] *= -1.0
    return np.concatenate((matrices[:, :3, 3], q), axis=1)


def _message(parent: str, child: str) -> bytes:
    """A message of one transform with stamp and numbers zero, little endian."""
    body = struct.pack("<Iii", 1, 0, 0)
    for frame in (parent, child):
        body += b"\0" * (-len(body) % 4)
        text = frame.encode() + b"\0"
        body += struct.pack("<I", len(text)) + text
    body += b"\0" * (-len(body) % 8)
    return b"\0\1\0\0" + body + b"\0" * _NUMBERS
