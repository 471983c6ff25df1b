# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.udpros.sequence import JUMP, MAX_GAP, WINDOW, SequenceTracker

WRAP = 1 << 32


def tracker_after(*batches) -> Any:
    tracker = SequenceTracker()
    for batch in batches:
        tracker.add(np.array(batch, np.uint64).astype(np.uint32))
    return tracker


def test_by_hand() -> None:
    tracker = SequenceTracker()
    assert tracker.add([5, 6, 7]).tolist() == [True] * 3
    assert tracker.add([9, 7, 9]).tolist() == [True, False, False]      # 8 is missing, 7 and 9 are duplicates
    assert (tracker.received, tracker.lost) == (4, 1)
    assert tracker.add([8]).tolist() == [True]                          # it was only late
    assert (tracker.received, tracker.lost) == (5, 0)
    assert tracker.add([]).tolist() == []


def test_counting_begins_with_the_lowest_number() -> None:
    assert tracker_after([50, 48, 51]).lost == 1      # 49; those before 48 are not this connection's


def test_wrap() -> None:
    tracker = SequenceTracker()
    assert tracker.add(np.array([WRAP - 2, WRAP - 1, 0, 2], np.uint32)).all()
    assert (tracker.received, tracker.lost) == (4, 1)
    assert tracker.add(np.array([WRAP - 1, 1], np.uint32)).tolist() == [False, True]
    assert (tracker.received, tracker.lost) == (5, 0)


def test_a_gap_larger_than_the_window_within_a_batch_costs_no_message() -> None:
    tracker = SequenceTracker()
    batch = [*range(100, 160), *range(100000, 100060)]
    assert tracker.add(batch).all()
    assert (tracker.received, tracker.lost) == (120, 100000 - 160)


def test_a_batch_longer_than_the_window() -> None:
    tracker = SequenceTracker()
    assert tracker.add(np.arange(3 * WINDOW)).all()
    assert (tracker.received, tracker.lost) == (3 * WINDOW, 0)


def test_late_messages_are_known_up_to_the_window() -> None:
    tracker = tracker_after(range(10000))
    assert tracker.add([10000 - WINDOW]).tolist() == [False]
    assert tracker.add([9999]).tolist() == [False]
    assert (tracker.received, tracker.lost) == (10000, 0)


def test_the_windows_places_are_used_again() -> None:
    tracker = tracker_after(range(WINDOW - 5, WINDOW + 5))      # past the ring's end, and back to its beginning
    assert tracker.add(range(WINDOW - 5, WINDOW + 5)).tolist() == [False] * 10
    tracker = tracker_after(range(WINDOW))
    assert tracker.add([WINDOW + 5]).tolist() == [True]
    assert tracker.lost == 5
    assert tracker.add([WINDOW + 2, 6]).tolist() == [True, False]


def test_a_publisher_that_restarts() -> None:
    tracker = tracker_after(range(20000, 20100), [20105])
    for seq in (1, 2, 3):                             # one by one, as from a slow topic
        assert tracker.add([seq]).tolist() == [True]
    assert tracker.add([4, 6, 6]).tolist() == [True, True, False]
    assert (tracker.received, tracker.lost) == (101 + 5, 5 + 1)


def test_a_publisher_that_jumps_far_ahead() -> None:
    tracker = tracker_after(range(100), range(5 * JUMP, 5 * JUMP + 100))
    assert (tracker.received, tracker.lost) == (200, 0)
    tracker = tracker_after(range(1 << 31, 5 + (1 << 31)), [WRAP - 1, 0])
    assert (tracker.received, tracker.lost) == (7, 0)


def test_a_stray_number_harms_nothing() -> None:
    tracker = SequenceTracker()
    assert tracker.add([10, 11, 3 << 29, 12, 13, 13]).tolist() == [True] * 5 + [False]
    assert tracker.add([14, 16]).tolist() == [True, True]
    assert (tracker.received, tracker.lost) == (6, 1)
    assert tracker.add([3 << 30, 3 << 30]).tolist() == [True, False]
    assert (tracker.received, tracker.lost) == (6, 1)


def test_the_next_number_alone() -> None:
    tracker, batch = SequenceTracker(), SequenceTracker()
    assert not tracker.add_next(7)          # there is no next one yet
    duplicates = 0
    for number in (7, 8, 8, 10, 9, 11, 1 << 30, 12):
        fresh = bool(batch.add([number])[0])
        assert (tracker.add_next(number) or bool(tracker.add([number])[0])) == fresh
        duplicates += not fresh
    assert not tracker.add_next(12) and not tracker.add_next(14 + MAX_GAP)
    assert (tracker.received, tracker.lost, duplicates) == (batch.received, batch.lost, duplicates) == (6, 0, 1)
    assert tracker.add_next(13) and not tracker.add([13])[0]
    near_the_end = tracker_after([WRAP - 1])
    assert near_the_end.add_next(0) and near_the_end.lost == 0


@st.composite
def arrivals(draw) -> Any:
    """Numbers around a steadily rising one: lost, late, repeated; cut into batches; anywhere up to the wrap."""
    offsets = draw(st.lists(st.tuples(st.integers(0, 40), st.integers(-60, 3)), min_size=1, max_size=200))
    begin = draw(st.one_of(st.integers(0, 2 * WINDOW), st.integers(WRAP - 3000, WRAP + 3000)))
    steps = np.cumsum([0] + [step for step, _ in offsets[1:]])
    numbers = [begin + 100 + int(at) + shift for at, (_, shift) in zip(steps, offsets)]
    cuts = sorted(draw(st.lists(st.integers(0, len(numbers)), max_size=8)))
    return [numbers[a:b] for a, b in zip([0] + cuts, cuts + [len(numbers)])]


@given(arrivals())
def test_one_by_one_as_in_batches(batches) -> None:
    tracker, batch = SequenceTracker(), SequenceTracker()
    for number in sum(batches, []):
        number %= WRAP
        assert (tracker.add_next(number) or bool(tracker.add([number])[0])) == bool(batch.add([number])[0])
        assert (tracker.received, tracker.lost) == (batch.received, batch.lost)


@given(arrivals())
def test_as_a_set_would_count(batches) -> None:
    tracker, seen = SequenceTracker(), set()
    for batch in batches:
        fresh = []
        for number in batch:
            fresh.append(number not in seen)
            seen.add(number)
        assert tracker.add(np.array(batch, np.uint64).astype(np.uint32)).tolist() == fresh
        if seen:
            assert tracker.lost == max(seen) - min(seen) + 1 - len(seen)
        assert tracker.received == len(seen)


@given(st.lists(st.lists(st.one_of(st.integers(0, 30), st.integers(4000, 4200), st.integers(0, WRAP - 1)), max_size=30),
                max_size=20))
@settings(max_examples=300)
def test_whatever_comes_nothing_is_negative_and_nothing_unseen_is_held_back(batches) -> None:
    tracker, seen, passed = SequenceTracker(), set(), 0
    for batch in batches:
        fresh = tracker.add(np.array(batch, np.uint32))
        for number, new in zip(batch, fresh.tolist()):
            assert new or number in seen
            seen.add(number)
        passed += int(np.count_nonzero(fresh))
        assert tracker.lost >= 0
        assert tracker.received <= passed


@given(st.lists(st.integers(0, WRAP - 1), max_size=40), st.lists(st.integers(1, 5), max_size=40))
def test_batches_make_no_difference(numbers, sizes) -> None:
    whole, parts = SequenceTracker(), SequenceTracker()
    numbers = np.array(numbers + list(range(7, 60)) + numbers, np.uint32)
    fresh, at = [], 0
    for size in sizes + [len(numbers)]:
        fresh += parts.add(numbers[at:at + size]).tolist()
        at += size
    assert whole.add(numbers).tolist() == fresh
    assert (whole.received, whole.lost) == (parts.received, parts.lost)
