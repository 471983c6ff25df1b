# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List, Tuple

import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from evaluation.offline_link import operator_side
from smokebot_udp.streams.relay.transforms import MAX_PAIRS


def transforms(*pairs: Tuple[str, str], x: float = 0.0) -> TFMessage:
    message = TFMessage()
    for parent, child in pairs:
        one = TransformStamped(child_frame_id=child)
        one.header.frame_id, one.transform.translation.x = parent, x
        message.transforms.append(one)
    return message


def forwarded(assembler: Any, *messages: Any) -> List[Any]:
    results = [assembler.forward(message) for message in messages]
    return [assembled.message for assembled in results if assembled is not None]


def test_latched_transforms_are_published_with_all_before_them_and_once() -> None:
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
        assert type(message) is assembler.MESSAGE is assembler.SEGMENT and assembler.STEADY and not assembler.LATCH


def test_stamps() -> None:
    odometry, assembler = Odometry(), operator_side('relay', message_type='nav_msgs/Odometry')[0]
    odometry.header.stamp.secs = 7
    assembled = assembler.forward(odometry)
    assert assembled is not None and (assembled.stamp, assembled.completeness) == (7 * 10 ** 9, None)
    unstamped = operator_side('relay', message_type='std_msgs/String')[0].forward(String())
    assert unstamped is not None and unstamped.stamp == 0


def test_frames_are_bounded_and_those_known_go_on() -> None:
    assembler, _ = operator_side('relay', message_type='tf2_msgs/TFMessage', latch=True)
    published = forwarded(assembler, transforms(*(('map', str(k)) for k in range(MAX_PAIRS + 2))))
    assert len(published[0].transforms) == MAX_PAIRS
    assert len(assembler.warnings) == 1 and '%d pairs' % MAX_PAIRS in assembler.warnings[0]
    last, = forwarded(assembler, transforms(('map', '5'), x=3.0))
    assert [one.transform.translation.x for one in last.transforms if one.child_frame_id == '5'] == [3.0]


def test_a_message_type_that_is_none_makes_no_stream() -> None:
    with pytest.raises(ValueError, match="message_type 'gas_msgs/None'"):
        operator_side('relay', message_type='gas_msgs/None')
