# SPDX-License-Identifier: BSD-3-Clause
"""Commands over a link that loses, delays, reorders and repeats. Each run asserts, by a true clock that neither side
sees, that no command takes effect after a newer one or when it is older than MAX_AGE (command_link)."""
import itertools
import random
from typing import Optional

import pytest
from command_link import MAX_AGE, OPERATOR, ROBOT, TIMEOUT, CommandLink, Way

DELAY, PERIOD = 0.05, 0.05
LIMIT = PERIOD + DELAY + 0.02
POLLED = 0.006      # the robot's thread is late by 5 ms, and clocks drift


def link(loss: float, seed: int = 1, jitter: float = 0.0, late: float = 0.0, rate: float = 20.0) -> CommandLink:
    draw = random.Random(seed)
    ways = [Way(draw, jitter=jitter, late=late, loss=loss) for _ in range(2)]
    return CommandLink(seed, rate, *ways)


def test_none_of_100_000_commands_is_late_or_out_of_order() -> None:
    sums = link(0.5, jitter=0.02, late=0.02).run(5003.0)
    assert len(sums.made) >= 100_000 and len(sums.in_force) > 99_000
    assert sums.within(LIMIT + 0.02) >= 0.99


@pytest.mark.parametrize('loss, share, age', [(0.0, 1.0, 0.101), (0.2, 0.999, 0.110), (0.5, 0.99, 0.120)])
def test_commands_are_in_force_within_a_period_half_the_round_trip_and_20_ms(loss: float, share: float, age: float,
                                                                           ) -> None:
    sums = link(loss).run(1000.0)
    assert sums.within(LIMIT) >= share
    assert sums.age(99) <= age      # of what is in force at any moment, not only of what comes
    assert sums.copies <= 200 * 1000 and not sums.stops


@pytest.mark.parametrize('rate', [4.0, 10.0, 100.0, 1000.0])
def test_at_any_rate_of_the_source_copies_are_bounded(rate: float) -> None:
    sums = link(0.5, rate=rate).run(101.0)
    assert sums.copies <= 200 * 100 + 5
    assert sums.within(LIMIT) >= 0.99 and not sums.stops


def test_80_percent_loss_is_slower_but_as_safe() -> None:
    sums = link(0.8, jitter=0.02, late=0.02).run(500.0)
    assert sums.within(LIMIT) > 0.9 and sums.within(MAX_AGE) > 0.99


def test_bursts_of_a_second_stop_the_robot_each_time() -> None:
    run = link(0.2, jitter=0.01, late=0.02)
    run.there.cut = run.back.cut = lambda now: now > 5 and now % 10 < 1
    sums = run.run(505.0)
    assert len(sums.stops) == 50
    for begin, stop in zip(itertools.count(10, 10), sums.stops):
        assert begin < stop <= begin + TIMEOUT + POLLED
        assert not run.accepted_between(begin + MAX_AGE, begin + 1)
        assert run.accepted_between(begin + 1, begin + 1 + 0.2)     # and it goes on at once


def test_a_cut_link_stops_the_robot_200_times() -> None:
    for seed in range(200):
        run, cut = link(0.2, seed, jitter=0.02, late=0.1), 4.0 + 1e-3 * seed
        run.there.cut = lambda now, cut=cut: now > cut
        sums = run.run(12.0)
        assert len(sums.stops) == 1 and cut < sums.stops[0] <= cut + TIMEOUT + POLLED
        assert not run.accepted_between(cut + MAX_AGE, 12.0)


@pytest.mark.parametrize('go, back', [(0.09, 0.01), (0.01, 0.09), (0.2, 0.001)])
def test_ways_of_unequal_length_do_not_prolong_a_life(go: float, back: float) -> None:
    draw = random.Random(1)
    run = CommandLink(1, 20.0, Way(draw, go, 0.3, 0.3, late=0.2), Way(draw, back, loss=0.3))
    run.run(200.0)
    assert run.gate.dropped['too old'] and not run.gate.dropped['from the future']
    assert run.gate.accepted > 200


def test_a_longer_round_trip_than_the_life_drives_nothing() -> None:
    draw = random.Random(1)
    run = CommandLink(1, 20.0, Way(draw, 0.4), Way(draw, 0.4))
    assert not run.run(20.0).in_force and run.clock.session == ROBOT


def test_a_restarted_robot_obeys_no_command_made_before() -> None:
    run = link(0.2, jitter=0.02, late=0.1)
    run.at(10.0, run.start_robot, 77)
    sums = run.run(20.0)
    obeyed = next(number for at, number in sums.in_force if at > 10)
    assert sums.made[obeyed - 1] > 10 and len(run.accepted_between(11, 20)) > 150
    assert run.gate.dropped['another session']


def test_a_restarted_operator_goes_on_and_its_old_commands_do_not() -> None:
    run = link(0.2, jitter=0.02, late=0.1)
    run.at(10.0, run.start_operator, 78)
    sums = run.run(20.0)
    obeyed = next(number for at, number in sums.in_force if at > 10)
    assert sums.made[obeyed - 1] > 10 and len(run.accepted_between(11, 20)) > 150
    assert run.gate.dropped['not in control']


@pytest.mark.parametrize('machine, jump', [('here', 10.0), ('here', -10.0), ('here', 0.2), ('here', -0.2),
                                           ('robot', 10.0), ('robot', 0.2)])
def test_a_clock_that_jumps_stops_the_robot_until_it_is_measured_again(machine: str, jump: float) -> None:
    """A suspended operator's clock is behind afterwards: -10. A robot's steady clock never goes back."""
    run = link(0.2)
    run.there.duplicated = 0.0      # a late copy may make up for a jump ahead
    clock = run.here_clock if machine == 'here' else run.robot_clock

    def step() -> None:
        clock.start += jump

    run.at(30.0, step)
    sums = run.run(60.0)
    assert len(sums.stops) == 1 and 30 < sums.stops[0] <= 30 + TIMEOUT + POLLED
    assert len(run.accepted_between(35, 60)) > 450 and run.clock.refused['contradiction']


@pytest.mark.parametrize('jump', [1.0, 10.0])
def test_a_robot_whose_clock_goes_back_obeys_nothing_until_it_has_caught_up(jump: float) -> None:
    """Which is no steady clock: the last line of defence, on a link that repeats nothing late."""
    run = link(0.2)
    run.there.duplicated = 0.0

    def step() -> None:
        run.robot_clock.start -= jump

    run.at(5.0, step)
    sums = run.run(5 + jump + 5)
    assert not run.accepted_between(5.0, 5 + jump - 0.06) and run.gate.dropped['clock went back']
    assert 5 < sums.stops[0] < 5 + TIMEOUT and run.accepted_between(5 + jump + 1, 5 + jump + 5)


def test_the_last_command_before_a_silence_arrives() -> None:
    for seed in range(100):
        run = link(0.5, seed)
        run.at(3.0, setattr, run, 'period', 100.0)
        sums = run.run(4.0)
        assert sums.in_force[-1][1] == len(sums.made)


def test_two_operators_one_drives() -> None:
    run = link(0.0)
    driver: Optional[int] = OPERATOR
    for second in range(5, 20):
        driver = 55 if driver == OPERATOR else OPERATOR
        run.at(second, lambda driver=driver: run.gate.rule(driver, False, 0, run.robot_clock.at(run.now)))
    sums = run.run(20.0)
    for at, number in sums.in_force:
        assert at < 5 or (int(at) % 2 == 0 and sums.made[number - 1] > int(at))
    assert run.gate.dropped['made before control'] and run.gate.dropped['not in control']
