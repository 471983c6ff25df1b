# SPDX-License-Identifier: BSD-3-Clause
"""The end of a node: what it calls then, and rospy's shutdown at a signal, in a thread of its own.

rospy's handler shuts down within the main thread, whatever that does at this moment. Where it calls the master, as a
node does while it starts, it holds the lock of rospy's proxy of the master. The shutdown needs that lock to unregister,
and would wait for it forever.
"""
import atexit
import contextlib
import os
import signal
import sys
import threading
from typing import Any, Callable, List, Type

import rospy

SIGNALS = signal.SIGINT, signal.SIGTERM
"""Those that end a node by rospy's own handler."""


class _Ending:
    """Waits for the first signal. Its handler takes no lock: the main thread may hold any."""

    def __init__(self) -> None:
        self._came: List[int] = []
        self._reading, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        self._thread = threading.Thread(target=self._run, name='ending', daemon=True)

    def begin(self) -> None:
        self._thread.start()
        for number in SIGNALS:
            signal.signal(number, self._take)
        atexit.register(self._finish)       # is called before rospy's, which does not wait
        self._hook, sys.excepthook = sys.excepthook, self._print

    def _take(self, number: int, _: Any) -> None:
        self._came.append(number)
        with contextlib.suppress(BlockingIOError):      # so many signals came before
            os.write(self._writing, b'\0')

    def _print(self, kind: Type[BaseException], *error: Any) -> None:
        """Print what ends the main program, unless it is that a signal has ended the node while it starts: init_node
        raises another exception then."""
        if not (self._came and issubclass(kind, (rospy.ROSInterruptException, rospy.ROSInitException))):
            self._hook(kind, *error)

    def _run(self) -> None:
        os.read(self._reading, 1)
        rospy.signal_shutdown('signal-%d' % self._came[0])

    def _finish(self) -> None:
        """Wait until the node has unregistered, should its main program end before."""
        if self._came:
            self._thread.join()


def end_by_signals() -> None:
    """Have SIGINT and SIGTERM end the node so. In the main thread, before rospy.init_node with disable_signals."""
    _Ending().begin()


class _Once:
    """Calls a function the first time; who calls it meanwhile waits for its end."""

    def __init__(self, function: Callable[[], None]) -> None:
        self._functions, self._lock = [function], threading.Lock()

    def __call__(self) -> None:
        with self._lock:
            while self._functions:
                self._functions.pop()()


def on_end(function: Callable[[], None]) -> None:
    """Call a function once when the node ends, or now where it is ending.

    rospy.on_shutdown alone is not enough: what it is given while rospy calls what it was given before is never called.
    """
    once = _Once(function)
    rospy.on_shutdown(once)
    if rospy.core.is_shutdown_requested():
        once()
