# SPDX-License-Identifier: BSD-3-Clause
"""What actions send of messages that repeat themselves, and the goals that an operator follows."""
from smokebot_udp.streams.action.goal_watch import CANCEL_PERIOD, MAX_GOALS, GoalWatch, Lost
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
    watch.sent('goal', 1.0, 0.0)
    assert watch.deadline() == 7.0 and watch.poll(6.9) is None and watch.unheard == ['goal']
    watch.heard(['another', 'goal'])
    assert watch.deadline() is None and watch.poll(8.0) is None and watch.unheard == []
    assert watch.to_cancel({'goal': 1.0}, 8.0) == []


def test_a_lost_goal_that_the_robot_pursues_is_cancelled_until_it_ends() -> None:
    watch = GoalWatch(7.0)
    watch.sent('goal', 1.0, 0.0)
    watch.sent('later', 2.0, 1.0)
    assert watch.poll(7.0) == Lost('goal', []) and watch.poll(7.0) is None
    assert watch.to_cancel({'goal': 1.0, 'later': 2.0, 'unheard of': 3.0}, 9.0) == ['goal']
    assert watch.to_cancel({'goal': 1.0}, 9.0 + 0.9 * CANCEL_PERIOD) == []
    assert watch.to_cancel({'goal': 1.0}, 9.0 + CANCEL_PERIOD) == ['goal']


def test_what_a_lost_goal_was_to_replace_is_cancelled() -> None:
    watch = GoalWatch(7.0)
    for goal in ('ended', 'running'):
        watch.sent(goal, 1.0, 0.0)
    watch.heard(['ended', 'running'])
    watch.ended(['ended'])
    watch.sent('lost', 10.0, 10.0)
    watch.sent('after', 11.0, 11.0)
    watch.heard(['after'])
    assert watch.poll(17.0) == Lost('lost', ['running'])
    pursued = {'ended': 1.0, 'running': 1.0, 'after': 11.0, "another operator's": 5.0}
    assert watch.to_cancel(pursued, 20.0) == ['running']


def test_what_a_goal_that_cannot_leave_was_to_replace_is_cancelled() -> None:
    watch = GoalWatch(7.0)
    watch.sent('running', 1.0, 0.0)
    watch.heard(['running'])
    assert watch.failed(5.0) == ['running'] and watch.to_cancel({'running': 1.0}, 5.1) == ['running']
    assert watch.failed(6.0) == ['running']      # it may still run
    watch.ended(['running'])
    assert watch.failed(7.0) == []


def test_a_cancelled_goal_that_the_robot_pursues_is_cancelled_again() -> None:
    watch = GoalWatch(7.0)
    watch.cancelled('goal', 0.0, 0.0)
    pursued = {'goal': 1.0, 'other': 0.0}
    assert watch.to_cancel(pursued, 0.9 * CANCEL_PERIOD) == []
    assert watch.to_cancel(pursued, CANCEL_PERIOD) == ['goal']
    assert watch.to_cancel(pursued, 2 * CANCEL_PERIOD) == ['goal']


def test_all_goals_are_cancelled_until_they_end() -> None:
    watch = GoalWatch(7.0)
    watch.sent('on its way', 1.0, 0.0)
    assert watch.to_cancel({'pursued': 0.5}, 0.0) == []
    watch.cancelled('', 0.0, 0.0)
    watch.sent('later', 2.0, 0.1)
    assert watch.to_cancel({'pursued': 0.5, 'on its way': 1.0, 'later': 2.0}, 2.0) == ['pursued', 'on its way']


def test_goals_up_to_a_stamp_are_cancelled_until_they_end() -> None:
    watch = GoalWatch(7.0)
    for number in (1, 2, 3):
        watch.sent('%d' % number, float(number), 0.0)
    watch.cancelled('', 2.0, 0.5)
    assert watch.to_cancel({'1': 1.0, '2': 2.0, '3': 3.0}, 2.0) == ['1', '2']
    watch.cancelled('3', 0.0, 2.0)
    assert watch.to_cancel({'3': 3.0}, 3.0) == ['3']


def test_goals_without_an_id_are_not_followed() -> None:
    watch = GoalWatch(7.0)
    watch.sent('', 0.0, 0.0)
    assert watch.deadline() is None


def test_bounds() -> None:
    watch = GoalWatch(7.0)
    for number in range(2 * MAX_GOALS):
        watch.sent('%d' % number, 1.0, 0.0)
    lost = []
    while watch.deadline() is not None:
        found = watch.poll(7.0)
        assert found is not None
        lost.append(found.goal)
    assert lost == ['%d' % number for number in range(MAX_GOALS)]
    for number in range(MAX_GOALS):
        watch.sent('again %d' % number, 1.0, 10.0)
        watch.poll(20.0)
    assert watch.to_cancel({'0': 1.0}, 20.0) == [] and watch.to_cancel({'again 0': 1.0}, 20.0) == ['again 0']
    for number in range(2 * MAX_GOALS):     # whose ends were not heard
        watch.sent('heard %d' % number, 1.0, 30.0)
        watch.heard(['heard %d' % number])
    assert len(watch.failed(40.0)) == MAX_GOALS
