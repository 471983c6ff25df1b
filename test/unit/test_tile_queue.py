# SPDX-License-Identifier: BSD-3-Clause
import math
import random
from typing import Dict, List, Set

import needs_numba  # noqa: F401
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.tiles.tiling import Rectangle
from smokebot_udp.streams.grid.copies import ROUND_TRIP, Pattern
from smokebot_udp.streams.grid.tile_queue import HEAD, SILENCE, Item, TileQueue
from smokebot_udp.streams.held import Holding

CALM = Pattern(0.0, 5.0)


def item(revision: int, column: int = 0, urgent: bool = False) -> Item:
    return Item(revision, Rectangle(column, 0, 10, 10), b'x' * 100, urgent)


def due(queue: TileQueue, now: float, pattern: Pattern = CALM, focus: object = None) -> List[int]:
    return [one.revision for one in queue.due(now, pattern, focus)]     # type: ignore[arg-type]


def send_all(queue: TileQueue, now: float, pattern: Pattern = CALM) -> List[int]:
    items = queue.due(now, pattern, None)
    for one in items:
        queue.sent(one, now)
    return [one.revision for one in items]


def test_changes_come_first_then_what_is_near() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1, 500), item(2, 100), item(3, 300, urgent=True), item(4, 0)])
    assert due(queue, 0.0, focus=(105.0, 5.0)) == [3, 2, 4, 1]
    queue.sent(item(3, 300, urgent=True), 0.0)
    assert due(queue, 0.0, focus=(505.0, 5.0)) == [1, 2, 4]


def test_what_was_sent_waits_for_a_report() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1), item(2)])
    assert send_all(queue, 0.0) == [1, 2] and due(queue, 0.2) == [] and queue.next(0.2, CALM) == ROUND_TRIP
    queue.held('a', Holding(7, ((2, 1),)), 0.25)
    assert due(queue, ROUND_TRIP) == [1] and queue.wanted(0.25) == 100 + HEAD
    queue.held('a', Holding(7, ((1, 2),)), 0.4)
    assert due(queue, 100.0) == [] and queue.lacking() == [] and queue.next(0.4, CALM) == math.inf


def test_a_newcomer_gets_what_it_lacks_and_the_others_nothing_again() -> None:
    queue = TileQueue()
    assert queue.attend(['a'], 0.0)
    queue.add([item(1), item(2)])
    send_all(queue, 0.0)
    queue.held('a', Holding(7, ((1, 2),)), 0.1)
    assert not queue.attend(['a'], 1.0) and queue.attend(['a', 'b'], 1.0)
    assert due(queue, 1.0) == [1, 2]
    queue.held('b', Holding(7, ((1, 1),)), 1.1)
    assert due(queue, 1.1) == [2]
    queue.attend(['a'], 1.2)
    assert due(queue, 1.2) == []


def test_a_restarted_operator_gets_everything_at_once() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1), item(2)])
    send_all(queue, 0.0)
    queue.held('a', Holding(7, ((1, 2),)), 0.1)
    queue.held('a', None, 1.0)
    assert due(queue, 1.0) == [1, 2]


def test_tiles_that_are_no_more_are_not_sent() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1), item(2)])
    queue.remove([1])
    queue.held('a', Holding(7, ((1, 1),)), 0.0)
    assert due(queue, 0.0) == [2]


def test_silent_operators_cost_a_slow_cycle() -> None:
    queue = TileQueue()
    queue.attend(['silent'], 0.0)
    queue.add([item(revision) for revision in range(1, 11)])
    sent, now = 0, 0.0
    while now < 100.0:
        sent += len(send_all(queue, now))
        now += 0.1
    fast, slow = SILENCE / ROUND_TRIP, (100 - SILENCE) / CALM.slow
    assert 10 * slow <= sent <= 10 * (fast + slow + 1)
    assert queue.wanted(now) == 0       # nothing is reserved for it


def test_an_operator_who_falls_silent_is_forgotten_without_a_burst() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1)])
    send_all(queue, 0.0)
    queue.held('a', Holding(7, ((1, 1),)), 0.1)
    queue.attend(['a'], SILENCE)
    assert queue.lacking() == []
    queue.attend(['a'], SILENCE + 0.2)
    assert queue.lacking() and due(queue, SILENCE + 0.2) == [1]
    send_all(queue, SILENCE + 0.2)
    assert due(queue, SILENCE + 0.2 + CALM.slow - 0.1) == []


def test_reports_of_strangers_change_nothing() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1)])
    queue.held('b', Holding(7, ((1, 1),)), 0.0)
    assert due(queue, 0.0) == [1]


def test_an_operator_who_acknowledges_nothing_is_served_more_and_more_rarely() -> None:
    queue = TileQueue()
    queue.attend(['a'], 0.0)
    queue.add([item(1)])
    times, now = [], 0.0
    while now < 60.0:
        queue.held('a', Holding(7, ()), now)
        times += [now] * len(send_all(queue, now))
        now += 0.05
    assert len(times) < 40 and times[-1] - times[-2] >= CALM.slow - 0.1


@settings(deadline=None)
@given(st.integers(0, 10 ** 6), st.floats(0.0, 0.9), st.integers(1, 3))
def test_everything_arrives_everywhere_and_nothing_is_sent_that_all_hold(seed: int, loss: float, people: int) -> None:
    chance, queue, now = random.Random(seed), TileQueue(), 0.0
    names = ['op%d' % number for number in range(people)]
    shown: Dict[str, Set[int]] = {name: set() for name in names}
    queue.attend(names, now)
    queue.add([item(revision) for revision in range(1, 8)])
    pattern, live = Pattern(loss, 5.0), list(range(1, 8))
    while now < 100.0 and any(len(held) < 7 for held in shown.values()):
        queue.attend(names, now)
        for one in queue.due(now, pattern, None):
            assert one in queue.lacking()
            queue.sent(one, now)
            for name in names:
                if chance.random() >= loss:
                    shown[name].add(one.revision)
        for name in names:
            if chance.random() >= loss:
                queue.held(name, Holding.of(7, shown[name]), now)
        if chance.random() < 0.02 and now < 2.0:
            gone = live.pop(0)
            live.append(live[-1] + 1)
            queue.remove([gone])
            queue.add([item(live[-1], urgent=True)])
            for held in shown.values():
                held.discard(gone)
        now += 0.1
    assert all(len(held) == 7 for held in shown.values())
