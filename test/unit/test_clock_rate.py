# SPDX-License-Identifier: BSD-3-Clause
"""A clock that runs at another rate than this machine's, as a simulation's /clock."""
import math
import random
from typing import Iterator, Tuple

import pytest

from smokebot_udp.monitoring.clock_client import EchoClient
from smokebot_udp.monitoring.clock_offset import ClockOffset
from smokebot_udp.monitoring.clock_rate import Sample, clock_line

EPOCH = 1.7e9


def errors(rate: float, seconds: int = 60, grain: float = 0.0, jitter: float = 0.0, loss: float = 0.0
           ) -> Iterator[Tuple[float, float]]:
    """(time, error of the offset) just before each answer, of a clock of this rate that is asked once a second [s]."""
    client, chance = EchoClient(), random.Random(1)

    def theirs(at: float) -> float:
        found = 5000.0 + rate * at
        return math.floor(found / grain) * grain if grain else found
    for second in range(seconds):
        asked = float(second)
        there, back = (0.01 + jitter * chance.random() for _ in range(2))
        came = asked + there + back
        estimate = client.estimate(came)
        if estimate is not None:
            yield came, EPOCH + came + estimate.offset - theirs(came)
        client.ask(int((EPOCH + asked) * 1e9), asked)
        if chance.random() >= loss:
            client.answer(int((EPOCH + asked) * 1e9), theirs(asked + there), theirs(asked + there), EPOCH + came, came)


@pytest.mark.parametrize('rate', [0.7, 0.1, 0.95, 0.99, 1.003, 2.0, 10.0])
def test_a_clock_of_another_rate_is_followed(rate: float) -> None:
    """At 0.7, views were red after 7 s and stayed so."""
    found = dict(errors(rate))
    assert len(found) >= 57
    assert max(abs(error) for at, error in found.items() if at > 4.5) < 0.02 * max(1.0, rate)


@pytest.mark.parametrize('rate', [0.7, 2.0])
def test_also_one_that_advances_in_steps_over_a_bad_link(rate: float) -> None:
    found = dict(errors(rate, 200, grain=0.1, jitter=0.1, loss=0.3))
    late = sorted(abs(error) for at, error in found.items() if at > 10)
    assert len(late) > 150 and late[len(late) // 2] < 0.15 * rate and late[-1] < 1.0 * rate


def test_a_clock_of_this_rate_has_no_line() -> None:
    assert max(abs(error) for _, error in errors(1.0, jitter=0.5)) < 0.26
    assert clock_line([Sample(float(k), 7.0 + 0.01 * (k % 3), 0.005) for k in range(9)]) is None


def test_a_queue_that_grows_looks_like_no_rate() -> None:
    """Only one direction is delayed, more and more: by half of the round trip the offset may be wrong."""
    samples = [Sample(float(k), 7.0 - 0.1 * k, 0.01 + 0.1 * k) for k in range(9)]
    assert all(clock_line(samples[:count]) is None for count in range(10))


@pytest.mark.parametrize('step', [0.2, -5.0, 3600.0])
def test_a_step_is_no_line(step: float) -> None:
    samples = [Sample(float(k), 7.0 + step * (k > 8), 0.005) for k in range(20)]
    assert all(clock_line(samples[:count]) is None for count in range(21))


def test_answers_that_make_no_sense_refute_the_estimate() -> None:
    clock, chance = ClockOffset(any_rate=True), random.Random(2)
    assert clock.add(EPOCH, EPOCH + 5, EPOCH + 5, EPOCH + 0.01, 0.0)
    for second in range(1, 10):
        theirs = EPOCH + 1000 * chance.random()
        clock.add(EPOCH + second, theirs, theirs, EPOCH + second + 0.01, float(second))
    assert clock.refuted and clock.estimate(9.0) is None


def test_a_rate_that_changes_is_followed() -> None:
    """A simulation that runs slowly, and then in real time."""
    clock, known = ClockOffset(any_rate=True), []
    for second in range(60):
        theirs = EPOCH + 0.7 * second if second < 30 else EPOCH + second - 9.0
        clock.add(EPOCH + second, theirs, theirs, EPOCH + second + 0.01, second + 0.01)
        estimate = clock.estimate(second + 0.01)
        known.append(None if estimate is None else abs(EPOCH + second + estimate.offset - theirs))
    assert all(error is not None and error < 0.02 for error in known[5:30] + known[36:])
    assert all(error is None or error < 1.0 for error in known[30:36])


def test_a_steady_clock_has_one_rate() -> None:
    clock = ClockOffset()
    for second in range(20):
        clock.add(EPOCH + second, EPOCH + 0.7 * second, EPOCH + 0.7 * second, EPOCH + second + 0.01, float(second))
    assert clock.refuted and clock.estimate(20.0) is None
