# SPDX-License-Identifier: BSD-3-Clause
"""Relay streams: both sides, and the transforms that they merge."""
import zlib
from typing import Any, Iterable, List, Tuple

import pytest
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from relay_frames import relay_frame
from sensor_msgs.msg import JointState, Range
from std_msgs.msg import Float32, String
from texts import noise
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from evaluation.linked_encoder import LinkedEncoder
from evaluation.offline_link import operator_side
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import RelaySegment
from smokebot_udp.streams.relay.contents import MAX_CONTENTS, Contents, size_of, stamp_of
from smokebot_udp.streams.relay.encoder import (
    LIMITED_MESSAGES,
    MAX_PROTECTED_DATAGRAMS,
    MAX_PROTECTED_TOGETHER,
    RelayEncoder,
)
from smokebot_udp.streams.relay.parts import MAX_MESSAGE_SIZE, PartJoiner
from smokebot_udp.udpros.datagram import IP_UDP_HEADERS, OVERHEAD
from smokebot_udp.udpros.frame import Frame


def transforms(*pairs: Tuple[str, str], x: float = 0.0) -> Any:
    message = TFMessage()
    for parent, child in pairs:
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.transform.translation.x = parent, x
        message.transforms.append(one)
    return message


def names(messages: Any) -> List[List[str]]:
    return [[one.child_frame_id for one in message.transforms] for message in messages]


def set_of(*messages: Any) -> Contents:
    made = Contents(TFMessage)
    for message in messages:
        made.add(message)
    return made


# transforms

def test_of_transforms_the_newest_of_each_frame() -> None:
    message, = set_of(transforms(('map', 'odom')), transforms(('odom', 'base'), x=1.0),
                      transforms(('map', 'odom'), x=2.0)).messages(1460)
    assert {one.child_frame_id: one.transform.translation.x for one in message.transforms} == {'odom': 2.0, 'base': 1.0}
    assert Contents(TFMessage).messages(1460) == []


def test_groups_fit_a_datagram_and_one_too_large_goes_alone() -> None:
    messages = set_of(transforms(*(('map', 'frame %d' % k) for k in range(40)), ('map', 'x' * 2000))).messages(1460)
    assert sum(map(len, names(messages))) == 41
    assert [size_of(message) <= 1460 for message in messages] == [True] * (len(messages) - 1) + [False]


def test_frames_of_a_set_are_bounded_and_known_ones_go_on() -> None:
    full = set_of(transforms(*(('map', str(k)) for k in range(MAX_CONTENTS))))
    full.add(transforms(('map', '5'), x=1.0))
    assert full.add(transforms(('map', 'one more'), ('odom', '5'), ('map', '7'), x=2.0)) == (
        'more than %d names in one topic: one more is left out' % MAX_CONTENTS)
    assert full.add(transforms(('map', '8'), x=3.0)) == ''
    everything, = full.messages(float('inf'))
    moved = {one.child_frame_id: one.transform.translation.x for one in everything.transforms}
    assert (moved['5'], moved['7'], moved['8']) == (2.0, 2.0, 3.0) and len(everything.transforms) == MAX_CONTENTS


@given(st.lists(st.integers(0, 400), max_size=30), st.integers(10, 1000))
def test_groups_are_as_few_as_fit_in_order(lengths: List[int], room: int) -> None:
    messages = set_of(transforms(*((str(k), '%d%s' % (k, 'x' * length)) for k, length in enumerate(lengths)))
                      ).messages(room)
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
    return LinkedEncoder(RelayEncoder(settings.requested)), settings


def segments_of(frame: Frame) -> List[RelaySegment]:
    return [RelaySegment().deserialize(row[OVERHEAD:].tobytes()) for row in frame.rows]


def messages_of(encoder: RelayEncoder, frames: Iterable[Frame]) -> List[Any]:
    """The messages that frames carry."""
    whole = []
    for frame in frames:
        frame.records['header']['seq'] = range(len(frame))
        joiner = PartJoiner(encoder.MESSAGE)
        *others, data = (joiner.add(segment) for segment in segments_of(frame))
        assert data is not None and not any(others)
        whole.append(encoder.MESSAGE().deserialize(data))
    return whole


def sent(encoder: RelayEncoder, settings: Settings, message: Any, size: int = 1472) -> List[Frame]:
    return encoder.encode(encoder.merge(None, message), settings, size)


def encoded(encoder: RelayEncoder, settings: Settings, *messages: Any) -> List[Any]:
    waiting = None
    for message in messages:
        waiting = encoder.merge(waiting, message)
    return messages_of(encoder, encoder.encode(waiting, settings, 1472))


def repeated(encoder: RelayEncoder, settings: Settings) -> List[Any]:
    return messages_of(encoder, encoder.repeat(settings, 1472))


def test_a_message_type_that_is_none_makes_no_stream() -> None:
    with pytest.raises(ValueError, match="message_type 'gas_msgs/None'"):
        relay('gas_msgs/None')


def test_only_the_newest_message_goes_and_as_it_is() -> None:
    encoder, settings = relay('nav_msgs/Odometry')
    message, = encoded(encoder, settings, Odometry(child_frame_id='old'), Odometry(child_frame_id='new'))
    assert message == Odometry(child_frame_id='new') and encoder.MESSAGE is Odometry
    assert not encoder.traits.keeps and encoder.traits.steady and encoder.repeat_period(settings) is None
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
    frames = sent(encoder, settings, many, 500)
    assert len(frames) > 3 and {len(frame) for frame in frames} == {1}
    assert max(frame.datagram_size for frame in frames) <= 500


def test_latched_transforms_are_sent_with_all_before_them_and_again() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=True)
    assert encoder.traits.keeps and not encoder.traits.steady and repeated(encoder, settings) == []
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
def test_too_many_frames_are_reported_and_the_others_sent(latch: bool) -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=latch)
    messages = encoded(encoder, settings, transforms(*(('map', str(k)) for k in range(MAX_CONTENTS + 1))))
    assert sum(map(len, names(messages))) == MAX_CONTENTS
    assert encoder.warnings.popleft() == 'more than %d names in one topic: %d is left out' % (MAX_CONTENTS,
                                                                                               MAX_CONTENTS)


def test_latched_frames_are_bounded_over_all_messages() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=True)
    half = MAX_CONTENTS // 2 + 1
    for begin in (0, half):
        messages = encoded(encoder, settings, transforms(*(('map', str(begin + k)) for k in range(half))))
    assert sum(map(len, names(messages))) == MAX_CONTENTS and 'more than' in encoder.warnings.popleft()


def test_repeats_come_no_faster_than_messages_may() -> None:
    for rate, repeat_rate, period in ((10.0, 2.0, 0.5), (0.5, 2.0, 2.0)):
        encoder, settings = relay('tf2_msgs/TFMessage', latch=True, rate=rate, repeat_rate=repeat_rate)
        assert encoder.repeat_period(settings) == period


def test_short_messages_are_repeated_less_and_less_often() -> None:
    encoder, settings = relay('std_msgs/String', latch=True, rate=10.0)

    def periods(count: int) -> List[Any]:
        found = []
        for _ in range(count):
            found.append(encoder.repeat_period(settings))
            repeated(encoder, settings)
        return found

    encoded(encoder, settings, String('a'))
    assert periods(6) == [1.0, 2.0, 4.0, 5.0, 5.0, 5.0]
    encoded(encoder, settings, String('b'))
    assert periods(3) == [1.0, 2.0, 4.0]
    encoder.joined()
    assert periods(2000)[:4] == [1.0, 2.0, 4.0, 5.0]
    encoder.encode(encoder.merge(None, String(noise(3000))), settings, 1472)     # useless without all of its datagrams
    for _ in range(5):
        assert encoder.repeat_period(settings) == 1.0 and len(encoder.repeat(settings, 1472)[0]) == 2
    encoder, slow = relay('std_msgs/String', latch=True, repeat_rate=0.1)
    encoded(encoder, slow, String('a'))
    repeated(encoder, slow)
    assert encoder.repeat_period(slow) == 10.0


# messages of many datagrams

def test_only_short_messages_are_protected() -> None:
    encoder, settings = relay('std_msgs/String')
    sent(encoder, settings, String(noise(1400 * MAX_PROTECTED_DATAGRAMS)))
    assert encoder.protected
    for length in 2000 * MAX_PROTECTED_DATAGRAMS, 1:    # another message would overtake what is left of a long one
        sent(encoder, settings, String(noise(length)))
        assert not encoder.protected
    assert relay('std_msgs/String')[0].protected


def test_a_long_message_is_warned_of_once_and_again_where_it_is_twice_as_long() -> None:
    encoder, settings = relay('std_msgs/String')
    for length in 100, 2000, 2001, 1500, 100000, 100001:
        sent(encoder, settings, String(noise(length)))
    assert list(encoder.warnings) == ['a message takes %d datagrams, and is lost if one of them is' % datagrams
                                      for datagrams in (2, 71)]


def test_a_share_that_is_too_small_is_warned_of_once() -> None:
    encoder, settings = relay('std_msgs/String')
    limited = Settings(settings.requested, {'rate': 3.0})
    for now in (settings, limited, settings, *[limited] * (LIMITED_MESSAGES - 1)):
        sent(encoder, now, String('x' * 100000))
    encoder.warnings.popleft()
    assert not encoder.warnings
    for _ in range(3 * LIMITED_MESSAGES):
        sent(encoder, limited, String('x' * 100000))
    assert list(encoder.warnings) == ['its share of the link is too small for all messages: fewer are sent, the newest']


def test_what_a_relay_costs() -> None:
    encoder, settings = relay('std_msgs/String', rate=8.0)
    assert encoder.operating_points(8.0, settings) == []
    frame, = sent(encoder, settings, String('x' * 100000))
    points = encoder.operating_points(8.0, settings)
    assert [points[at].settings for at in (0, -1)] == [{'rate': pytest.approx(1.0)}, {'rate': 8.0}]
    assert points[-1].cost == 8.0 * len(frame) * (frame.datagram_size + IP_UDP_HEADERS)


def test_what_a_latched_relay_costs_are_its_repeats() -> None:
    encoder, settings = relay('std_msgs/String', rate=8.0, repeat_rate=2.0, latch=True)
    assert encoder.operating_points(8.0, settings) == []
    frame, = sent(encoder, settings, String('x' * 100000))
    points = encoder.operating_points(8.0, settings)
    assert [points[at].settings for at in (0, -1)] == [{'repeat_rate': pytest.approx(0.2)}, {'repeat_rate': 2.0}]
    assert points[-1].cost == 2.0 * len(frame) * (frame.datagram_size + IP_UDP_HEADERS)


# the assembler

def forwarded(assembler: Any, *messages: Any) -> List[Any]:
    results = [assembler.forward(message) for message in messages]
    return [assembled.message for assembled in results if assembled is not None]


def test_received_latched_transforms_are_published_with_all_before_them_and_once() -> None:
    assembler, _ = operator_side('relay', message_type='tf2_msgs/TFMessage', latch=True)
    published = forwarded(assembler, transforms(('base', 'laser')), transforms(('base', 'camera')),
                          transforms(('base', 'laser')), transforms(('base', 'laser'), x=1.0))
    assert [[one.child_frame_id for one in message.transforms] for message in published] == [
        ['laser'], ['laser', 'camera'], ['laser', 'camera']]
    assert published[-1].transforms[0].transform.translation.x == 1.0
    assert assembler.LATCH and not assembler.STEADY


def test_what_is_not_latched_passes_as_it_is() -> None:
    for message in transforms(('map', 'odom')), String('x'):
        message_type = message._type
        assembler, _ = operator_side('relay', message_type=message_type)
        assert forwarded(assembler, message, message) == [message, message]
        assert type(message) is assembler.MESSAGE and assembler.STEADY and not assembler.LATCH


def test_stamps() -> None:
    odometry, assembler = Odometry(), operator_side('relay', message_type='nav_msgs/Odometry')[0]
    odometry.header.stamp.secs = 7
    assembled = assembler.forward(odometry)
    assert assembled is not None and (assembled.stamp, assembled.completeness) == (7 * 10 ** 9, None)
    unstamped = operator_side('relay', message_type='std_msgs/String')[0].forward(String())
    assert unstamped is not None and unstamped.stamp == 0


def test_frames_are_bounded_and_those_known_go_on() -> None:
    assembler, _ = operator_side('relay', message_type='tf2_msgs/TFMessage', latch=True)
    published = forwarded(assembler, transforms(*(('map', str(k)) for k in range(MAX_CONTENTS + 2))))
    assert len(published[0].transforms) == MAX_CONTENTS
    assert len(assembler.warnings) == 1 and 'more than %d names' % MAX_CONTENTS in assembler.warnings[0]
    last, = forwarded(assembler, transforms(('map', '5'), x=3.0))
    assert [one.transform.translation.x for one in last.transforms if one.child_frame_id == '5'] == [3.0]


def test_a_message_is_joined_from_its_segments() -> None:
    assembler, _ = operator_side('relay', message_type='std_msgs/String')
    message = String(noise(5000))
    segments = segments_of(relay_frame(message, 1472))
    assert len(segments) == 3
    for number, segment in enumerate(segments):
        segment.header.seq = number
        assert assembler.join(segment) == ([message] if number == 2 else [])


def test_segments_that_are_no_message_are_dropped() -> None:
    assembler, _ = operator_side('relay', message_type='std_msgs/String')
    other, = segments_of(relay_frame(Float32(), 1472))
    assert assembler.join(other) == [] and assembler.dropped == {'checksum': 1}
    assert assembler.warnings == ['a message is not a std_msgs/String as it is installed here']
    forged, = segments_of(relay_frame(String('x'), 1472))
    forged.packed_size, forged.data = 3, b'\0\1\0'     # no whole string
    forged.checksum = zlib.crc32(forged.data, zlib.crc32(String._md5sum.encode()))
    assert assembler.join(forged) == [] and assembler.dropped['message'] == 1


def test_an_unknown_message_type_makes_no_assembler() -> None:
    with pytest.raises(ValueError, match="message_type 'gas_msgs/None'"):
        operator_side('relay', message_type='gas_msgs/None')


# several things in one topic

def test_a_frame_that_moves_to_another_parent_and_back_is_where_it_was_put_last() -> None:
    encoder, settings = relay('tf2_msgs/TFMessage', latch=True)
    assembler, _ = operator_side('relay', message_type='tf2_msgs/TFMessage', latch=True)
    for parent in 'table', 'gripper', 'table':
        messages = encoded(encoder, settings, transforms((parent, 'cup')), transforms(('base', 'laser')))
        assert messages == repeated(encoder, settings)
        shown = forwarded(assembler, *messages)[-1]
        assert {one.child_frame_id: one.header.frame_id for one in shown.transforms} == {
            'cup': parent, 'laser': 'base'}
        assert len(shown.transforms) == 2


def test_a_frame_has_one_name_with_and_without_its_slash() -> None:
    message, = set_of(transforms(('map', '/laser')), transforms(('base', 'laser'))).messages(1460)
    assert [(one.header.frame_id, one.child_frame_id) for one in message.transforms] == [('base', 'laser')]


def test_the_newest_range_of_each_sonar_crosses() -> None:
    encoder, settings = relay('sensor_msgs/Range')
    waiting = None
    for beam in range(3):
        for number in range(8):
            one = Range(range=beam)
            one.header.frame_id = 'sonar%d' % number
            waiting = encoder.merge(waiting, one)
    frames = encoder.encode(waiting, settings, 1472)
    assert [(one.header.frame_id, one.range) for one in messages_of(encoder, frames)] == [
        ('sonar%d' % number, 2.0) for number in range(8)]
    assert encoder.protected and encoder.replaced == 16


def test_joints_of_several_controllers_cross() -> None:
    encoder, settings = relay('sensor_msgs/JointState')
    states = [JointState(name=names, position=[position] * len(names)) for position in (0.0, 1.0)
              for names in (['left', 'right'], ['shoulder', 'elbow', 'wrist'])]
    assert encoded(encoder, settings, *states) == states[2:]


def test_messages_of_several_publishers_cross_and_a_latched_one_is_the_last() -> None:
    for latch, expected in (False, ['a2', 'b1']), (True, ['a2']):
        encoder, settings = relay('std_msgs/String', latch=latch)
        messages = []
        for node, text in ('/a', 'a1'), ('/b', 'b1'), ('/a', 'a2'):
            messages.append(String(text))
            messages[-1]._connection_header = {'callerid': node}
        assert [one.data for one in encoded(encoder, settings, *messages)] == expected


def marker(number: int, action: int = Marker.ADD, space: str = '') -> Marker:
    return Marker(ns=space, id=number, action=action)


def test_markers_are_kept_until_all_are_deleted() -> None:
    encoder, settings = relay('visualization_msgs/MarkerArray', latch=True)
    assembler, _ = operator_side('relay', message_type='visualization_msgs/MarkerArray', latch=True)

    def after(*markers: Marker) -> List[Tuple[int, int]]:
        messages = encoded(encoder, settings, MarkerArray(markers=list(markers)))
        assert messages == repeated(encoder, settings)
        shown, = forwarded(assembler, *messages)
        assert forwarded(assembler, *messages) == []
        return [(one.id, one.action) for one in shown.markers]

    assert after(marker(0), marker(1)) == [(0, Marker.ADD), (1, Marker.ADD)]
    assert after(marker(1, Marker.DELETE), marker(2)) == [(0, Marker.ADD), (1, Marker.DELETE), (2, Marker.ADD)]
    assert after(marker(0, Marker.DELETEALL), marker(0)) == [(0, Marker.DELETEALL), (0, Marker.ADD)]
    assert after(marker(3)) == [(0, Marker.DELETEALL), (0, Marker.ADD), (3, Marker.ADD)]


def test_single_markers_cross_each() -> None:
    encoder, settings = relay('visualization_msgs/Marker')
    assert encoded(encoder, settings, marker(0), marker(1), marker(0, Marker.DELETE), marker(0, space='x')) == [
        marker(0, Marker.DELETE), marker(1), marker(0, space='x')]
    assert encoded(encoder, settings, marker(1), marker(0, Marker.DELETEALL), marker(0)) == [
        marker(0, Marker.DELETEALL), marker(0)]


def test_many_messages_at_a_time_are_not_protected() -> None:
    encoder, settings = relay('visualization_msgs/Marker')
    waiting = None
    for number in range(MAX_PROTECTED_TOGETHER + 1):
        assert encoder.protected
        waiting = encoder.merge(waiting, marker(number))
    assert len(encoder.encode(waiting, settings, 1472)) == MAX_PROTECTED_TOGETHER + 1 and not encoder.protected


# one bad message does not spoil what is kept

@pytest.mark.parametrize('message_type, good, bad, better', [
    ('std_msgs/String', String('good'), String('x' * (MAX_MESSAGE_SIZE + 1)), String('better')),
    ('visualization_msgs/MarkerArray', MarkerArray(markers=[marker(0)]),
     MarkerArray(markers=[Marker(ns='map', text='x' * (MAX_MESSAGE_SIZE + 1))]), MarkerArray(markers=[marker(1)]))])
def test_a_latched_message_that_is_too_long_is_refused_and_the_one_before_goes_on(
        message_type: str, good: Any, bad: Any, better: Any) -> None:
    encoder, settings = relay(message_type, latch=True)
    encoded(encoder, settings, good)
    for _ in range(2):
        with pytest.raises(ValueError, match='must be %d bytes' % MAX_MESSAGE_SIZE):
            encoded(encoder, settings, bad)
        assert repeated(encoder, settings) == [good]
    newest, = encoded(encoder, settings, better)
    assert newest == (better if message_type == 'std_msgs/String' else MarkerArray(markers=[marker(0), marker(1)]))
