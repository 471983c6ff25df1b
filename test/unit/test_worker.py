# SPDX-License-Identifier: BSD-3-Clause
import threading
import time
from typing import Any, List, Optional, Tuple

from polling import WAIT

from smokebot_udp.nodes.worker import DeadlineWorker, PeriodicWorker


class Due:
    """Items at their times."""

    def __init__(self, *times: float) -> None:
        self.times = list(times)

    def deadline(self) -> Optional[float]:
        return self.times[0] if self.times else None

    def poll(self, now: float) -> Optional[float]:
        return self.times.pop(0) if self.times and self.times[0] <= now else None


def test_it_works_when_something_is_due_and_errors_do_not_end_the_thread() -> None:
    done, errors, due = threading.Semaphore(0), [], Due()

    def work(planned: float) -> None:
        assert time.monotonic() >= planned
        done.release()
        raise ValueError('that was %g' % planned)

    worker = DeadlineWorker('worker', due.poll, due.deadline, work, errors.append)
    worker.start()
    soon = time.monotonic() + 0.05
    with worker.changing():
        due.times += [0.0, soon]
    assert done.acquire(timeout=WAIT) and done.acquire(timeout=WAIT)
    assert time.monotonic() >= soon
    worker.close()
    assert [str(error) for error in errors] == ['that was 0', 'that was %g' % soon]


def test_it_ends_without_waiting_for_what_is_not_due() -> None:
    for due in Due(), Due(time.monotonic() + 1000):
        worker = DeadlineWorker('worker', due.poll, due.deadline, lambda item: None, lambda error: None)
        worker.start()
        began = time.monotonic()
        worker.close()
        assert time.monotonic() - began < 10


class Times:
    """Work that notes when it was done, and may fail."""

    def __init__(self, failing: Tuple[int, ...] = ()) -> None:
        self.times: List[float] = []
        self.errors: List[Any] = []
        self._failing, self._done = failing, threading.Semaphore(0)

    def __call__(self) -> None:
        self.times.append(time.monotonic())
        self._done.release()
        if len(self.times) in self._failing:
            raise ValueError('time %d' % len(self.times))

    def wait(self, count: int) -> None:
        assert all(self._done.acquire(timeout=WAIT) for _ in range(count))


def test_the_same_again_and_again_in_spite_of_errors() -> None:
    work = Times(failing=(1, 2))
    worker = PeriodicWorker('periodic', work, work.errors.append, 0.05)
    began = time.monotonic()
    worker.start()
    work.wait(4)
    worker.close()
    gaps = [after - before for before, after in zip([began] + work.times, work.times)]
    assert min(gaps) >= 0.049 and [str(error) for error in work.errors] == ['time 1', 'time 2']


def test_wake_does_it_at_once_and_stop_waits_for_no_period() -> None:
    for period in (1000.0, None):
        work = Times()
        worker = PeriodicWorker('periodic', work, work.errors.append, period)
        worker.wake()       # before it starts counts, too
        began = time.monotonic()
        worker.start()
        work.wait(1)
        worker.wake()
        work.wait(1)
        worker.close()
        assert time.monotonic() - began < 10 and len(work.times) == 2 and not work.errors


def test_who_is_woken_while_it_works_works_again() -> None:
    busy, free, work = threading.Event(), threading.Event(), Times()

    def slow() -> None:
        busy.set()
        assert free.wait(WAIT)
        work()

    worker = PeriodicWorker('periodic', slow, work.errors.append, 1000.0)
    worker.wake()
    worker.start()
    assert busy.wait(WAIT)
    worker.wake()
    free.set()
    work.wait(2)
    worker.close()
    assert not work.errors


def test_what_never_started_can_be_stopped() -> None:
    PeriodicWorker('periodic', lambda: None, lambda error: None, 1.0).close()
