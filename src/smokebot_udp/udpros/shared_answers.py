# SPDX-License-Identifier: BSD-3-Clause
"""Answers that several threads need at the same time, of which the question is asked once."""
import threading
import time
from typing import Callable, Dict, Generic, Hashable, Optional, TypeVar

Key = TypeVar('Key', bound=Hashable)
Value = TypeVar('Value')

MAX_KEYS = 256
"""Answers that are remembered."""


class _Answer(Generic[Value]):
    def __init__(self) -> None:
        self.begun = self.ended = -float('inf')
        self.running = False
        self.value: Optional[Value] = None
        self.error: Optional[Exception] = None


class SharedAnswers(Generic[Key, Value]):
    """Shares the answers of a function, which is called once at a time and once a period for each key.

    :param function: f(key); what it raises is shared, too
    :param period: [s]
    """

    def __init__(self, function: Callable[[Key], Value], period: float) -> None:
        self._function, self._period = function, period
        self._answers: Dict[Key, _Answer[Value]] = {}
        self._changed = threading.Condition()

    def ask(self, key: Key, max_age: float = 0.0) -> Value:
        """The function's answer to a question that was asked since this call, or one that came a little before.

        :param max_age: how long before; however long the answer took [s]
        """
        oldest = time.monotonic() - max_age
        with self._changed:
            answer = self._find(key)
            while answer.running or (answer.ended if max_age else answer.begun) < oldest:
                wait = answer.begun + self._period - time.monotonic()
                if not answer.running and wait <= 0:
                    break
                self._changed.wait(None if answer.running else wait)
            else:
                return _value(answer)
            answer.running, answer.begun = True, time.monotonic()
        value, error = None, None
        try:
            value = self._function(key)
        except Exception as raised:
            error = raised
        with self._changed:
            answer.running, answer.value, answer.error, answer.ended = False, value, error, time.monotonic()
            self._changed.notify_all()
            return _value(answer)

    def _find(self, key: Key) -> '_Answer[Value]':
        if key not in self._answers:
            if len(self._answers) >= MAX_KEYS:
                old = [key for key, answer in self._answers.items() if not answer.running]
                for name in old[:len(self._answers) - MAX_KEYS + 1]:
                    del self._answers[name]
            self._answers[key] = _Answer()
        return self._answers[key]


def _value(answer: '_Answer[Value]') -> Value:
    if answer.error is not None:
        raise answer.error
    value: Value = answer.value  # type: ignore[assignment]
    return value
