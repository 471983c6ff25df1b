# SPDX-License-Identifier: BSD-3-Clause
import math
import queue
import threading
import time
from typing import Any, Iterator, List, Optional

import pytest
from polling import WAIT, wait_for

from smokebot_udp.nodes.worker import RETRY_PERIOD, DeadlineWorker


class Source:
    """Items that are due at times."""

    def __init__(self) -> None:
        self.items: List[Any] = []      # [(when, item), ...]
        self.deadlines: List[Optional[float]] = [None]
        """What `deadline` returned."""
        self.done: queue.Queue[Any] = queue.Queue()
        self.errors: queue.Queue[Exception] = queue.Queue()
        self.worker: DeadlineWorker[Any] = DeadlineWorker('worker', self.poll, self.deadline, self.work,
                                                          self.errors.put)

    def poll(self, now: float) -> Optional[Any]:
        return self.items.pop(0)[1] if self.items and self.items[0][0] <= now else None

    def deadline(self) -> Optional[float]:
        self.deadlines.append(self.items[0][0] if self.items else None)
        return self.deadlines[-1]

    def add(self, when: float, item: Any) -> None:
        with self.worker.changing():
            self.items.append((when, item))

    def work(self, item: Any) -> None:
        self.done.put((item, time.monotonic()))
        if isinstance(item, Exception):
            raise item


@pytest.fixture
def source() -> Iterator[Source]:
    made = Source()
    made.worker.start()
    yield made
    made.worker.close()


def test_it_works_in_order_and_not_before_the_time(source: Source) -> None:
    due = time.monotonic() + 0.2
    source.add(-math.inf, 'at once')
    source.add(due, 'later')
    source.add(due, 'then')
    (first, _), (second, at), (third, _) = (source.done.get(timeout=WAIT) for _ in range(3))
    assert (first, second, third) == ('at once', 'later', 'then') and at >= due
    assert source.errors.empty()


def test_an_earlier_deadline_wakes_it(source: Source) -> None:
    source.add(math.inf, 'never')
    wait_for(lambda: source.deadlines[-1] == math.inf)      # it is asked just before the worker waits
    with source.worker.changing():
        source.items.insert(0, (0.0, 'now'))
    assert source.done.get(timeout=WAIT)[0] == 'now' and source.errors.empty()


def test_what_is_added_wakes_it_only_for_an_earlier_deadline(source: Source) -> None:
    due = time.monotonic() + 1e6
    source.add(due, 'far off')
    wait_for(lambda: source.deadlines[-1] == due)
    asked = source.deadlines.count(due)
    with source.worker.adding():
        source.items.append((math.inf, 'never'))
    assert source.deadlines.count(due) == asked + 1     # as it was added; the worker sleeps on
    with source.worker.adding():
        source.items.insert(0, (0.0, 'now'))
    assert source.done.get(timeout=WAIT)[0] == 'now' and source.errors.empty()


def test_after_an_error_it_goes_on(source: Source) -> None:
    source.add(0.0, ValueError('broken'))
    source.add(0.0, 'good')
    assert str(source.errors.get(timeout=WAIT)) == 'broken'
    assert [source.done.get(timeout=WAIT)[0] for _ in range(2)][1] == 'good'


@pytest.mark.parametrize('fails', ['poll', 'deadline'])
def test_what_raises_again_and_again_is_no_busy_loop(source: Source, fails: str) -> None:
    calls: List[float] = []

    def broken(*_: Any) -> None:
        calls.append(time.monotonic())
        raise ValueError('broken')
    good = getattr(source.worker, '_' + fails)
    setattr(source.worker, '_' + fails, broken)
    with source.worker.changing():
        pass
    wait_for(lambda: len(calls) >= 4)
    assert calls[3] - calls[1] >= 2 * RETRY_PERIOD      # the first one may have come before the change
    assert str(source.errors.get(timeout=WAIT)) == 'broken'
    setattr(source.worker, '_' + fails, good)
    source.add(0.0, 'good')
    assert source.done.get(timeout=WAIT)[0] == 'good'


def test_it_works_without_the_lock(source: Source) -> None:
    began, go_on = threading.Event(), threading.Event()
    source.worker.close()
    source.worker = DeadlineWorker('worker', source.poll, source.deadline,
                                   lambda item: began.set() or go_on.wait(WAIT), source.errors.put)
    source.worker.start()
    source.add(0.0, 'slow')
    assert began.wait(WAIT)
    with source.worker.changing():
        source.items.append((math.inf, 'other'))
    go_on.set()


def test_closing_ends_the_thread_and_needs_none() -> None:
    for started in (True, False):
        source, count = Source(), threading.active_count()
        if started:
            source.worker.start()
            source.add(math.inf, 'never')
        source.worker.close()
        source.worker.close()
        assert threading.active_count() == count and source.done.empty() and source.errors.empty()


@pytest.mark.parametrize('broken', ['poll', 'deadline'])
def test_what_cannot_say_what_is_due_is_asked_again_after_a_while(broken: str) -> None:
    source, asked = Source(), []    # type: Source, List[float]

    def fail(*_: float) -> Any:
        asked.append(time.monotonic())
        raise ValueError('broken')
    setattr(source, broken, fail)
    worker: DeadlineWorker[Any] = DeadlineWorker('worker', source.poll, source.deadline, source.work, source.errors.put)
    worker.start()
    for _ in range(3):
        assert str(source.errors.get(timeout=WAIT)) == 'broken'
    worker.close()
    assert min(after - before for before, after in zip(asked, asked[1:])) > 0.9 * RETRY_PERIOD
