# SPDX-License-Identifier: BSD-3-Clause
"""Relayed messages as segments: joined again whatever the order, and never of wrong parts."""
import io
import random
import zlib
from typing import Any, List, Optional, Sequence, Type

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from relay_frames import relay_frame
from std_msgs.msg import Empty, String
from texts import noise

from smokebot_udp.msg import RelaySegment
from smokebot_udp.packed import MAX_DEFLATED
from smokebot_udp.streams.relay.parts import MAX_MESSAGE_SIZE, MAX_PARTIALS, PartJoiner
from smokebot_udp.udpros.datagram import OVERHEAD


def serialised(message: Any) -> bytes:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def segments(message: Any, max_datagram_size: int = 256, first: int = 1) -> List[RelaySegment]:
    """The segments of a message, numbered as its publisher does."""
    frame = relay_frame(message, max_datagram_size)
    assert frame.datagram_size <= max_datagram_size
    frame.records['header']['seq'] = (first + np.arange(len(frame))) % (1 << 32)
    return [RelaySegment().deserialize(row[OVERHEAD:].tobytes()) for row in frame.rows]


def joined(joiner: PartJoiner, some: Sequence[RelaySegment]) -> List[bytes]:
    results: List[Optional[bytes]] = [joiner.add(segment) for segment in some]
    return [data for data in results if data is not None]


def test_bytes_on_the_wire() -> None:
    frame = relay_frame(String('abcdefg'), OVERHEAD + 38 + 5)    # 12 bytes in three segments of 4
    checksum = zlib.crc32(b'\0\x07\0\0\0abcdefg', zlib.crc32(b'992ce8a1687cec8c8bd883ec73ca41d1'))
    head = bytes(16) + bytes(4) + checksum.to_bytes(4, 'little') + b'\x0c\0\0\0'
    assert [row[OVERHEAD:].tobytes() for row in frame.rows] == [
        head + b'\0\0' + b'\x04\0\0\0' + b'\0\x07\0\0' + bytes(4), head + b'\1\0' + b'\x04\0\0\0' + b'\0abc' + bytes(4),
        head + b'\2\0' + b'\x04\0\0\0' + b'defg' + bytes(4)]


def test_what_zlib_shortens_is_sent_shortened() -> None:
    message = Odometry()
    message.pose.pose.position.x = 0.1
    segment, = segments(message, 1472)
    assert zlib.decompress(segment.data[1:]) == serialised(message) and segment.data[:1] == b'\1'
    assert len(segment.data) < 80 < 600 < len(serialised(message))
    for length in (100, 70000):     # too short to gain much; too long to try
        plain = segments(String('x' * length), 1472)
        assert b''.join(one.data for one in plain).rstrip(b'\0') == b'\0' + serialised(String('x' * length))


@pytest.mark.parametrize('packed', [b'', b'\2abc', b'\1abc', b'\1' + zlib.compress(bytes(900))[:-5],
                                    b'\1' + zlib.compress(bytes(MAX_DEFLATED + 1)),
                                    b'\1' + zlib.compress(bytes(900)) + b'more'])
def test_what_was_not_packed_is_dropped(packed: bytes) -> None:
    checksum = zlib.crc32(packed, zlib.crc32(String._md5sum.encode()))
    forged = RelaySegment(packed_size=len(packed), data=packed, checksum=checksum)
    joiner = PartJoiner(String)
    assert joiner.add(forged) is None and joiner.dropped == {'packing': 1}


@given(st.integers(0, 3000), st.integers(64, 1472), st.integers(0, 2 ** 32 - 1), st.randoms(use_true_random=False))
@settings(deadline=None)
def test_any_message_in_any_order(length: int, datagram: int, first: int, order: random.Random) -> None:
    message = String(noise(length, first))
    shuffled = segments(message, datagram, first)
    order.shuffle(shuffled)
    joiner = PartJoiner(String)
    assert joined(joiner, shuffled) == [serialised(message)] and not joiner.dropped


def test_an_empty_message_takes_a_segment() -> None:
    segment, = segments(Empty())
    assert (segment.packed_size, segment.data) == (1, b'\0') and joined(PartJoiner(Empty), [segment]) == [b'']


def test_a_lost_segment_costs_its_message_only() -> None:
    joiner = PartJoiner(String)
    messages = [String(noise(500, seed)) for seed in range(4)]
    sent = [segments(message, first=10 * number) for number, message in enumerate(messages)]
    some = sent[0] + sent[1][1:] + sent[2][:-1] + sent[3]
    assert joined(joiner, some) == [serialised(messages[0]), serialised(messages[3])]
    assert joiner.dropped == {'incomplete': len(sent[1]) - 1}


def test_messages_that_overlap_are_both_joined() -> None:
    messages = String(noise(500, 1)), String(noise(500, 2))
    first, second = segments(messages[0]), segments(messages[1], first=10)
    woven = [segment for pair in zip(first, second) for segment in pair]
    assert joined(PartJoiner(String), woven) == [serialised(message) for message in messages]


def test_memory_is_bounded() -> None:
    joiner = PartJoiner(String)
    for first in range(0, 1000, 10):
        joiner.add(segments(String(noise(500)), first=first)[0])
    assert joiner.dropped['incomplete'] == 100 - MAX_PARTIALS


@pytest.mark.parametrize('change', [{'part': 9}, {'packed_size': MAX_MESSAGE_SIZE + 2}, {'data': b''},
                                    {'packed_size': 0}])
def test_impossible_segments_are_dropped(change: Any) -> None:
    joiner, forged = PartJoiner(String), segments(String(noise(500)))[1]
    for name, value in change.items():
        setattr(forged, name, value)
    assert joiner.add(forged) is None and joiner.dropped == {'part': 1}


def test_a_long_single_segment_is_dropped() -> None:
    joiner, forged = PartJoiner(String), segments(String('x'))[0]
    forged.data += b'more'
    assert joiner.add(forged) is None and joiner.dropped == {'part': 1}


@pytest.mark.parametrize('class_', [Odometry, Empty])
def test_a_message_of_another_type_is_dropped(class_: Type[Any]) -> None:
    joiner = PartJoiner(class_)
    assert joined(joiner, segments(String(noise(500)))) == []
    assert joiner.dropped == {'checksum': len(segments(String(noise(500))))}


def test_a_changed_byte_is_noticed() -> None:
    joiner, some = PartJoiner(String), segments(String(noise(500)))
    some[1].data = b'y' + some[1].data[1:]
    assert joined(joiner, some) == [] and joiner.dropped == {'checksum': len(some)}


def test_too_long_a_message_is_refused() -> None:
    with pytest.raises(ValueError, match='it has 16777221 bytes, which take [0-9]+ datagrams; must be 16777216 bytes'):
        relay_frame(String('x' * (MAX_MESSAGE_SIZE + 1)), 1472)
    with pytest.raises(ValueError, match='65536 datagrams at most'):
        relay_frame(String('x' * (1 << 22)), 100)
