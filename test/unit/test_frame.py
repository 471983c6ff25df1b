# SPDX-License-Identifier: BSD-3-Clause
import io
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import Image, LaserScan
from std_msgs.msg import Empty, Header, String, UInt8MultiArray

from smokebot_udp.udpros.datagram import split
from smokebot_udp.udpros.frame import Frame
from smokebot_udp.udpros.records import LayoutError


def stream(message) -> Any:
    """A message as rospy writes it on a connection: its length before it."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return len(buffer.getvalue()).to_bytes(4, 'little') + buffer.getvalue()


def test_rows_are_the_datagrams_of_genpys_messages() -> None:
    frame = Frame(Image, 3, {'header.frame_id': 4, 'encoding': 5, 'data': 6})
    frame.records['header']['frame_id'] = np.frombuffer(b'lens', np.uint8)
    frame.records['encoding'] = np.frombuffer(b'mono8', np.uint8)
    frame.records['data'] = np.arange(18).reshape(3, 6)
    frame.records['height'] = 2
    frame.records['header']['seq'] = [7, 8, 9]
    frame.header['connection_id'], frame.header['message_id'] = 11, [254, 255, 1]
    images = [Image(Header(seq, Image().header.stamp, 'lens'), 2, 0, 'mono8', 0, 0, bytes(range(6 * i, 6 * i + 6)))
              for i, seq in enumerate((7, 8, 9))]
    assert frame.rows.shape == (len(frame), frame.datagram_size) == (3, 8 + len(stream(images[0])))
    assert [bytes(row) for row in frame.rows] == [
        bytes(split(stream(image), 11, message_id, 1472)) for image, message_id in zip(images, (254, 255, 1))]
    assert frame.stream() == b''.join(map(stream, images))


def test_a_frame_can_be_filled_again() -> None:
    frame = Frame(LaserScan, 2, {'ranges': 2})
    for value in (1, 2):
        frame.records['ranges'] = value
        assert frame.stream() == 2 * stream(LaserScan(ranges=[value, value]))


def test_a_part_is_a_frame_on_the_same_memory() -> None:
    frame = Frame(LaserScan, 5, {'ranges': 1})
    frame.records['ranges'][:, 0] = range(5)
    part = frame.part(1, 4)
    assert (len(part), part.datagram_size, part.message_class) == (3, frame.datagram_size, LaserScan)
    assert part.stream() == b''.join(stream(LaserScan(ranges=[value])) for value in (1, 2, 3))
    part.records['ranges'], part.header['message_id'] = 9, 7
    assert frame.records['ranges'].ravel().tolist() == [0, 9, 9, 9, 4]
    assert frame.header['message_id'].tolist() == [0, 7, 7, 7, 0]


def test_empty_messages() -> None:
    assert Frame(Empty, 2, {}).stream() == 2 * stream(Empty())
    assert Frame(String, 1, {}).stream() == stream(String())


def test_a_message_too_long_for_a_datagram() -> None:
    assert Frame(String, 1, {'data': 65507 - 16}).datagram_size == 65507
    with pytest.raises(ValueError, match='does not fit in a datagram'):
        Frame(String, 1, {'data': 65507 - 15})


@pytest.mark.parametrize('count', [0, -1])
def test_no_messages(count) -> None:
    with pytest.raises(ValueError, match='needs at least one message'):
        Frame(String, count, {})


def test_types_and_fields_without_a_layout() -> None:
    with pytest.raises(LayoutError):
        Frame(UInt8MultiArray, 1, {})
    with pytest.raises(LayoutError):
        Frame(String, 1, {'date': 5})
