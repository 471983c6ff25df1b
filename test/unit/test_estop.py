# SPDX-License-Identifier: BSD-3-Clause
"""Both halves of the emergency stop, step by step."""
import math
from typing import List, Optional, Tuple

import pytest

from smokebot_udp.teleop.estop import MAX_SOURCES, EstopClient, EstopInput, EstopLatch
from smokebot_udp.teleop.records import Status, Wish
from smokebot_udp.teleop.requests import MAX_AGE, MAX_AHEAD, SUPERSEDED, RequestClient


def engaged(by: str = 'a', at: float = 10.0) -> EstopLatch:
    latch = EstopLatch()
    latch.engage(by, at)
    return latch


def test_it_is_not_engaged_at_first_and_stays_engaged() -> None:
    latch = EstopLatch()
    assert not latch.engaged
    latch.engage('a', 10.0)
    latch.engage('b', 11.0)
    assert latch.engaged and latch.by == 'b'


@pytest.mark.parametrize(('made', 'now', 'refusal'), [
    (10.5, 10.6, None),
    (10.5, 10.5 + MAX_AGE, None),
    (10.5, 10.6 + MAX_AGE, 'it came 1.1 s after it was made'),
    (10.0, 10.1, 'a engaged it after that'),
    (9.9, 10.1, 'a engaged it after that'),
    (10.5, 10.5 - MAX_AHEAD / 2, None),
    (12.5, 10.5, "it was made 2.0 s from now, by the operator's estimate of the robot's clock"),
    (0.0, 10.5, 'it is not known when it was made'),
    (math.nan, 10.5, 'it came nan s after it was made'),
    (math.inf, 10.5, "it was made inf s from now, by the operator's estimate of the robot's clock"),
])
def test_a_release_is_judged_by_when_it_was_made(made: float, now: float, refusal: Optional[str]) -> None:
    latch = engaged()
    assert latch.release(made, now) == refusal
    assert latch.engaged == (refusal is not None)


def test_one_release_ends_it_for_all_and_whoever_engages_it_after_that_engages_it_again() -> None:
    latch = engaged('a', 10.0)
    latch.engage('b', 11.0)
    assert latch.release(10.9, 11.1) == 'b engaged it after that'    # made before b's came
    assert latch.release(11.2, 11.3) is None and not latch.engaged
    latch.engage('b', 11.4)
    assert latch.engaged


def test_a_release_while_it_is_not_engaged_does_nothing() -> None:
    latch = EstopLatch()
    assert latch.release(10.0, 10.1) is None and not latch.engaged


def test_a_person_at_the_robot_engages_and_releases_it() -> None:
    latch = EstopLatch()
    latch.set_locally(True, 'the robot', 10.0)
    assert latch.engaged and latch.by == 'the robot'
    assert latch.release(9.9, 10.1) == 'the robot engaged it after that'
    latch.set_locally(False, 'the robot', 11.0)
    assert not latch.engaged


class Operator:
    """A client, and its requests."""

    def __init__(self) -> None:
        self.requests = RequestClient()
        self.client = EstopClient(self.requests)
        self.now = 0.0

    def hear(self, robot: int, estop: bool, by: str = 'me', answered: int = 0, refusal: str = '') -> None:
        """A status comes that answers a request."""
        self.now += 0.1
        wish = self.requests.answered(answered, refusal)
        if wish is not None:
            self.client.answered(wish, refusal, robot)
        self.client.heard(Status(robot, self.now, estop=estop, estop_by=by), 'me', self.now)

    @property
    def asks(self) -> Optional[Wish]:
        """What is being asked."""
        return self.requests.pending.wish if self.requests.pending else None


def with_stop() -> Operator:
    """An operator that has engaged the stop at robot 7."""
    operator = Operator()
    assert operator.client.engage(operator.now) == 1
    operator.hear(7, True, answered=1)
    assert operator.client.wanted and operator.asks is None
    return operator


def test_it_is_asked_until_it_is_answered() -> None:
    operator = Operator()
    operator.client.engage(0.0)
    for _ in range(5):      # statuses that were sent before the request came do not end it
        operator.hear(7, False, by='')
        operator.hear(7, True, by='another')
        assert operator.asks == Wish.ENGAGE_ESTOP and operator.client.wanted


def test_it_is_engaged_again_at_a_restarted_robot_even_if_another_operator_was_faster() -> None:
    operator = with_stop()
    operator.hear(8, True, by='another')
    assert operator.asks == Wish.ENGAGE_ESTOP
    operator.hear(8, True, answered=2)
    assert operator.asks is None and operator.client.wanted
    operator.hear(9, False, by='')
    assert operator.asks == Wish.ENGAGE_ESTOP


def test_it_is_not_engaged_again_after_anybody_has_released_it() -> None:
    operator = with_stop()
    operator.hear(7, False)
    assert not operator.client.wanted
    operator.hear(8, False, by='')
    assert operator.asks is None


def test_its_own_release_counts_when_it_is_answered_and_not_where_it_is_refused() -> None:
    operator = with_stop()
    release = operator.requests.ask(Wish.RELEASE_ESTOP, 7, 5.0, operator.now)
    operator.hear(7, True)
    assert operator.client.wanted
    operator.hear(7, True, answered=release, refusal='too late')
    assert operator.client.wanted and operator.asks is None
    release = operator.requests.ask(Wish.RELEASE_ESTOP, 7, 6.0, operator.now)
    operator.hear(7, False, answered=release)
    assert not operator.client.wanted


def test_a_restart_of_the_robot_comes_before_a_release_that_was_not_answered() -> None:
    operator = with_stop()
    release = operator.requests.ask(Wish.RELEASE_ESTOP, 7, 5.0, operator.now)
    operator.hear(8, False, by='')
    assert operator.asks == Wish.ENGAGE_ESTOP and operator.requests.outcome(release) == SUPERSEDED


def test_a_restarted_operator_knows_what_it_engaged_before() -> None:
    operator = Operator()
    operator.hear(7, True, by='another')
    assert not operator.client.wanted
    operator.hear(7, True, by='me')
    assert operator.client.wanted and operator.asks is None
    operator.hear(8, False, by='')
    assert operator.asks == Wish.ENGAGE_ESTOP


def test_engaged_once_more_it_is_asked_once_more() -> None:
    operator = with_stop()
    assert (operator.client.engage(1.0), operator.client.engage(1.1)) == (2, 3)
    operator.hear(7, False, answered=2)     # somebody has released it since
    assert operator.asks == Wish.ENGAGE_ESTOP
    operator.hear(7, True, answered=3)
    assert operator.asks is None and operator.client.wanted


def presses(*messages: Tuple[float, bool]) -> List[float]:
    """When messages of one publisher are presses: [(when, whether it is pressed), ...]."""
    topic = EstopInput()
    return [now for now, pressed in messages if topic.is_press('button', pressed, now)]


def test_to_let_go_of_the_button_releases_nothing() -> None:
    """A momentary button at 20 Hz that is held for 0.3 s: nothing but presses."""
    states = [(number / 20, 20 <= number <= 26) for number in range(60)]
    found = presses(*states)
    assert found[0] == 1.0 and all(1.0 <= now <= 1.3 for now in found)


def test_a_button_that_is_held_is_pressed_again_and_again() -> None:
    assert presses(*((number / 64, True) for number in range(64))) == [number * 7 / 64 for number in range(10)]


def test_a_press_after_the_button_was_let_go_counts_at_once_and_so_does_one_of_another_publisher() -> None:
    assert presses((1.0, True), (1.02, False), (1.04, True), (1.06, True)) == [1.0, 1.04]
    assert presses((1.0, True), (1.15, True), (1.16, True)) == [1.0, 1.15]      # a node that publishes presses only
    topic = EstopInput()
    assert [topic.is_press(source, True, 1.0) for source in ('one', 'other', 'one')] == [True, True, False]


def test_publishers_of_the_topic_are_forgotten_in_turn() -> None:
    topic = EstopInput()
    for number in range(100 * MAX_SOURCES):
        assert topic.is_press('button %d' % number, True, 1.0)
    assert topic.is_press('button 0', True, 1.0)
