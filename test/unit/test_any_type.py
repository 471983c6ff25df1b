# SPDX-License-Identifier: BSD-3-Clause
"""Sources whose type is found when their messages come."""
from typing import Any, List

import pytest
from genpy import Time
from polling import wait_for
from robot_stream_case import logged, make  # noqa: F401: fixtures
from rospy import AnyMsg
from sensor_msgs.msg import CompressedImage, Image, LaserScan

from smokebot_udp.msg import ScanSegment
from smokebot_udp.nodes.any_type import class_of, read
from smokebot_udp.serialised import serialised
from smokebot_udp.streams.encoder import Encoder

CLASSES = [Image, CompressedImage]


def any_message(message: Any, **header: Any) -> Any:
    found = AnyMsg()
    found.deserialize(serialised(message))
    found._connection_header = {'type': message._type, 'md5sum': message._md5sum, **header}
    return found


@pytest.mark.parametrize('message', [Image(data=b'abc', encoding='mono8'), CompressedImage(format='jpeg', data=b'ab')])
def test_messages_become_their_type(message: Any) -> None:
    for received in (message, any_message(message)):
        assert read(received, class_of(received, CLASSES)) == message


@pytest.mark.parametrize('message, problem', [
    (any_message(LaserScan()), 'it is sensor_msgs/LaserScan, must be sensor_msgs/Image or sensor_msgs/CompressedImage'),
    (LaserScan(), 'it is sensor_msgs/LaserScan'), (any_message(Image(), md5sum='0'), 'it is sensor_msgs/Image')])
def test_other_types_are_named(message: Any, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        class_of(message, CLASSES)


def test_bytes_of_no_message_are_refused() -> None:
    message = any_message(Image(data=b'abc'))
    message._buff = message._buff[:9]
    with pytest.raises(ValueError, match='it is no sensor_msgs/Image'):
        read(message, Image)


class Either(Encoder[Any]):
    MESSAGE, SEGMENTS, ACCEPTED = Image, {'segments': ScanSegment}, CLASSES
    taken: List[Any] = []

    def takes(self, message: Any) -> bool:
        return isinstance(message, Image)

    def encode(self, message: Any, settings: Any, max_datagram_size: int) -> List[Any]:
        self.taken.append(message)
        return []


def test_a_stream_follows_a_source_that_changes_its_type(make: Any, logged: List[str]) -> None:  # noqa: F811
    made = make(Either)
    assert made.source.message_class is AnyMsg
    assert made.stream.source.type == 'sensor_msgs/Image or sensor_msgs/CompressedImage'
    callback = made.source.args[0]
    callback(any_message(LaserScan()))
    assert made.stream.received == 0 and 'it is sensor_msgs/LaserScan, must be' in logged[0]
    message = CompressedImage(format='jpeg')
    message.header.stamp = Time(3)
    callback(any_message(message))
    wait_for(lambda: Either.taken == [message])
    assert made.stream.received == 1
