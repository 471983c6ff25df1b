# SPDX-License-Identifier: BSD-3-Clause
import threading
import time

from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.streams.rate import NewestWorker, RateLimiter, Repeater


def passed(limiter, times):
    """Those of the times at which a message may go at once."""
    gone = []
    for now in times:
        if limiter.wait(now) <= 0:
            limiter.take(now)
            gone.append(now)
    return gone


def test_a_source_at_the_rate_passes_whole_in_spite_of_its_jitter():
    times = [0.1 * k + (0.03 if k % 2 else 0.0) for k in range(100)]
    assert passed(RateLimiter(10.0), times) == times


def test_a_faster_source_is_held_to_the_rate():
    gone = passed(RateLimiter(10.0), [k / 1000 for k in range(10000)])
    assert 100 <= len(gone) <= 102


def test_a_clock_set_back_costs_a_period_at_most():
    limiter = RateLimiter(10.0)
    limiter.take(1000.0)
    limiter.take(1.0)
    assert limiter.wait(1.0) <= 0.1 + 1e-9


def test_the_same_rate_set_again_lets_nothing_through():
    worker = NewestWorker('rare', lambda item: None, lambda error: None, 0.001)
    for _ in range(2):      # one period of slack is a source's jitter
        worker._limiter.take(time.monotonic())
    worker.set_rate(0.001)
    assert worker._limiter.wait(time.monotonic()) > 500
    worker.set_rate(10.0)
    assert worker._limiter.wait(time.monotonic()) == 0


@given(st.floats(0.1, 100.0), st.lists(st.floats(0.0, 0.5), max_size=200))
def test_never_more_than_the_rate(rate, gaps):
    now, times = 0.0, []
    for gap in gaps:
        now += gap
        times.append(now)
    assert len(passed(RateLimiter(rate), times)) <= rate * now + 2


def test_the_newest_wins_and_errors_do_not_end_the_thread():
    busy, free, done = threading.Event(), threading.Event(), threading.Event()
    worked, errors = [], []

    def work(item):
        worked.append(item)
        if item == 'first':
            busy.set()
            free.wait(10)
            raise ValueError('first')
        done.set()

    worker = NewestWorker('worker', work, errors.append, 1000.0)
    worker.start()
    worker.give('first')
    assert busy.wait(10)
    for item in ('old', 'older', 'newest'):
        worker.give(item)
    free.set()
    assert done.wait(10)
    worker.stop()
    assert worked == ['first', 'newest'] and worker.replaced == 2
    assert [str(error) for error in errors] == ['first']


class Times:
    """Work that notes when it was done, and may fail."""

    def __init__(self, failing=()):
        self.times, self.errors, self._failing, self._done = [], [], failing, threading.Semaphore(0)

    def __call__(self):
        self.times.append(time.monotonic())
        self._done.release()
        if len(self.times) in self._failing:
            raise ValueError('time %d' % len(self.times))

    def wait(self, count):
        assert all(self._done.acquire(timeout=10) for _ in range(count))


def test_the_same_again_and_again_in_spite_of_errors():
    work = Times(failing=(1, 2))
    repeater = Repeater('repeater', work, work.errors.append, 0.05)
    began = time.monotonic()
    repeater.start()
    work.wait(4)
    repeater.stop()
    gaps = [after - before for before, after in zip([began] + work.times, work.times)]
    assert min(gaps) >= 0.049 and [str(error) for error in work.errors] == ['time 1', 'time 2']


def test_wake_does_it_at_once_and_stop_waits_for_no_period():
    work = Times()
    repeater = Repeater('repeater', work, work.errors.append, 1000.0)
    repeater.wake()       # before it starts counts, too
    began = time.monotonic()
    repeater.start()
    work.wait(1)
    repeater.wake()
    work.wait(1)
    repeater.stop()
    assert time.monotonic() - began < 10 and len(work.times) == 2 and not work.errors


def test_what_never_started_can_be_stopped():
    Repeater('repeater', None, None, 1.0).stop()
