"""Messages in the content of a chunk: what is read does not depend on what else was asked for."""

from __future__ import annotations

import struct

from hypothesis import example, given
from hypothesis import strategies as st

from mapgraft.contracts.sources import Channel
from mapgraft.recording.containers.mcap_messages import messages
from mapgraft.recording.containers.selection import wanted

CHANNELS = [Channel(n, f"/{n}", "", "json", None, False, True, "") for n in (1, 2)]
LENGTHS = st.sampled_from([0, 14, 21, 22, 30, 30, 30])  # 22 is the shortest that a message can have
RECORD = st.tuples(st.sampled_from([3, 5, 5, 5, 9]), LENGTHS, st.integers(1, 3), st.integers(0, 9))


@example([(5, 14, 1, 9), (5, 30, 1, 2)], 0, 5, None)
@given(st.lists(RECORD, max_size=8), st.integers(0, 9), st.integers(0, 9), st.sampled_from([["/1"], ["/2"], None]))
def test_a_window_gives_what_the_whole_gives_within_it(
    records: list[tuple[int, int, int, int]], first: int, last: int, topics: list[str] | None
) -> None:
    content = b"".join(
        struct.pack("<BQ", opcode, length) + struct.pack("<HIQ16x", channel, 0, log_ns)[:length]
        for opcode, length, channel, log_ns in records
    )
    whole = [
        (message.channel.id, message.log_ns, bytes(message.data))
        for message in messages(content, wanted(CHANNELS, None, None, None)).found
        if first <= message.log_ns <= last and (topics is None or message.channel.topic in topics)
    ]
    part = messages(content, wanted(CHANNELS, topics, first, last)).found
    assert [(message.channel.id, message.log_ns, bytes(message.data)) for message in part] == whole
