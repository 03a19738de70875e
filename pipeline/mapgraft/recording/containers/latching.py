"""Whether a publisher kept its last message for late subscribers."""

from __future__ import annotations

import re
from collections.abc import Mapping

_TRANSIENT_LOCAL = re.compile(r"durability:\s*(1\b|transient_local\b)")


def keeps_last(offered_qos_profiles: str) -> bool:
    """Whether one of the ROS 2 QoS profiles is transient local, in the numbers of old bags or the words of new ones."""
    return _TRANSIENT_LOCAL.search(offered_qos_profiles) is not None


def is_latched(metadata: Mapping[str, str]) -> bool:
    """The same from the metadata of an MCAP channel, which may also come from a ROS 1 bag."""
    latching = metadata.get("latching", "").lower() in ("1", "true")
    return latching or keeps_last(metadata.get("offered_qos_profiles", ""))
