# SPDX-License-Identifier: BSD-3-Clause
"""Threads that keep a rate: the newest of what comes, without backlog, and the same again and again."""
import threading
import time


class RateLimiter:
    """Lets `rate` messages a second through on average; one period of slack forgives a source's jitter."""

    def __init__(self, rate):
        """:param rate: [Hz], > 0"""
        self.rate = rate
        self._next = float('-inf')

    def wait(self, now):
        """How long until the next message may go [s]."""
        return max(0.0, self._next - now)

    def take(self, now):
        """A message goes now."""
        period = 1.0 / self.rate
        # a clock that stepped back must not hold messages for longer than a period
        self._next = min(max(self._next, now - period), now) + period


class NewestWorker:
    """A thread that works on the newest of what it is given, never faster than its rate, once it is started.

    :param work: f(item)
    :param on_error: f(exception), called for what `work` raises; the thread goes on
    """

    def __init__(self, name, work, on_error, rate):
        self.replaced = 0    # items that a newer one replaced before their turn came
        self._work, self._on_error = work, on_error
        self._limiter = RateLimiter(rate)
        self._item, self._ended = None, False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self):
        self._thread.start()

    def give(self, item):
        with self._changed:
            self.replaced += self._item is not None
            self._item = item
            self._changed.notify()

    def set_rate(self, rate):
        with self._changed:
            if rate != self._limiter.rate:      # else a message might go at once, again and again
                self._limiter = RateLimiter(rate)
                self._changed.notify()

    def stop(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread.ident:
            self._thread.join()

    def _next_item(self):
        with self._changed:
            while not self._ended:
                wait = self._limiter.wait(time.monotonic())
                if self._item is not None and wait <= 0:
                    item, self._item = self._item, None
                    self._limiter.take(time.monotonic())
                    return item
                self._changed.wait(wait if self._item is not None else None)
            return None

    def _run(self):
        while True:
            item = self._next_item()
            if item is None:
                return
            try:
                self._work(item)
            except Exception as error:
                self._on_error(error)


class Repeater:
    """A thread that does the same again and again, once it is started.

    :param work: f(), every `period` [s], and at once after `wake`
    :param on_error: f(exception), called for what `work` raises; the thread goes on
    """

    def __init__(self, name, work, on_error, period):
        self._work, self._on_error, self.period = work, on_error, period
        self._wanted, self._ended = threading.Event(), False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self):
        self._thread.start()

    def wake(self):
        self._wanted.set()

    def stop(self):
        self._ended = True
        self._wanted.set()
        if self._thread.ident:
            self._thread.join()

    def _run(self):
        while True:
            self._wanted.wait(self.period)
            self._wanted.clear()
            if self._ended:
                return
            try:
                self._work()
            except Exception as error:
                self._on_error(error)
