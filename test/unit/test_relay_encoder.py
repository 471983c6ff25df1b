# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List, Tuple

import pytest
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from std_msgs.msg import Float32
from tf2_msgs.msg import TFMessage

from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.streams.relay.encoder import RelayEncoder
from smokebot_udp.streams.relay.transforms import MAX_PAIRS, TransformSet, message_class, size_of, stamp_of
from smokebot_udp.udpros.datagram import OVERHEAD


def transforms(*pairs: Tuple[str, str], x: float = 0.0) -> Any:
    message = TFMessage()
    for parent, child in pairs:
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.transform.translation.x = parent, x
        message.transforms.append(one)
    return message


def names(messages: Any) -> List[List[str]]:
    return [[one.child_frame_id for one in message.transforms] for message in messages]


def set_of(*messages: Any) -> TransformSet:
    made = TransformSet()
    for message in messages:
        made.add(message)
    return made


@pytest.mark.parametrize('name', ['no_such_msgs/Thing', 'std_msgs', '', 'std_msgs/NoSuchThing', 'a/b/c', '/',
                                  'nav_msgs/', 'os/path'])
def test_unknown_types_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match='is no message type that is installed here'):
        message_class(name)


# transforms

def test_of_transforms_the_newest_of_each_pair() -> None:
    message, = set_of(transforms(('map', 'odom')), transforms(('odom', 'base'), x=1.0),
                      transforms(('map', 'odom'), x=2.0)).messages(TFMessage, 1460)
    assert {one.child_frame_id: one.transform.translation.x for one in message.transforms} == {'odom': 2.0, 'base': 1.0}
    assert TransformSet().messages(TFMessage, 1460) == []


def test_groups_fit_a_datagram_and_one_too_large_goes_alone() -> None:
    messages = set_of(transforms(*(('map', 'frame %d' % k) for k in range(40)), ('map', 'x' * 2000))).messages(
        TFMessage, 1460)
    assert sum(map(len, names(messages))) == 41
    assert [size_of(message) <= 1460 for message in messages] == [True] * (len(messages) - 1) + [False]


def test_pairs_are_bounded_and_known_ones_go_on() -> None:
    full = set_of(transforms(*(('map', str(k)) for k in range(MAX_PAIRS))))
    full.add(transforms(('map', '5'), x=1.0))
    # another parent makes another pair
    with pytest.raises(ValueError, match='more than %d pairs of frames: odom to 5 is left out' % MAX_PAIRS):
        full.add(transforms(('odom', '5'), ('map', '7'), ('map', 'one more'), x=2.0))
    full.add(transforms(('map', '8'), x=3.0))
    everything, = full.messages(TFMessage, float('inf'))
    moved = {one.child_frame_id: one.transform.translation.x for one in everything.transforms}
    assert (moved['5'], moved['7'], moved['8']) == (1.0, 2.0, 3.0) and len(everything.transforms) == MAX_PAIRS


@given(st.lists(st.integers(0, 400), max_size=30), st.integers(10, 1000))
def test_groups_are_as_few_as_fit_in_order(lengths: List[int], room: int) -> None:
    messages = set_of(transforms(*((str(k), 'x' * length) for k, length in enumerate(lengths)))).messages(
        TFMessage, room)
    parents = [[int(one.header.frame_id) for one in message.transforms] for message in messages]
    assert sum(parents, []) == list(range(len(lengths))) and all(parents)
    assert all(size_of(message) <= room or len(message.transforms) == 1 for message in messages)
    for message, following in zip(messages, messages[1:]):
        assert size_of(message) + size_of(following.transforms[0]) > room


def test_the_stamp_of_a_message() -> None:
    odometry, both = Odometry(), transforms(('map', 'odom'), ('odom', 'base'))
    odometry.header.stamp.secs, both.transforms[0].header.stamp.secs = 5, 7
    assert stamp_of(odometry).secs == 5 and stamp_of(both).secs == 7
    assert stamp_of(Float32()) is None and stamp_of(TFMessage()) is None


# the encoder

def relay(message_type: str, **changes: Any) -> Tuple[RelayEncoder, Settings]:
    settings = Settings(check({'robot_topic': '/t', 'message_type': message_type, **changes}, RelayEncoder.PARAMETERS))
    return RelayEncoder(settings.requested), settings


def encoded(encoder: RelayEncoder, settings: Settings, *messages: Any) -> List[Any]:
    waiting = None
    for message in messages:
        waiting = encoder.merge(waiting, message)
    return encoder.encode(waiting, settings, 1460 + OVERHEAD)


def repeated(encoder: RelayEncoder, settings: Settings) -> List[Any]:
    return list(encoder.repeat(settings, 1460 + OVERHEAD))


def test_a_message_type_that_is_none_makes_no_stream() -> None:
    with pytest.raises(ValueError, match="message_type 'gas_msgs/None'"):
        relay('gas_msgs/None')


def test_only_the_newest_message_goes_and_as_it_is() -> None:
    encoder, settings = relay('nav_msgs/Odometry')
    message, = encoded(encoder, settings, Odometry(child_frame_id='old'), Odometry(child_frame_id='new'))
    assert message == Odometry(child_frame_id='new') and encoder.MESSAGE is encoder.SEGMENT is Odometry
    assert not encoder.KEEPS and encoder.STEADY and encoder.repeat_period(settings) is None
    assert repeated(encoder, settings) == []


def test_many_publishers_transforms_go_in_one_datagram() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage')
    messages = encoded(encoder, settings, *(transforms(pair) for pair in (
        ('map', 'odom'), ('odom', 'base'), ('base', 'arm'))))
    assert names(messages) == [['odom', 'base', 'arm']] and repeated(encoder, settings) == []
    assert names(encoded(encoder, settings, transforms(('base', 'leg')))) == [['leg']]


def test_groups_leave_room_for_the_transports_header() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage')
    many = transforms(*(('map', 'frame %d' % k) for k in range(40)))
    messages = encoder.encode(encoder.merge(None, many), settings, 500)
    assert len(messages) > 3 and max(map(size_of, messages)) + OVERHEAD <= 500


def test_latched_transforms_are_sent_with_all_before_them_and_again() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=True)
    assert encoder.KEEPS and not encoder.STEADY and repeated(encoder, settings) == []
    encoded(encoder, settings, transforms(('base', 'laser')))
    assert names(encoded(encoder, settings, transforms(('base', 'camera')))) == [['laser', 'camera']]
    assert [names(repeated(encoder, settings)) for _ in range(2)] == [[['laser', 'camera']]] * 2


def test_a_latched_message_is_sent_again_until_a_newer_one() -> None:
    encoder, settings = relay('nav_msgs/Odometry', latch=True)
    assert repeated(encoder, settings) == []
    for child in ('old', 'new'):
        assert [one.child_frame_id for one in encoded(encoder, settings, Odometry(child_frame_id=child))] == [child]
        assert [one.child_frame_id for one in repeated(encoder, settings)] == [child]


@pytest.mark.parametrize('latch', [False, True])
def test_too_many_pairs_are_reported_and_the_others_sent(latch: bool) -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=latch)
    messages = encoded(encoder, settings, transforms(*(('map', str(k)) for k in range(MAX_PAIRS + 1))))
    assert sum(map(len, names(messages))) == MAX_PAIRS
    assert encoder.warnings.popleft() == 'more than %d pairs of frames: map to %d is left out' % (MAX_PAIRS, MAX_PAIRS)


def test_latched_pairs_are_bounded_over_all_messages() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=True)
    for begin in (0, MAX_PAIRS // 2 + 1):
        messages = encoded(encoder, settings, transforms(*(('map', str(begin + k)) for k in range(MAX_PAIRS // 2 + 1))))
    assert sum(map(len, names(messages))) == MAX_PAIRS and 'more than' in encoder.warnings.popleft()


def test_repeats_come_no_faster_than_messages_may() -> None:
    for rate, repeat_rate, period in ((10.0, 2.0, 0.5), (0.5, 2.0, 2.0)):
        encoder, settings = relay('tf2_msgs/TFMessage', latch=True, rate=rate, repeat_rate=repeat_rate)
        assert encoder.repeat_period(settings) == period
