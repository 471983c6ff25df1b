# SPDX-License-Identifier: BSD-3-Clause
"""When packet trains leave, how long and how fast they are."""
import math
from typing import Optional

import pytest

from smokebot_udp.congestion.feedback import Feedback, PacketSample
from smokebot_udp.congestion.path import Observation
from smokebot_udp.congestion.trains import (
    AT_ONCE,
    BEYOND,
    BEYOND_NOISE,
    CLEAR_RETRY_INTERVAL,
    DUE_TIME,
    DURATION,
    FILLED,
    FIRST_GAIN,
    GROWTH,
    LASTING,
    MAX_LASTING_STEP,
    MAX_PLANNED,
    MAX_RETRY_INTERVAL,
    MAX_STEP,
    NEXT_GAIN,
    REACHED,
    REFILL_INTERVALS,
    RETRY_INTERVAL,
    TIMEOUT,
    ProbeController,
    Train,
    TrainTracker,
)


def newest(total: int) -> PacketSample:
    return PacketSample(0.0, 0.0, 1000, total)


def due(probes: ProbeController, capacity: float, total: int, now: float, unreported: int = 0, depth: float = 0.0,
        empty: bool = True, wanted: bool = True, wished: bool = False, noise: float = 0.01, wait: float = 0.0
        ) -> Optional[Train]:
    chain = [newest(total)]
    seen = Observation(now, Feedback(chain, 0.01, 1, 1, unreported, False), chain, [wait], chain[0], wait, noise, 0.0,
                       0.0, 0.0, 0.0)
    return probes.next(seen, capacity, depth, depth > 0, empty, wanted, wished)


def test_trains_get_faster_after_success_and_wait_after_failure() -> None:
    probes, capacity = ProbeController(), 1e6
    first = due(probes, capacity, 50000, 1.0, 2000, noise=0.0)
    assert first == (FIRST_GAIN * capacity, DURATION * capacity)
    assert due(probes, capacity, 50000, 1.1, 2000) is None         # it has not come
    came = 52000 + int(first.size)
    second = due(probes, 2 * capacity, came, 1.2)       # it is longer where delays are noisy
    assert second == (NEXT_GAIN * 2 * capacity, FIRST_GAIN * BEYOND_NOISE * 0.01 * 2 * capacity)
    came += int(second.size)
    assert due(probes, 2 * capacity, came, 1.3, empty=False) is None     # it brought nothing but a queue
    assert due(probes, 2 * capacity, came, 1.2 + RETRY_INTERVAL) is None
    third = due(probes, 2 * capacity, came, 1.3 + RETRY_INTERVAL)
    assert third is not None and third.rate == FIRST_GAIN * 2 * capacity


def test_a_train_that_left_no_queue_is_followed_soon() -> None:
    """As after the loss of most of it: it cost nothing, and showed nothing."""
    probes, capacity = ProbeController(), 1e6
    first = due(probes, capacity, 0, 1.0)
    assert first is not None
    assert due(probes, capacity, int(first.size), 1.1) is None
    assert due(probes, capacity, int(first.size), 1.05 + CLEAR_RETRY_INTERVAL) is None
    assert due(probes, capacity, int(first.size), 1.15 + CLEAR_RETRY_INTERVAL) is not None


def test_no_train_leaves_unless_more_is_wanted() -> None:
    assert due(ProbeController(), 1e6, 50000, 1.0, wanted=False) is None


def test_where_streams_only_wish_for_more_trains_that_bring_nothing_become_rare() -> None:
    probes, trains, total, now = ProbeController(), [], 0, 0.0
    for step in range(1200):
        now, total = 0.1 * step, total + 100000
        if due(probes, 1e6, total, now, wanted=False, wished=True) is not None:
            trains.append(now)
    waits = [later - earlier for earlier, later in zip(trains, trains[1:])]
    assert waits[0] < 1.5 * RETRY_INTERVAL and waits[1] > 1.5 * waits[0]
    assert 0.9 * MAX_RETRY_INTERVAL < waits[-1] < 1.1 * MAX_RETRY_INTERVAL
    probes.retry()
    assert due(probes, 1e6, total, now + 2 * TIMEOUT, wanted=False, wished=True) is not None


@pytest.mark.parametrize('empty, gain, later', [(True, NEXT_GAIN, 0.1), (False, FIRST_GAIN, 0.1 + RETRY_INTERVAL)])
def test_a_train_beside_a_queue_proves_no_wider_link_as_others_may_have_paused(empty: bool, gain: float,
                                                                               later: float) -> None:
    probes = ProbeController()
    first = due(probes, 1e6, 0, 10.0, empty=empty)
    assert first is not None and first.rate == FIRST_GAIN * 1e6
    second = due(probes, 2e6, int(first.size), 10.1)
    assert (second is not None) == empty
    second = second or due(probes, 2e6, int(first.size), 10.0 + later)
    assert second is not None and second.rate == gain * 2e6


def test_a_train_exceeds_the_tokens_of_a_shaper_and_streams_are_planned_for_it() -> None:
    probes, capacity, depth = ProbeController(), 1e5, 6000.0
    train = due(probes, capacity, 0, 1.0, depth=depth)
    assert train is not None and train.rate == AT_ONCE * capacity
    message, ordinary = train.size - DUE_TIME * capacity, DUE_TIME * 0.9 * capacity
    # a message that fills it has the tokens, those that come meanwhile, and enough beyond
    assert FILLED * message * (1 - 1 / AT_ONCE) == pytest.approx(depth + (BEYOND + BEYOND_NOISE * 0.01) * capacity)
    assert message < MAX_PLANNED * DUE_TIME * capacity
    budget = 0.9 * capacity
    assert probes.planned(budget, 0) == pytest.approx(message / (DUE_TIME * budget))
    assert probes.planned(budget, ordinary) == probes.planned(budget, 0)    # this one was being made before
    assert probes.planned(budget, FILLED * message) < 1.3                   # the one after it is none of the train
    assert probes.planned(budget, ordinary + FILLED * message) == 1
    quiet = due(ProbeController(), capacity, 0, 1.0, depth=depth, noise=0.0)
    assert quiet is not None and quiet.size < train.size - 0.03 * capacity
    assert probes.most(0.9 * LASTING * capacity) == pytest.approx(MAX_STEP * capacity)
    assert probes.most(1.1 * LASTING * capacity) == pytest.approx(MAX_LASTING_STEP * capacity)
    assert ProbeController().planned(capacity, 0) == 1


def test_a_train_that_waited_behind_a_shaper_is_followed_once_there_are_tokens() -> None:
    probes, capacity, depth = ProbeController(), 1e5, 6000.0
    train = due(probes, capacity, 0, 1.0, depth=depth)
    assert train is not None
    came, retry = math.ceil(train.size), RETRY_INTERVAL + REFILL_INTERVALS * depth / capacity
    assert due(probes, capacity, came - 1, 1.2, depth=depth, wait=0.05) is None
    assert due(probes, capacity, came, 1.3, depth=depth) is None
    assert due(probes, capacity, came, 1.25 + retry, depth=depth) is None
    assert due(probes, capacity, came, 1.35 + retry, depth=depth) is not None


@pytest.mark.parametrize('depth', [6000.0, 500.0])
def test_a_train_for_which_too_little_was_due_is_followed_soon(depth: float) -> None:
    """Behind a shaper, too: where nothing waited, it cost nothing. What is no more than a datagram is no shaper."""
    probes, capacity = ProbeController(), 1e5
    train = due(probes, capacity, 0, 1.0, depth=depth)
    assert train is not None and due(probes, capacity, math.ceil(train.size), 1.3, depth=depth) is None
    assert due(probes, capacity, math.ceil(train.size), 1.35 + CLEAR_RETRY_INTERVAL, depth=depth) is not None


def test_a_train_behind_a_shaper_that_showed_more_is_followed_at_once() -> None:
    """What was to leave beside it shows nothing."""
    probes, capacity, depth = ProbeController(), 1e5, 6000.0
    train = due(probes, capacity, 0, 1.0, depth=depth)
    assert train is not None
    again = due(probes, 2 * capacity, math.ceil(train.size - DUE_TIME * capacity), 1.1, depth=depth)
    assert again is not None and again.rate == AT_ONCE * 2 * capacity


def test_a_short_datagram_makes_no_train_behind_a_shaper_shorter() -> None:
    capacity, depth = 4e4, 3000.0
    chain = [newest(5000), newest(5100)._replace(size=100)]
    seen = Observation(1.0, Feedback(chain, 0.01, 2, 2, 0, False), chain, [0.0, 0.0], chain[0], 0.0, 0.0, 0.0, 0.0, 0.0,
                       0.0)
    assert ProbeController().next(seen, capacity, depth, True, True, True, False) == due(
        ProbeController(), capacity, 5100, 1.0, depth=depth, noise=0.0)


def test_beside_others_a_train_of_a_few_datagrams_is_no_test() -> None:
    """The queue is occupied: it would only arrive later. What counts is the datagram that shows so: a longer one would
    keep a sender without trains that a TCP download has pushed aside."""
    probes, capacity = ProbeController(), 1e5
    chain = [newest(5000), newest(5100)._replace(size=800)]
    seen = Observation(9.0, Feedback(chain, 0.01, 2, 2, 0, False), chain, [0.1, 0.1], chain[0], 0.1, 0.0, 0.0, 0.0, 0.0,
                       0.0)
    assert probes.next(seen, capacity, 0.0, False, False, True, False) is not None
    assert ProbeController().next(seen, 0.9 * capacity, 0.0, False, False, True, False) is None


def test_a_train_for_a_deep_bucket_is_as_long_as_it_takes_to_empty_it() -> None:
    capacity, depth = 4e4, 32000.0
    train = due(ProbeController(), capacity, 0, 1.0, depth=depth)
    assert train is not None and train.rate == NEXT_GAIN * capacity
    duration = train.size / (REACHED * MAX_PLANNED * capacity)
    assert (train.size - depth) / duration == pytest.approx(GROWTH * capacity)



def test_a_train_is_followed_until_it_was_reported_or_is_lost() -> None:
    trains = TrainTracker()
    assert trains.ended(newest(0), 0.0) is None
    trains.leave(Train(1e6, 5000.0), newest(1000), 500, 10.0, 1.0)
    assert trains.on_the_way is not None and (trains.on_the_way.begins, trains.on_the_way.ends) == (1500, 6500)
    assert trains.ended(newest(6000), 10.5) is None and not trains.arrived(newest(6000))
    assert trains.arrived(newest(6500)) and trains.ended(newest(6500), 10.5) is not None and trains.on_the_way is None
    for cut, now in ((True, 10.1), (False, 11.0)):
        trains.leave(Train(1e6, 5000.0), newest(0), 0, 10.0, 1.0)
        assert trains.ended(newest(10), now, cut) is not None
