# SPDX-License-Identifier: BSD-3-Clause
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from smokebot_udp.mission.parameters import check
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.relay import MAX_PAIRS, Merged, RelayReceiver, RelaySender, message_class, size_of


def transforms(*pairs, x=0.0):
    message = TFMessage()
    for parent, child in pairs:
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.transform.translation.x = parent, x
        message.transforms.append(one)
    return message


def names(messages):
    return [[one.child_frame_id for one in message.transforms] for message in messages]


@pytest.mark.parametrize('name', ['no_such_msgs/Thing', 'std_msgs', '', 'std_msgs/NoSuchThing', 'a/b/c', '/',
                                  'nav_msgs/', 'os/path'])
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


def test_frames_that_are_known_go_on_where_there_are_too_many():
    merged = Merged('tf2_msgs/TFMessage', keep=True)
    merged.add(transforms(*(('map', str(k)) for k in range(MAX_PAIRS))))
    with pytest.raises(ValueError):
        merged.add(transforms(('odom', '5')))       # another parent makes another pair
    merged.add(transforms(('map', '5'), x=3.0))
    all_there_is, = merged.take(float('inf'))
    assert [one.transform.translation.x for one in all_there_is.transforms if one.child_frame_id == '5'] == [3.0]
    assert len(all_there_is.transforms) == MAX_PAIRS


def test_a_latched_message_is_sent_again_until_a_newer_one():
    merged = Merged('nav_msgs/Odometry', keep=True)
    assert merged.take(1460) == []
    for child in ('old', 'new'):
        merged.add(Odometry(child_frame_id=child))
        assert [[message.child_frame_id for message in merged.take(1460)] for _ in range(2)] == [[child]] * 2


@given(st.lists(st.integers(0, 400), max_size=30), st.integers(10, 1000))
def test_groups_are_as_few_as_fit_in_order(lengths, room):
    merged = Merged('tf2_msgs/TFMessage', keep=False)
    merged.add(transforms(*((str(k), 'x' * length) for k, length in enumerate(lengths))))
    messages = merged.take(room)
    parents = [[int(one.header.frame_id) for one in message.transforms] for message in messages]
    assert sum(parents, []) == list(range(len(lengths))) and all(parents)
    assert all(size_of(message) <= room or len(message.transforms) == 1 for message in messages)
    for message, following in zip(messages, messages[1:]):
        assert size_of(message) + size_of(following.transforms[0]) > room


def relay(kind, **settings):
    topic = 'robot_topic' if kind is RelaySender else 'operator_topic'
    return kind('relay', check({topic: '/t', **settings}, kind.PARAMETERS), Link(1472))


def test_a_message_type_that_is_none_makes_no_stream():
    with pytest.raises(ValueError, match="message_type 'gas_msgs/None'"):
        relay(RelaySender, message_type='gas_msgs/None')


class Published(list):
    """Stands in for a sender's publisher."""

    def get_num_connections(self):
        return 1

    publish = list.append

    @property
    def impl(self):
        return SimpleNamespace(seq=len(self))


def test_many_publishers_transforms_go_in_one_datagram():
    stream = relay(RelaySender, message_type='tf2_msgs/TFMessage')
    stream._publisher = Published()
    for pair in (('map', 'odom'), ('odom', 'base'), ('base', 'arm')):
        stream._receive(transforms(pair))
    stream._send(True)
    stream._send(True)
    assert names(stream._publisher) == [['odom', 'base', 'arm']] and stream.sent == 1


def test_nothing_is_kept_for_nobody_but_what_is_latched():
    for latch in (False, True):
        stream = relay(RelaySender, message_type='nav_msgs/Odometry', latch=latch, enabled=False)
        stream._publisher = Published()
        stream._receive(Odometry())
        stream._send(True)
        stream.configure({'enabled': True})
        assert stream._publisher == []
        stream._send(True)
        assert len(stream._publisher) == latch


def test_latched_transforms_are_shown_with_all_before_them_and_once():
    stream, shown = relay(RelayReceiver, message_type='tf2_msgs/TFMessage', latch=True), []
    stream.publish = lambda message, stamp: shown.append(message)
    for message in (transforms(('base', 'laser')), transforms(('base', 'camera')), transforms(('base', 'laser')),
                    transforms(('base', 'laser'), x=1.0)):
        stream._take(message)
    assert names(shown) == [['laser'], ['laser', 'camera'], ['laser', 'camera']]
    assert shown[-1].transforms[0].transform.translation.x == 1.0
