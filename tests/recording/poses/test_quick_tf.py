"""The fast way into serialized transforms gives what the general way gives, or nothing."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mapgraft.recording.decoding.poses import poses_of
from mapgraft.recording.poses.quick_tf import transforms

NAME = "tf2_msgs/msg/TFMessage"
STORES = {"cdr": get_typestore(Stores.ROS2_HUMBLE), "ros1": get_typestore(Stores.ROS1_NOETIC)}
STORES["ros1"].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", NAME))

numbers = st.floats(allow_nan=False)
frames = st.text(st.characters(codec="utf-8", exclude_characters="\x00", exclude_categories=["Cs"]), max_size=12)
records = st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1), frames, frames, st.tuples(*[numbers] * 7))


def message(encoding, given_):
    types = STORES[encoding].types
    made = []
    for seconds, nanoseconds, frame, child, (x, y, z, qx, qy, qz, qw) in given_:
        fields = {"stamp": types["builtin_interfaces/msg/Time"](seconds, nanoseconds), "frame_id": frame}
        if encoding == "ros1":
            fields["seq"] = 3
        made.append(
            types["geometry_msgs/msg/TransformStamped"](
                header=types["std_msgs/msg/Header"](**fields),
                child_frame_id=child,
                transform=types["geometry_msgs/msg/Transform"](
                    translation=types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                    rotation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
                ),
            )
        )
    return types[NAME](transforms=made)


def encoded(encoding, given_) -> bytes:
    store = STORES[encoding]
    serialize = store.serialize_cdr if encoding == "cdr" else store.serialize_ros1
    return bytes(serialize(message(encoding, given_), NAME))


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@settings(deadline=None)
@given(given_=st.lists(records, max_size=5))
def test_equal_to_the_general_way(encoding, given_):
    data = encoded(encoding, given_)
    store = STORES[encoding]
    general = store.deserialize_cdr(data, NAME) if encoding == "cdr" else store.deserialize_ros1(data, NAME)
    assert tuple(transforms(encoding, data)) == poses_of(NAME, general)
    assert transforms(encoding, memoryview(data)) == transforms(encoding, data)


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@settings(deadline=None)
@given(given_=st.lists(records, min_size=1, max_size=3), data=st.data())
def test_what_is_cut_or_longer_is_left_to_the_general_way(encoding, given_, data):
    whole = encoded(encoding, given_)
    cut = data.draw(st.integers(0, len(whole) - 1))
    quick = transforms(encoding, whole[:cut])
    assert quick is None
    assert transforms(encoding, whole + b"\x01" * 8) is None


def test_other_encodings_and_byte_orders_are_left_to_the_general_way():
    types = STORES["cdr"].types
    big = bytes(STORES["cdr"].serialize_cdr(types[NAME](transforms=[]), NAME, little_endian=False))
    assert transforms("cdr", big) is None
    assert transforms("json", b"{}") is None
    assert transforms("cdr", b"\x00\x01\x00\x00\xff\xff\xff\xff") is None


def test_stamps_of_ros1_beyond_2038_are_left_to_the_general_way():
    whole = encoded("ros1", [(7, 2, "odom", "base", (1.0,) * 3 + (0.0, 0.0, 0.0, 1.0))])
    at = 8  # behind the count and the sequence number
    assert whole[at : at + 4] == bytes((7, 0, 0, 0))
    assert transforms("ros1", whole[:at] + b"\xff\xff\xff\x7f" + whole[at + 4 :])[0].stamp_ns == (2**31 - 1) * 10**9 + 2
    assert transforms("ros1", whole[:at] + b"\x00\x00\x00\x80" + whole[at + 4 :]) is None


def test_leading_slashes_go():
    (record,) = transforms("ros1", encoded("ros1", [(1, 2, "/odom", "/base_link", (1.0,) * 3 + (0.0, 0.0, 0.0, 1.0))]))
    assert (record.frame, record.child, record.stamp_ns) == ("odom", "base_link", 1_000_000_002)
    assert record.valid and math.isclose(record.xyz_m[0], 1.0)
