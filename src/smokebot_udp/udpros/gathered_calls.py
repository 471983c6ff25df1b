# SPDX-License-Identifier: BSD-3-Clause
"""Calls of other nodes: those that come together for one node are made in one, over one TCP connection.

A node connects all its topics at once: when it starts, when an address changes, when a publisher comes back. On a bad
link each TCP connection may lose a packet and wait for its retransmission, and the last one counts; on a busy machine
each costs both sides a thread.
"""
import threading
import time
from typing import Any, Dict, List

from . import rpc

GATHERING_TIME = 0.05
"""The first call waits this long for others [s]."""

MAX_TOGETHER = 32
"""Calls that are made in one: its answer has the message definitions of as many topics."""


class _Call:
    def __init__(self, call: rpc.Call) -> None:
        self.call = call
        self.answered = threading.Event()
        self.answer: Any = None


class GatheredCalls:
    """Makes calls of nodes; any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: Dict[str, List[_Call]] = {}      # {URI: what its next call contains}

    def call(self, uri: str, method: str, *args: Any) -> Any:
        """As rpc.call; waits for the answer.

        :raises Unreachable: if there is no correct answer; Gone: if the node has ended
        :raises Refused: if the answer is an error
        """
        mine = _Call((method, args))
        with self._lock:
            waiting = self._waiting.setdefault(uri, [])
            waiting.append(mine)
            first = len(waiting) == 1
            if len(waiting) == MAX_TOGETHER:
                del self._waiting[uri]      # the next one is the first of others
        if first:
            time.sleep(GATHERING_TIME)
            with self._lock:
                if self._waiting.get(uri) is waiting:
                    del self._waiting[uri]
            _make(uri, waiting)
        mine.answered.wait()
        if isinstance(mine.answer, Exception):
            raise mine.answer
        return mine.answer


def _make(uri: str, calls: List[_Call]) -> None:
    try:
        answers = rpc.call_together(uri, [one.call for one in calls])
    except Exception as error:      # whatever it is, each caller gets it
        answers = [error] * len(calls)
    for one, answer in zip(calls, answers):
        one.answer = answer
        one.answered.set()
