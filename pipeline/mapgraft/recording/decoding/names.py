"""The names of message types and frames, spelt one way."""

from __future__ import annotations


def message_type(name: str) -> str:
    """``package/msg/Name`` for ``package/Name`` (ROS 1), ``package/msg/Name`` (ROS 2), ``package.Name`` (protobuf)."""
    if "/" in name:
        package, _, last = name.rpartition("/")
        return name if package.endswith(("/msg", "/action", "/srv")) else f"{package}/msg/{last}"
    package, dot, last = name.rpartition(".")
    return f"{package}/msg/{last}" if dot else name


def bare_frame(name: str) -> str:
    """A frame name without the leading slash that ROS 1 allowed."""
    return name.removeprefix("/")
