# SPDX-License-Identifier: BSD-3-Clause
"""Goals without results that ended, or left the status."""
from typing import Any, Iterator

from smokebot_udp.streams.action.goal_watch import MAX_GOALS
from smokebot_udp.streams.action.missing_goals import LOSS_TIMEOUT, Missing, MissingGoals


def shown(goals: MissingGoals, statuses: Any, begin: float, end: float, final: Any = ()) -> Iterator[Missing]:
    """A status each second."""
    for second in range(int(begin), int(end)):
        yield goals.update(statuses, final, float(second))


def test_a_goal_stays_listed_until_its_result() -> None:
    goals = MissingGoals()
    assert goals.update({'a': 'active', 'b': 'pending'}, (), 1.0) == ([], [])
    assert goals.update({'b': 'active'}, (), 10.0) == (['active'], [])
    assert goals.update({'b': 'active'}, (), 10.1) == (['active'], [])
    goals.ended('a')
    assert goals.update({'b': 'active'}, (), 10.2) == ([], [])


def test_a_goal_that_the_server_has_forgotten_is_lost() -> None:
    goals = MissingGoals()
    goals.update({'a': 'active'}, (), 0.0)
    found = list(shown(goals, {}, 1, 20))
    assert [one.lost for one in found].index(['a']) == LOSS_TIMEOUT
    assert [one.added for one in found] == 10 * [['active']] + 9 * [[]]


def test_a_result_that_never_comes_is_lost() -> None:
    goals = MissingGoals()
    goals.update({'a': 'active'}, (), 0.0)
    found = list(shown(goals, {'a': 'succeeded'}, 1, 20, final=['a']))
    assert [one.lost for one in found].index(['a']) == LOSS_TIMEOUT
    assert sum(len(one.lost) for one in found) == 1 and not any(one.added for one in found)


def test_during_a_cut_no_result_is_waited_for() -> None:
    goals = MissingGoals()
    goals.update({'a': 'active'}, (), 0.0)
    assert list(shown(goals, {}, 1, 5))[-1] == (['active'], [])
    assert goals.update({}, (), 1000.0) == (['active'], [])
    goals.ended('a')
    assert goals.update({}, (), 1001.0) == ([], [])


def test_a_goal_that_is_listed_again() -> None:
    goals = MissingGoals()
    goals.update({'a': 'active'}, (), 0.0)
    list(shown(goals, {}, 1, 9))
    assert goals.update({'a': 'preempting'}, (), 9.0) == ([], [])
    assert all(one == (['preempting'], []) for one in shown(goals, {}, 10, 19))


def test_the_usual_end() -> None:
    goals = MissingGoals()
    goals.update({'a': 'active'}, (), 0.0)
    goals.ended('a')
    assert all(one == ([], []) for one in shown(goals, {'a': 'succeeded'}, 1, 20, final=['a']))


def test_bounds() -> None:
    goals = MissingGoals()
    goals.update({str(number): number for number in range(2 * MAX_GOALS)}, (), 0.0)
    assert goals.update({}, (), 1.0).added == list(range(MAX_GOALS, 2 * MAX_GOALS))
    for number in range(2 * MAX_GOALS):
        goals.ended('ended %d' % number)
    goals.update({'ended 0': 'x', 'ended 199': 'y'}, (), 2.0)
    assert 'x' in goals.update({}, (), 3.0).added and 'y' not in goals.update({}, (), 3.0).added
