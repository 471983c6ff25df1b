# SPDX-License-Identifier: BSD-3-Clause
"""Threads that work on due items: the only loop around pure objects, to which other threads add."""
import contextlib
import math
import threading
import time
from typing import Any, Callable, ContextManager, Generic, Iterator, Optional, TypeVar

Item = TypeVar('Item')

RETRY_PERIOD = 0.1
"""A `poll` or `deadline` that raises is called again after this time, or after a change [s]."""


class DeadlineWorker(Generic[Item]):
    """Takes items from `poll` and works on them, one after the other, once it is started.

    :param name: of the thread
    :param poll: f(now) -> item or None, called under the lock
    :param deadline: f() -> when `poll` returns an item next, by time.monotonic(); None: never; called under the lock
    :param work: f(item), called without the lock
    :param on_error: f(exception), for what `poll` and `work` raise; the thread goes on
    """

    def __init__(self, name: str, poll: Callable[[float], Optional[Item]], deadline: Callable[[], Optional[float]],
                 work: Callable[[Item], None], on_error: Callable[[Exception], None]) -> None:
        self._poll, self._deadline, self._work, self._on_error = poll, deadline, work, on_error
        self._changed = threading.Condition()
        self._closed = False
        self._awaited = -math.inf       # until when the thread waits; -inf: it does not
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    @property
    def lock(self) -> ContextManager[Any]:
        """To be held to read what others change, or to change what `poll` and `deadline` do not depend on."""
        return self._changed

    @contextlib.contextmanager
    def changing(self) -> Iterator[None]:
        """Hold the lock to change what `poll` and `deadline` depend on."""
        with self._changed:
            yield
            self._changed.notify()

    @contextlib.contextmanager
    def adding(self) -> Iterator[None]:
        """As `changing`, but the thread wakes only if `deadline` has come earlier: for what happens often. `poll` has
        nothing to do before the deadline then."""
        with self._changed:
            yield
            deadline = self._deadline()
            if deadline is not None and deadline < self._awaited:
                self._awaited = -math.inf
                self._changed.notify()

    def close(self) -> None:
        """End the thread, after the item that it works on; without effect where it was not started."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread.ident:
            self._thread.join()

    def _run(self) -> None:
        while not self._closed:
            try:
                item = self._await_item()
            except Exception as error:      # what it has to do stays due
                self._on_error(error)
                self._pause()
                continue
            if item is not None:
                self._attempt(item)

    def _attempt(self, item: Item) -> None:
        try:
            self._work(item)
        except Exception as error:      # the next item may be good
            self._on_error(error)

    def _pause(self) -> None:
        """Wait for a change, or RETRY_PERIOD."""
        with self._changed:
            if not self._closed:
                self._changed.wait(RETRY_PERIOD)

    def _await_item(self) -> Optional[Item]:
        """The next item; None: the thread is to end."""
        with self._changed:
            while not self._closed:
                item = self._poll(time.monotonic())
                if item is not None:
                    return item
                deadline = self._deadline()
                self._awaited = math.inf if deadline is None else deadline
                self._changed.wait(
                    None if self._awaited == math.inf else max(0.0, self._awaited - time.monotonic()))
                self._awaited = -math.inf
            return None


class PeriodicWorker:
    """A thread that does the same work periodically.

    :param work: f(), called a period after it was started and after each time, and at once after `wake`
    :param on_error: f(exception), for what `work` raises; the thread goes on
    :param period: [s]; None: only after `wake`
    """

    def __init__(self, name: str, work: Callable[[], None], on_error: Callable[[Exception], None],
                 period: Optional[float]) -> None:
        self._work = work
        self._period = math.inf if period is None else period
        self._next = math.inf
        self._worker: DeadlineWorker[bool] = DeadlineWorker(name, self._poll, self._deadline, self._do, on_error)

    def start(self) -> None:
        self._next = min(self._next, time.monotonic() + self._period)
        self._worker.start()

    def wake(self) -> None:
        """Work at once; before `start`: as soon as it is started."""
        with self._worker.changing():
            self._next = -math.inf

    def close(self) -> None:
        """End the thread after its present work; without effect where it was not started."""
        self._worker.close()

    def _deadline(self) -> Optional[float]:
        return None if self._next == math.inf else self._next

    def _poll(self, now: float) -> Optional[bool]:
        if self._next > now:
            return None
        self._next = math.inf
        return True

    def _do(self, _: bool) -> None:
        try:
            self._work()
        finally:
            with self._worker.changing():      # after a `wake` in the meantime it works again at once
                self._next = min(self._next, time.monotonic() + self._period)
