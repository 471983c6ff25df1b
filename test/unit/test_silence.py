# SPDX-License-Identifier: BSD-3-Clause
"""When a silent topic is asked for."""
import math
from dataclasses import dataclass

from smokebot_udp.udpros.silence import (
    BROKEN,
    MAX_MOVED,
    MAX_RENEGOTIATION,
    MAX_SILENCE_PERIOD,
    RENEGOTIATION,
    SILENCE_TIMEOUT,
    WATCHED,
    FormerAddress,
    NewestAddresses,
    Renegotiation,
    Silence,
)


def asked_at(silence, heard, begin, end) -> list:
    """When a topic is asked for that is silent from begin to end [s]."""
    times = []
    for step in range(round(10 * (end - begin))):
        now = begin + step / 10
        if silence.due(heard, now):
            silence.asked(now)
            times.append(round(now - begin))
    return times


def test_a_topic_is_asked_for_less_and_less_often_while_it_is_silent() -> None:
    silence = Silence(100.0)
    assert asked_at(silence, -math.inf, 100.0, 200.0) == [3, 9, 21, 45, 75]
    assert MAX_SILENCE_PERIOD == 30.0


def test_a_message_makes_it_begin_anew() -> None:
    silence = Silence(100.0)
    asked_at(silence, 100.0, 100.0, 200.0)
    assert not silence.due(201.0, 201.0 + SILENCE_TIMEOUT - 0.1)
    assert asked_at(silence, 201.0, 201.0, 231.0) == [3, 9, 21]


def test_a_topic_with_a_message_each_few_seconds_is_not_silent() -> None:
    silence, heard, asked = Silence(100.0), 100.0, 0
    for second in range(100, 200):
        heard = float(second - second % 5)
        if silence.due(heard, float(second)):
            silence.asked(float(second))
            asked += 1
    assert asked == 1       # before its pauses are known
    assert asked_at(silence, heard, 200.0, 260.0) == [8, 20, 32, 56]    # silent since 195
    for second in range(260, 300):      # then it comes often
        silence.due(float(second), second + 0.5)
    assert asked_at(silence, 299.0, 299.0, 330.0) == [3, 9, 21]


def test_an_interruption_does_not_make_it_patient_for_long() -> None:
    silence = Silence(100.0)
    for second in [*range(100, 120), *range(150, 170)]:
        silence.due(float(second), second + 0.5)
    assert asked_at(silence, 169.0, 169.0, 175.0) == [3]


def test_a_new_connection_is_no_message_and_makes_it_no_more_patient() -> None:
    """A connection was made at 100 s and replaced at 110 s; the only message came at 112 s."""
    silence = Silence(100.0)
    for made in (100.0, 110.0):
        assert not silence.due(made, made + 1.0, message=False)
    silence.due(112.0, 112.5)
    assert asked_at(silence, 112.0, 112.0, 120.0) == [3]


def test_a_question_without_answer_is_repeated_soon() -> None:
    silence = Silence(100.0)
    asked_at(silence, 100.0, 100.0, 150.0)
    silence.asked(150.0)
    silence.unanswered()
    assert not silence.due(100.0, 152.9) and silence.due(100.0, 153.0)


def test_a_change_makes_silent_topics_be_asked_for_at_once() -> None:
    silence = Silence(100.0)
    asked_at(silence, 100.0, 100.0, 150.0)
    silence.hurry()
    assert silence.due(100.0, 150.0)
    assert not silence.due(149.0, 150.0)        # it is not silent


def test_topics_share_a_question() -> None:
    silence = Silence(100.0)
    silence.asked(100.0)
    assert not silence.due(100.0, 103.0) and silence.due(100.0, 103.0, early=0.5)
    assert not silence.due(100.5, 103.0, early=0.5)     # not silent


def test_a_connection_is_negotiated_anew_less_and_less_often() -> None:
    renegotiation = Renegotiation()
    assert not renegotiation.due(RENEGOTIATION - 1, worked=True)
    assert renegotiation.due(RENEGOTIATION, worked=True)
    assert not renegotiation.due(RENEGOTIATION, worked=False)
    assert renegotiation.due(2 * RENEGOTIATION, worked=False)
    for _ in range(10):
        renegotiation.due(math.inf, worked=False)
    assert not renegotiation.due(MAX_RENEGOTIATION - 1, worked=False)
    assert renegotiation.due(MAX_RENEGOTIATION, worked=False)
    assert renegotiation.due(RENEGOTIATION, worked=True)


@dataclass
class Connected:
    idle: float
    done: bool = False


def test_connections_to_a_former_address_are_replaced_once_they_are_silent() -> None:
    former: FormerAddress[Connected] = FormerAddress()
    assert not former and former.broken(0.0) == []
    silent, heard_just_now, working, closed = Connected(2.0), Connected(0.1), Connected(0.0), Connected(2.0, done=True)
    former.lost([silent, heard_just_now, working, closed], 10.0)
    assert former.broken(10.0) == [silent]
    heard_just_now.idle = BROKEN + 0.1
    assert former and former.broken(10.5) == [heard_just_now]
    assert former.broken(10.7) == []
    assert former.broken(10.0 + WATCHED) == [] and not former
    working.idle = 2.0
    assert former.broken(13.0) == []


def test_a_second_change_of_an_address_forgets_no_connection_of_the_first() -> None:
    former: FormerAddress[Connected] = FormerAddress()
    first, second = Connected(0.0), Connected(0.0)
    former.lost([first], 10.0)
    former.lost([second, first], 10.5)
    first.idle = second.idle = BROKEN + 0.1
    assert former.broken(10.0 + WATCHED + 0.4) == [first, second]


def test_an_address_is_new_once() -> None:
    newest = NewestAddresses()
    assert [newest.is_new(*moved) for moved in (
        ('a', '10.0.0.2'), ('a', '10.0.0.2'), ('b', '10.0.0.2'), ('a', '10.0.0.3'), ('a', '10.0.0.2'))] == [
            True, False, True, True, True]


def test_the_addresses_of_some_nodes_are_remembered() -> None:
    newest = NewestAddresses()
    assert all(newest.is_new(str(number), '10.0.0.2') for number in range(MAX_MOVED + 1))
    assert not newest.is_new(str(MAX_MOVED), '10.0.0.2') and newest.is_new('0', '10.0.0.2')
