# SPDX-License-Identifier: BSD-3-Clause
"""Moments in which less is sent, to learn what the way is like without a queue: its least delay, and what it loses."""
import math

from .loss import MOST

DIP, DIP_RATE = 0.2, 0.5
"""A dip lasts so long [s], at this part of the capacity;"""

RISE = 0.004
"""afterwards the least delay is higher by so much at most: clocks drift, datagrams take longer on slower air [s]."""

DRAIN, DRAIN_RATE = 0.6, 0.25
"""A drain lasts so long [s], or until the queue is gone,"""

SETTLES = 0.15
"""but so long at the least [s]."""

GOES_ON, STILL, LONGEST = 0.25, 0.005, 3.0
"""It goes on for so long [s] after a report whose delay is another than before, by so much [s]: what is left when a
drain ends is the way, and that does not change; but it is no longer than this [s]."""

REPORT = 0.3
"""To ask about loss a dip lasts so long, as if nothing were lost: for some reports are to come of it [s]."""

ASKS = 3.0
"""Loss is asked after no oftener than this [s]."""


class Quiet:
    """A dip or a drain, or none."""

    def __init__(self):
        self._began, self._ends, self._drains = -math.inf, -math.inf, False
        self._asked = -math.inf
        self._least = None      # the Point of least delay that was sent in it

    def lasts(self, now):
        return now < self._ends

    def most(self, now):
        """The part of the capacity that may be sent."""
        return (DRAIN_RATE if self._drains else DIP_RATE) if self.lasts(now) else math.inf

    def holds(self, sent):
        """Whether a datagram left in it: not only now."""
        return self._began <= sent < self._ends + 1e-9

    def asked(self, now):
        """Whether of late less was sent, and the air lost less than now: then a full queue drops."""
        return now - self._asked < ASKS and not self.lasts(now)

    def begin(self, expired, long, more_loss, loss, now):
        """Begin one where there is a reason.

        :param expired: whether nothing confirmed the least delay for long
        :param long: whether the queue is
        :param more_loss: whether more is lost than the air is known to lose
        :param loss: the share that is lost, of reports likewise
        """
        if self.lasts(now) or self._least is not None:
            return
        asks = more_loss and now - self._asked > ASKS
        if not (expired or long or asks):
            return
        self._began, self._drains = now, long
        self._ends = now + max(DRAIN if long else DIP, REPORT / max(1 - loss, 1 - MOST) if asks else 0.0)
        if asks:
            self._asked = self._ends

    def go_on(self, delay, point, queue, target, now):
        """Take what a report says while one lasts, or has just ended.

        :param delay: a delay.QueueDelay, put right at the end
        :param point: that speaks for the report
        :param queue: how long it waited [s]
        :param target: no queue is shorter than this for long [s]
        :return: whether it has ended
        """
        if point.sent >= self._began and (self.lasts(now) or self._least is not None):
            changed = self._least is not None and abs(point.delay - self._least.delay) > STILL
            if self._least is None or point.delay < self._least.delay:
                self._least = point
            if self._drains and changed and now - self._began < LONGEST:
                self._ends = max(self._ends, now + GOES_ON)
            if self._drains and queue < target and now - self._began > SETTLES:
                self._ends = min(self._ends, now)
        if self.lasts(now) or self._least is None:
            return False
        if self._drains:
            delay.believe(self._least, now)     # what is left is the way
        else:
            delay.raise_to(self._least, RISE, now)
        self._least = None
        return True
