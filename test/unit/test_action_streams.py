# SPDX-License-Identifier: BSD-3-Clause
"""What actions send of messages that repeat themselves, and the goals that an operator follows."""
from smokebot_udp.streams.action.goal_watch import CANCEL_PERIOD, MAX_GOALS, GoalWatch
from smokebot_udp.streams.action.throttle import REPEAT_PERIOD, Throttle


def test_the_newest_message_at_the_maximum_rate() -> None:
    throttle = Throttle(10.0)
    for data in (b'1', b'2'):       # one period of slack
        throttle.put(data, data, 0.0)
        assert throttle.poll(0.0) == data and throttle.poll(0.0) is None
    throttle.put(b'3', b'3', 0.04)
    throttle.put(b'4', b'4', 0.05)
    assert throttle.poll(0.05) is None and throttle.deadline() == 0.1
    assert throttle.poll(0.1) == b'4' and throttle.deadline() is None


def test_what_says_the_same_is_sent_once_a_second() -> None:
    throttle = Throttle(100.0)
    sent = []
    for tick in range(12):
        throttle.put(b'stamp %d' % tick, b'same', 0.25 * tick)
        data = throttle.poll(0.25 * tick)
        sent += [tick] if data else []
    assert REPEAT_PERIOD == 1.0 and sent == [0, 4, 8]


def test_a_change_is_sent_at_once_also_back() -> None:
    throttle = Throttle(100.0)
    for now, content in ((0.0, b'a'), (0.1, b'b'), (0.2, b'a')):
        throttle.put(content, content, now)
        assert throttle.poll(now) == content


def test_a_goal_that_is_heard_of_is_not_lost() -> None:
    watch = GoalWatch(7.0)
    watch.sent('goal', 0.0)
    assert watch.deadline() == 7.0 and watch.poll(6.9) is None and watch.unheard == ['goal']
    watch.heard(['another', 'goal'])
    assert watch.deadline() is None and watch.poll(8.0) is None and watch.unheard == []
    assert watch.to_cancel(['goal'], 8.0) == []


def test_a_lost_goal_that_the_robot_pursues_is_cancelled_until_it_ends() -> None:
    watch = GoalWatch(7.0)
    watch.sent('goal', 0.0)
    watch.sent('later', 1.0)
    assert watch.poll(7.0) == 'goal' and watch.poll(7.0) is None
    assert watch.to_cancel(['goal', 'later', 'unheard of'], 9.0) == ['goal']
    assert watch.to_cancel(['goal'], 9.0 + 0.9 * CANCEL_PERIOD) == []
    assert watch.to_cancel(['goal'], 9.0 + CANCEL_PERIOD) == ['goal']


def test_a_cancelled_goal_that_the_robot_pursues_is_cancelled_again() -> None:
    watch = GoalWatch(7.0)
    watch.cancelled('goal', 0.0)
    assert watch.to_cancel(['goal', 'other'], 0.9 * CANCEL_PERIOD) == []
    assert watch.to_cancel(['goal', 'other'], CANCEL_PERIOD) == ['goal']
    assert watch.to_cancel(['goal'], 2 * CANCEL_PERIOD) == ['goal']


def test_all_goals_are_cancelled_until_they_end() -> None:
    watch = GoalWatch(7.0)
    watch.sent('on its way', 0.0)
    assert watch.to_cancel(['pursued'], 0.0) == []
    watch.cancelled('', 0.0)
    watch.sent('later', 0.1)
    assert watch.to_cancel(['pursued', 'on its way', 'later'], 2.0) == ['pursued', 'on its way']


def test_goals_without_an_id_are_not_followed() -> None:
    watch = GoalWatch(7.0)
    watch.sent('', 0.0)
    assert watch.deadline() is None


def test_bounds() -> None:
    watch = GoalWatch(7.0)
    for number in range(2 * MAX_GOALS):
        watch.sent('%d' % number, 0.0)
    lost = []
    while watch.deadline() is not None:
        lost.append(watch.poll(7.0))
    assert lost == ['%d' % number for number in range(MAX_GOALS)]
    for number in range(MAX_GOALS):
        watch.sent('again %d' % number, 10.0)
        watch.poll(20.0)
    assert watch.to_cancel(['0'], 20.0) == [] and watch.to_cancel(['again 0'], 20.0) == ['again 0']
