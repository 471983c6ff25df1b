# SPDX-License-Identifier: BSD-3-Clause
"""Short relayed messages are repeated, and published once and in order."""
import collections
import contextlib
import itertools
import random
from typing import Any, List, Sequence, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from std_msgs.msg import Float32, String
from texts import noise

from evaluation.linked_encoder import LinkedEncoder
from evaluation.offline_link import operator_side
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import RelaySegment
from smokebot_udp.packed import MAX_DEFLATED, pack_beside, unpack_beside
from smokebot_udp.serialised import serialised
from smokebot_udp.streams.relay.encoder import RelayEncoder
from smokebot_udp.streams.relay.repeats import COPIED_LOSS, MAX_REORDERING, MessageOrder
from smokebot_udp.streams.repetition_budget import MAX_UNUSED, RESERVED, SHARE, SPAN, UNUSED_SHARE, RepetitionBudget
from smokebot_udp.udpros.datagram import OVERHEAD


class Robot:
    """Sends a relay's messages."""

    def __init__(self, message_type: str, number: int = 0, size: int = 1472, **changes: Any) -> None:
        self.settings = Settings(check({'robot_topic': '/t', 'message_type': message_type, **changes},
                                       RelayEncoder.PARAMETERS))
        self.encoder, self._size = LinkedEncoder(RelayEncoder(self.settings.requested, number)), size
        self.encoder.see(loss=COPIED_LOSS)
        self._seq = itertools.count(number)

    def send(self, message: Any) -> List[RelaySegment]:
        return self._segments(self.encoder.encode(self.encoder.merge(None, message), self.settings, self._size))

    def copy(self) -> List[RelaySegment]:
        return self._segments(self.encoder.repeat(self.settings, self._size))

    def _segments(self, frames: Sequence[Any]) -> List[RelaySegment]:
        made = []
        for row in itertools.chain.from_iterable(frame.rows for frame in frames):
            made.append(RelaySegment().deserialize(row[OVERHEAD:].tobytes()))
            made[-1].header.seq = next(self._seq) % 2 ** 32
        assert all(frame.datagram_size <= self._size for frame in frames)
        return made


def published(message_type: str, segments: Sequence[RelaySegment]) -> List[Any]:
    assembler, _ = operator_side('relay', message_type=message_type)
    return [message for segment in segments for message in assembler.join(segment)]


def values(segments: Sequence[RelaySegment]) -> List[float]:
    return [message.data for message in published('std_msgs/Float32', segments)]


def imu(number: int) -> Any:
    message = Imu()
    message.header.stamp.secs, message.header.frame_id = 100 + number, 'imu_link'
    message.angular_velocity.x, message.linear_acceleration.z = 0.01 * number, 9.81 + 0.001 * number
    return message


def test_every_second_datagram_lost_and_all_messages_come() -> None:
    robot = Robot('sensor_msgs/Imu')
    sent = [robot.send(imu(number)) for number in range(9)]
    arrived = [segment for segments in sent[::2] for segment in segments]
    assert published('sensor_msgs/Imu', arrived) == [imu(number) for number in range(9)]


def test_a_repetition_takes_little() -> None:
    """As its covariances and names are those of the next one."""
    for message_type, make in ('sensor_msgs/Imu', imu), ('nav_msgs/Odometry', lambda number: Odometry()):
        robot = Robot(message_type)
        first, second = robot.send(make(1)), robot.send(make(2))
        assert not first[0].before and 0 < len(second[0].before) <= 40


@given(st.lists(st.booleans(), min_size=1, max_size=30), st.integers(0, 2 ** 32 - 1), st.randoms())
def test_each_message_comes_once_and_in_order(lost: List[bool], first: int, order: random.Random) -> None:
    """Also numbers that begin anew, equal messages, copies, and datagrams that overtake each other."""
    robot = Robot('std_msgs/Float32', first)
    segments: List[Tuple[int, RelaySegment]] = []
    for number in range(len(lost)):
        segments += [(number, segment) for segment in robot.send(Float32(number // 2)) + robot.copy()]
    arrived = [one for one in segments if not lost[one[0]]]
    came = values([segment for _, segment in arrived])
    expected = [number // 2 for number in range(len(lost))
                if not lost[number] or (number + 1 < len(lost) and not lost[number + 1])]
    assert came == expected
    order.shuffle(arrived)
    came = values([segment for _, segment in arrived])
    assert came == sorted(came)
    assert not collections.Counter(came) - collections.Counter(expected)


@given(st.floats(0, 0.9), st.integers(0, 1000))
def test_a_message_is_lost_with_all_its_datagrams_only(loss: float, seed: int) -> None:
    draw = random.Random(seed)
    robot = Robot('std_msgs/Float32')
    arrived, there = [], set()
    for number in range(60):
        for carried, segments in ({number, number - 1}, robot.send(Float32(number))), ({number}, robot.copy()):
            if draw.random() >= loss:
                arrived += segments
                there |= carried
    assert values(arrived) == sorted(there - {-1})


def test_what_does_not_fit_beside_is_not_repeated() -> None:
    robot = Robot('std_msgs/String', size=300)
    messages = [String(noise(length, length)) for length in (180, 181, 120, 20, 700, 30, 31)]
    sent = [robot.send(message) for message in messages]
    assert [bool(segments[0].before) for segments in sent] == [False, False, False, True, False, False, True]
    assert published('std_msgs/String', [one for segments in sent for one in segments]) == messages
    assert len(sent[4]) > 1
    assert all(segment.number == 4 for segment in sent[4])


def test_a_long_message_is_not_copied_and_nor_is_a_latched_one() -> None:
    robot = Robot('std_msgs/String')
    robot.send(String(noise(3000, 1)))
    assert robot.copy() == [] and robot.encoder.repeat_period(robot.settings) is None
    latched = Robot('std_msgs/String', latch=True)
    first, second, again = latched.send(String('a')), latched.send(String('b')), latched.copy()
    assert not (first[0].before or second[0].before or again[0].before)
    # each of its datagrams has a number: a late subscriber is to get it
    assert [one.number for one in first + second + again] == [0, 1, 2]


def test_a_restarted_robot_is_heard_at_once() -> None:
    for again in 5000, 2 ** 31, 2 ** 32 - 5000:
        segments = [segment for robot in (Robot('std_msgs/Float32', 7), Robot('std_msgs/Float32', again))
                    for number in range(3) for segment in robot.send(Float32(number))]
        assert values(segments) == [0, 1, 2, 0, 1, 2]


def test_copies_where_much_is_lost_halfway_to_the_next_message_and_once() -> None:
    robot = Robot('std_msgs/Float32', rate=20.0)
    robot.encoder.see(source_rate=10.0)
    for loss, period in (0.0, None), (float('nan'), None), (COPIED_LOSS, 0.05), (0.5, 0.05):
        robot.encoder.see(loss=loss)
        original, = robot.send(Float32(1))
        assert robot.encoder.repeat_period(robot.settings) == period
    copy, = robot.copy()
    assert (copy.number, copy.data, copy.before) == (original.number, original.data, b'')
    assert robot.encoder.repeat_period(robot.settings) is None and robot.copy() == []


def test_what_cannot_be_afforded_is_left_out() -> None:
    robot, asked = Robot('std_msgs/Float32'), []

    def afford(size: int, datagram: bool) -> bool:
        asked.append((size, datagram))
        return False
    robot.send(Float32(0))
    robot.encoder.see(afford=afford)
    segment, = robot.send(Float32(1))
    assert segment.before == b'' and robot.copy() == []
    assert asked == [(asked[0][0], False), (OVERHEAD + 38 + 5, True)] and 0 < asked[0][0] < 12


@given(st.binary(max_size=300), st.binary(max_size=300))
def test_any_message_beside_any_other(data: bytes, known: bytes) -> None:
    assert unpack_beside(pack_beside(data, known), known) == data


@given(st.binary(max_size=60), st.binary(max_size=60))
def test_any_bytes_are_a_repetition_or_refused(packed: bytes, known: bytes) -> None:
    with contextlib.suppress(ValueError):
        assert len(unpack_beside(packed, known)) <= MAX_DEFLATED


def test_a_broken_repetition_costs_only_itself() -> None:
    for broken in b'\xff\xff', pack_beside(bytes(MAX_DEFLATED + 1), b''), pack_beside(b'x', b'') + b'more':
        dropped: Any = collections.Counter()
        assert MessageOrder(dropped).add(5, b'message', broken) == [b'message'] and dropped == {'repetition': 1}


def test_old_numbers_are_no_news() -> None:
    dropped: Any = collections.Counter()
    order = MessageOrder(dropped)
    assert order.add(3, b'a', b'') == [b'a']
    for number in 3, 2, 2 ** 32 - 1, (3 - MAX_REORDERING + 1) % 2 ** 32:
        assert order.add(number, b'old', pack_beside(b'older', b'old')) == []
    assert dropped == {'not needed': 4}
    assert order.add((3 - MAX_REORDERING) % 2 ** 32, b'b', b'') == [b'b']


# the budget

def test_a_budget_is_three_percent_and_keeps_half_for_what_cannot_wait() -> None:
    budget = RepetitionBudget()
    assert budget.take(10 ** 9, 0.0, True)      # as long as the link is not limited
    budget.set_rate(1e5, 1e5, 10.0)
    taken = {True: 0, False: 0}
    for tick in range(1000):
        for can_wait in True, False:
            taken[can_wait] += 60 * budget.take(60, 11.0 + tick / 100, can_wait)
    assert sum(taken.values()) == pytest.approx(SHARE * 1e5 * (10 + SPAN), rel=0.05)
    assert taken[False] > 3 * taken[True]
    budget.set_rate(None, 0.0, 30.0)
    assert budget.take(10 ** 9, 30.0, True)


def test_with_room_both_are_granted() -> None:
    budget = RepetitionBudget()
    budget.set_rate(1e5, 1e5, 0.0)
    assert all(budget.take(10, 1.0 + tick / 100, can_wait) for tick in range(300) for can_wait in (True, False))
    assert not budget.take(int(SHARE * 1e5 * (1 - RESERVED)) + 60, 4.0, True)


@pytest.mark.parametrize('rate, sent, wanted', [
    (4e5, 3e5, SHARE * 3e5),                    # overestimated
    (1e5, 6e4, UNUSED_SHARE * 4e4),             # the camera does not fill the link
    (1e5, 2e5, SHARE * 1e5),                    # a dip
    (6e4, 1e4, UNUSED_SHARE * 5e4),             # little else is sent
    (1e6, 1e4, MAX_UNUSED)])
def test_a_budget_is_of_what_is_sent_or_of_what_nobody_uses(rate: float, sent: float, wanted: float) -> None:
    budget = RepetitionBudget()
    budget.set_rate(rate, sent, 0.0)
    taken = sum(10 * budget.take(10, 1.0 + tick / 1000, False) for tick in range(10000))
    assert taken == pytest.approx(wanted * (10 + SPAN), rel=0.05)


def test_messages_are_what_was_serialised() -> None:
    assert serialised(imu(3)) == serialised(published('sensor_msgs/Imu', Robot('sensor_msgs/Imu').send(imu(3)))[0])
