# SPDX-License-Identifier: BSD-3-Clause
"""When a video image is not predicted from others: for an operator that joins, and after a long loss.

Operators report which images they hold (video_receiver.py). Without losses each image is held soon after it was sent.
The refresh that goes on all the time repairs single losses within a few images; it is too slow where an operator holds
nothing at all, or has received nothing for long. An image that is not predicted is much coarser for all operators, so
they cannot ask for it often.
"""
import math
from collections import deque
from typing import Collection, Deque, Dict, Optional, Set, Tuple

from ..held import Holding

LONG = 0.5
"""An operator that does not hold an image that was sent so long ago, beside the delay of its reports, needs another
beginning [s]."""

MOST_DELAY = 3.0
"""From an image to the report of it, at most; what takes longer was lost [s]."""

RISE = 0.1
"""The delay rises by so much from one report to the next, at most: a report before may have been lost [s]."""

FIRST_RETRY, LAST_RETRY = 0.3, 8.0
"""Time from a beginning to the next one for the same operator; it doubles as long as its reports remain the same, and
without a limit as long as there is none [s]."""

REMEMBERED = 256
"""Newest images whose times are known."""


class _Requester:
    def __init__(self) -> None:
        self.begun = -math.inf          # when a beginning was sent for it last [s]
        self.retry = FIRST_RETRY
        self.reported: Optional[Holding] = None
        self.newest = -1                # image of the session that it has reported
        self.delay: Optional[float] = None      # from when that one was sent until it was reported [s]


class RefreshRequests:
    """Decides for the images of one stream. All times are by one steady clock [s]; the caller guards it by a lock."""

    def __init__(self) -> None:
        self._operators: Dict[str, _Requester] = {}
        self._asking: Set[str] = set()
        self._session: Optional[int] = None
        self._sent: Deque[Tuple[int, float]] = deque(maxlen=REMEMBERED)

    def serve(self, operators: Collection[str], now: float) -> None:
        """Note to whom the next image is sent: a new operator needs a beginning, and who has left needs none.

        An operator that has never reported may have lost its beginning. It gets another one ever more seldom: it may be
        one that does not report.
        """
        for name in set(self._operators) - set(operators):
            del self._operators[name]
        for name in set(operators) - set(self._operators):
            self._operators[name] = _Requester()
        self._asking &= set(self._operators)
        self._asking |= {name for name, operator in self._operators.items()
                         if operator.reported is None and now - operator.begun >= operator.retry}

    def held(self, name: str, holding: Holding, now: float) -> None:
        """Take an operator's report."""
        operator = self._operators.get(name)
        if operator is None or not self._sent:
            return
        if holding != operator.reported:
            operator.reported, operator.retry = holding, FIRST_RETRY
        self._measure(operator, holding, now)
        if not self._lacks(operator, holding, now):
            self._asking.discard(name)
        elif now - operator.begun >= operator.retry:
            self._asking.add(name)

    def wanted(self) -> bool:
        """Whether the next image is to be a beginning."""
        return bool(self._asking)

    def sent(self, session: int, picture: int, intra: bool, now: float) -> None:
        """Note an image that was sent."""
        if session != self._session:
            self._session = session
            self._sent.clear()
            for operator in self._operators.values():
                operator.newest = -1
        self._sent.append((picture, now))
        if intra:
            self._served(now)

    def too_large(self, now: float) -> None:
        """Note a beginning that was not sent: another one soon would not be, either, and the refresh must do."""
        self._served(now)

    def _served(self, now: float) -> None:
        for name in self._asking:
            operator = self._operators[name]
            last = math.inf if operator.reported is None else LAST_RETRY
            operator.begun, operator.retry = now, min(2 * operator.retry, last)
        self._asking.clear()

    def _measure(self, operator: _Requester, holding: Holding, now: float) -> None:
        """Measure the delay where a report is the first one of an image."""
        newest = self._newest(holding)
        sent = next((when for picture, when in self._sent if picture == newest), None)
        if sent is not None and newest > operator.newest:
            most = MOST_DELAY if operator.delay is None else min(operator.delay + RISE, MOST_DELAY)
            operator.newest, operator.delay = newest, min(now - sent, most)

    def _newest(self, holding: Holding) -> int:
        """The newest image of the session that is held; -1: none is."""
        return sum(holding.runs[-1]) - 1 if holding.session == self._session and holding.runs else -1

    def _lacks(self, operator: _Requester, holding: Holding, now: float) -> bool:
        """Whether an operator holds nothing, or nothing that was sent of late."""
        if holding.session == self._session and not holding.runs:
            return True
        newest = self._newest(holding)
        unheld = next((when for picture, when in self._sent if picture > newest), now)
        return now - unheld > LONG + (operator.delay or 0.0)
