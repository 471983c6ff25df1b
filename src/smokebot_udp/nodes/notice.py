# SPDX-License-Identifier: BSD-3-Clause
"""A text that all views of a node show, such as EMERGENCY STOP."""
import threading
from typing import Callable, List


class Notice:
    """Holds the text; any thread may use it."""

    def __init__(self) -> None:
        self.text = ''
        """Empty: there is none."""
        self._lock = threading.Lock()
        self._listeners: List[Callable[[str], None]] = []

    def subscribe(self, listener: Callable[[str], None]) -> None:
        """Call listener(text) now, and after each change; it has to be short."""
        with self._lock:
            self._listeners.append(listener)
            listener(self.text)

    def unsubscribe(self, listener: Callable[[str], None]) -> None:
        """End what `subscribe` began."""
        with self._lock:
            self._listeners.remove(listener)

    def show(self, text: str) -> None:
        """Show another text."""
        with self._lock:
            if text == self.text:
                return
            self.text = text
            for listener in self._listeners:
                listener(text)
