# SPDX-License-Identifier: BSD-3-Clause
"""Which states are sent when, and what the other side makes of them."""
import math
from typing import Any, Dict, List, Sequence, Tuple

import pytest

from smokebot_udp.reliable.carousel import (
    ALIVE,
    ENDED_AFTER,
    INTERVAL,
    KEPT_FOR,
    LIFE_SIGN,
    MAX_DEBT,
    MAX_STATES,
    OVERHEAD,
    REFRESH,
    Carousel,
    Kept,
)

ROOM = 300


def size(states: Sequence[bytes]) -> int:
    return sum(map(len, states))


def carousel() -> Carousel:
    return Carousel(lambda name: b'end of ' + name.encode())


class Link:
    """Sources that report once a second, and what is sent of it."""

    def __init__(self, rate: float, *names: str, changing: bool = True) -> None:
        self.carousel, self.rate, self.names, self.changing = carousel(), rate, list(names), changing
        self.now, self.number = 100.0, 0
        self.levels: Dict[str, int] = {}
        self.batches: List[Tuple[float, List[bytes]]] = []

    def run(self, seconds: float) -> List[Tuple[float, List[bytes]]]:
        """(when, states) of each batch that is sent meanwhile."""
        first, end = len(self.batches), self.now + seconds
        while self.now < end:
            if self.number % 20 == 0:
                for name in self.names:
                    value = self.number if self.changing else 0
                    self.carousel.put(name, self.levels.get(name, 0), b'%-8s%052d' % (name.encode(), value), self.now)
            self.number += 1
            states = self.carousel.take(self.rate, size, ROOM, self.now)
            if states:
                self.batches.append((self.now, states))
            self.now += 0.05
        return self.batches[first:]


NAMES = ['s%d' % number for number in range(40)]


def gaps(batches: List[Tuple[float, List[bytes]]]) -> List[float]:
    return [later - earlier for (earlier, _), (later, _) in zip(batches, batches[1:])]


def test_on_a_fast_link_all_are_sent_each_second() -> None:
    link = Link(math.inf, *NAMES)
    assert [len(states) for _, states in link.run(10.0)] == [40] * 10


@pytest.mark.parametrize('changing', [True, False])
def test_on_a_slow_link_they_take_turns(changing: bool) -> None:
    """40 states of 60 bytes, with the overhead 3.2 kB, at 300 bytes a second."""
    link = Link(300.0, *NAMES, changing=changing)
    first = link.run(1.0)
    assert size([state for _, states in first for state in states]) == 2400      # a new peer gets all at once
    link.run(20.0)
    batches = link.run(60.0)
    assert sum(size(states) + OVERHEAD for _, states in batches) <= 60 * 300.0 + ROOM + OVERHEAD
    assert max(gaps(link.batches)) <= LIFE_SIGN + 0.06 < ALIVE
    for name in NAMES:
        times = [now for now, states in batches if any(state.startswith(b'%-8s' % name.encode()) for state in states)]
        assert max(later - earlier for earlier, later in zip(times, times[1:])) < 13.0
    assert {len(states) for _, states in batches} == {5} or not changing


def test_a_level_that_changes_is_sent_at_once() -> None:
    link = Link(100.0, *NAMES)
    link.run(30.0)
    for level in (2, 0, 1):
        link.levels['s17'] = level
        link.number = 0     # sources report
        when, states = link.run(0.06)[0]
        assert states[0].startswith(b's17 ')


def test_levels_that_change_all_the_time_are_bounded() -> None:
    link, sent = Link(100.0, *NAMES), 0
    for number in range(60):
        link.levels = dict.fromkeys(NAMES, number)
        sent += sum(size(states) + OVERHEAD for _, states in link.run(1.0))
    assert sent < 100.0 * (60 + MAX_DEBT) + ROOM + OVERHEAD + 30 * (60 + OVERHEAD)      # signs of life, too


def test_what_stays_the_same_is_refreshed_slowly() -> None:
    link = Link(1e5, 'a', 'b', changing=False)
    link.run(INTERVAL)
    batches = link.run(60.0)
    assert len([state for _, states in batches for state in states if state.startswith(b'a ')]) == pytest.approx(
        60.0 / (2 * LIFE_SIGN), abs=1) and 2 * LIFE_SIGN < REFRESH
    assert max(gaps(batches)) <= LIFE_SIGN + 0.06


def test_what_is_reported_no_more_ends_once() -> None:
    link = Link(1e5, 'a', 'b')
    link.run(3.0)
    link.names = ['b']
    sent = [state for _, states in link.run(2 * ENDED_AFTER) for state in states]
    assert sent.count(b'end of a') == 1 and sent[-1].startswith(b'b')
    link.names = ['a', 'b']
    assert any(state.startswith(b'a ') for _, states in link.run(1.0) for state in states)


def test_what_may_not_have_arrived_is_sent_again() -> None:
    link = Link(1e5, 'a', 'b', changing=False)
    link.run(INTERVAL)
    link.carousel.renew()
    assert [len(states) for _, states in link.run(0.06)] == [2]


def test_states_without_end_take_no_memory() -> None:
    one = carousel()
    for number in range(2 * MAX_STATES):
        one.put(str(number), 0, b'x', 0.0)
    assert len(one.take(math.inf, size, ROOM, 0.0)) == MAX_STATES
    kept: Kept[int] = Kept()
    for number in range(2 * MAX_STATES):
        kept.put(str(number), number, 0.0)
    assert kept.states(0.0) == list(range(MAX_STATES))


def test_the_other_side_keeps_what_came_while_anything_comes() -> None:
    kept: Kept[Any] = Kept()
    assert kept.states(0.0) == []
    kept.put('a', 'a1', 1.0)
    kept.put('b', 'b1', 1.0)
    kept.put('a', 'a2', 3.0)
    assert kept.states(3.0 + ALIVE) == ['a2', 'b1'] and kept.states(3.1 + ALIVE) == []
    kept.end('b', 20.0)
    assert kept.states(20.0) == ['a2']
    kept.put('c', 'c1', 3.0 + KEPT_FOR + 1)
    assert kept.states(3.0 + KEPT_FOR + 1) == ['c1']
    kept.clear()
    assert kept.states(3.0 + KEPT_FOR + 1) == []
