# SPDX-License-Identifier: BSD-3-Clause
import random
from typing import List

from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.schedule import Schedule
from smokebot_udp.streams.segments import MAX_SOURCES


def test_the_newest_is_taken_when_its_turn_comes() -> None:
    schedule: Schedule[str] = Schedule(10.0)
    assert schedule.deadline() is None and schedule.take(0.0) is None
    schedule.put('first', 0.0)
    assert schedule.deadline() <= 0.0 and schedule.take(0.0) == 'first' and schedule.take(0.0) is None
    schedule.put('second', 0.0)      # within the slack of one period
    assert schedule.take(0.0) == 'second'
    for item in ('third', 'fourth'):
        schedule.put(item, 0.0)
    assert schedule.deadline() == 0.1 and schedule.take(0.09) is None
    assert schedule.take(0.1) == 'fourth' and schedule.replaced == 1
    assert schedule.deadline() is None


def test_what_is_merged_is_not_replaced() -> None:
    schedule: Schedule[List[int]] = Schedule(10.0)
    items = [1]
    schedule.put(items, 0.0)
    schedule.put(items, 0.0)
    assert schedule.replaced == 0 and schedule.take(0.0) is items


def test_repeats_begin_with_what_was_sent_first() -> None:
    schedule: Schedule[str] = Schedule(10.0, repeat_period=5.0)
    assert schedule.deadline() is None and not schedule.take_repeat(100.0)
    schedule.sent(100.0)
    assert schedule.deadline() == 105.0 and not schedule.take_repeat(104.9)
    assert schedule.take_repeat(106.0) and schedule.deadline() == 111.0
    schedule.sent(108.0)        # what was sent just now is not repeated soon
    assert schedule.deadline() == 113.0


def test_a_repeat_on_demand_does_not_wait() -> None:
    schedule: Schedule[str] = Schedule(10.0, repeat_period=5.0)
    schedule.sent(100.0)
    schedule.wake()
    assert schedule.deadline() <= 100.0 and schedule.take_repeat(101.0)
    assert not schedule.take_repeat(101.0) and schedule.deadline() == 106.0


def test_the_period_changes_in_place() -> None:
    schedule: Schedule[str] = Schedule(10.0, repeat_period=5.0)
    schedule.sent(100.0)
    schedule.repeat_period = 1.0
    assert schedule.deadline() == 101.0
    schedule.repeat_period = None
    schedule.wake()
    assert schedule.deadline() is None and not schedule.take_repeat(1e9)


def test_what_is_due_first_counts() -> None:
    schedule: Schedule[str] = Schedule(10.0, repeat_period=0.05)
    schedule.put('item', 0.0)
    assert schedule.take(0.0) == 'item'
    schedule.sent(0.0)
    for _ in range(2):
        schedule.put('next', 0.0)
        schedule.take(0.0)
    schedule.put('last', 0.0)
    assert schedule.deadline() == 0.05
    schedule.repeat_period = 0.5
    assert schedule.deadline() == 0.1


def test_a_grant_that_differs_in_its_last_digits_lets_no_more_through() -> None:
    """A new limiter for each grant let 190 of 200 messages through: the first one of each leaves at once."""
    source, granted, chance = 10.0, 3.0, random.Random(1)
    schedule: Schedule[int] = Schedule(source)
    schedule.set_rate(granted)
    events = sorted([(k / source + chance.uniform(-0.002, 0.002), 'message') for k in range(200)]
                    + [(k / 10 + 0.05, 'grant') for k in range(200)])
    sent, before = 0, 0.0
    for now, event in events:
        while schedule.waiting() is not None and schedule.deadline() <= now:
            sent += schedule.take(max(before, schedule.deadline())) is not None
        before = now
        if event == 'grant':
            schedule.set_rate(granted * (1 + chance.uniform(-1e-9, 1e-9)))
        else:
            schedule.put(1, now)
    assert 57 <= sent <= 63


def waits(schedule: Schedule[float], times: List[float]) -> List[float]:
    """How long each item that is taken has waited, of items put at these times [s]."""
    found = []
    for now, following in zip(times, times[1:]):
        schedule.put(now, now)
        due = schedule.deadline()
        if due <= following:
            at = max(now, due)
            found.append(at - schedule.take(at))
    return found


def test_one_late_item_delays_no_later_ones() -> None:
    """A stream whose rate was limited for a moment sent images that had waited for 60 ms from then on."""
    schedule: Schedule[float] = Schedule(8.0, steady=True)
    waits(schedule, [0.1 * k for k in range(20)])
    schedule.set_rate(10.0)
    found = waits(schedule, [2.0 + 0.1 * k for k in range(50)])
    assert len(found) >= 48 and max(found) < 0.0031


def test_a_source_with_jitter_keeps_its_rate_and_waits_little() -> None:
    chance = random.Random(3)
    found = waits(Schedule(10.0, steady=True), [0.1 * k + chance.uniform(0.0, 0.02) for k in range(1000)])
    assert len(found) >= 990 and sum(found) / len(found) < 0.002


def test_a_faster_source_is_held_to_the_rate_by_fresh_items() -> None:
    found = waits(Schedule(8.0, steady=True), [0.1 * k for k in range(1000)])
    assert 790 <= len(found) <= 802 and max(found) < 0.0031


def test_the_last_item_of_a_source_that_ends_is_taken() -> None:
    schedule: Schedule[str] = Schedule(8.0, steady=True)
    for number in range(6):
        schedule.put('item', 0.1 * number)
        assert schedule.take(0.1 * number) == 'item'
    schedule.put('last', 0.6)       # its turn is at 0.625
    assert schedule.take(0.7) is None and schedule.take(0.6 + 0.13 + 1e-9) == 'last'


def test_each_source_has_the_rate() -> None:
    schedule: Schedule[str] = Schedule(10.0, steady=True)
    taken = []
    for tick in range(100):
        for number, name in enumerate(('first', 'last', 'strongest')):
            schedule.put('%s %d' % (name, tick), 0.1 * tick + 1e-3 * number, name)
        assert schedule.active(0.1 * tick + 0.01) == 3
        while schedule.waiting('first') or schedule.waiting('last') or schedule.waiting('strongest'):
            taken.append(schedule.take(0.1 * tick + 0.003))
    assert len(taken) == len(set(taken)) == 300 and schedule.replaced == 0
    assert taken[:3] == ['first 0', 'last 0', 'strongest 0']
    assert schedule.active(16.0) == 1


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans(), st.booleans()), max_size=100))
def test_what_is_due_can_be_taken(steps: List) -> None:
    schedule: Schedule[int] = Schedule(3.0, repeat_period=0.7)
    now = 0.0
    for gap, put, wake in steps:
        now += gap
        if put:
            schedule.put(1, now)
        if wake:
            schedule.wake()
        deadline = schedule.deadline()
        due = deadline is not None and deadline <= now
        taken = schedule.take(now)
        if taken is not None:
            schedule.sent(now)
        assert (taken is not None or schedule.take_repeat(now)) == due


def test_only_some_sources_are_remembered() -> None:
    schedule: Schedule[str] = Schedule(10.0)
    for number in range(3 * MAX_SOURCES):
        schedule.put('item', 0.01 * number, 'source %d' % number)
    assert schedule.active(0.3) == MAX_SOURCES
    assert schedule.waiting('source 0') is None and schedule.waiting('source %d' % (3 * MAX_SOURCES - 1)) == 'item'
