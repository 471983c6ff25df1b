# SPDX-License-Identifier: BSD-3-Clause
import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from smokebot_udp.streams.relay import MAX_PAIRS, Merged, message_class, size_of


def transforms(*pairs, x=0.0):
    message = TFMessage()
    for parent, child in pairs:
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.transform.translation.x = parent, x
        message.transforms.append(one)
    return message


def names(messages):
    return [[one.child_frame_id for one in message.transforms] for message in messages]


@pytest.mark.parametrize('name', ['no_such_msgs/Thing', 'std_msgs', '', 'std_msgs/NoSuchThing'])
def test_unknown_types_are_refused(name):
    with pytest.raises(ValueError, match='is no message type that is installed here'):
        message_class(name)


def test_only_the_newest_message_goes():
    merged = Merged('nav_msgs/Odometry', keep=False)
    for child in ('old', 'new'):
        merged.add(Odometry(child_frame_id=child))
    assert [message.child_frame_id for message in merged.take(1460)] == ['new']
    assert merged.take(1460) == []


def test_of_transforms_the_newest_of_each_pair():
    merged = Merged('tf2_msgs/TFMessage', keep=False)
    merged.add(transforms(('map', 'odom')))
    merged.add(transforms(('odom', 'base'), x=1.0))
    merged.add(transforms(('map', 'odom'), x=2.0))
    message, = merged.take(1460)
    assert {one.child_frame_id: one.transform.translation.x for one in message.transforms} == {'odom': 2.0, 'base': 1.0}
    assert merged.take(1460) == []


def test_what_is_latched_is_sent_again():
    merged = Merged('tf2_msgs/TFMessage', keep=True)
    merged.add(transforms(('base', 'laser')))
    merged.add(transforms(('base', 'camera')))
    assert names(merged.take(1460)) == names(merged.take(1460)) == [['laser', 'camera']]


def test_groups_fit_a_datagram_and_one_too_large_goes_alone():
    merged = Merged('tf2_msgs/TFMessage', keep=False)
    merged.add(transforms(*(('map', 'frame %d' % k) for k in range(40)), ('map', 'x' * 2000)))
    messages = merged.take(1460)
    assert sum(map(len, names(messages))) == 41
    assert [size_of(message) <= 1460 for message in messages] == [True] * (len(messages) - 1) + [False]


def test_frames_are_bounded():
    merged = Merged('tf2_msgs/TFMessage', keep=True)
    merged.add(transforms(*(('map', str(k)) for k in range(MAX_PAIRS))))
    merged.add(transforms(('map', '5'), x=1.0))
    with pytest.raises(ValueError, match='more than %d pairs' % MAX_PAIRS):
        merged.add(transforms(('map', 'one more')))
