"""The ROS 2 message texts of our own types."""

from __future__ import annotations

from importlib.resources import files

MESSAGE_PACKAGE = "mapgraft_msgs"
_NAMES = ("NamedValue", "Measurement", "Exactness", "MergeEvent")  # a type stands after those it is made of


def message_texts() -> dict[str, str]:
    """Full type name (``mapgraft_msgs/msg/MergeEvent``) → its text with comments, dependencies first."""
    folder = files("mapgraft_schemas") / "msg"
    return {f"{MESSAGE_PACKAGE}/msg/{name}": (folder / f"{name}.msg").read_text(encoding="utf-8") for name in _NAMES}
