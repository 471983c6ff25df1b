# SPDX-License-Identifier: BSD-3-Clause
"""How long datagrams wait in the link's queue, told by what their way takes beyond the least it took."""
import math

import numpy as np

KEEPS = 5.0
"""A base that nothing came near to for so long is measured anew [s]."""

NEAR = 0.0015
"""What is no farther from the base confirms it [s]."""

REMEMBERS = 5.0
"""The air's speed is forgotten in so long [s]."""

SMOOTHING = 8
"""Reports over which noise is averaged."""

RECENT = 0.05
"""Of the points of so long the one in the middle speaks for all: links jitter, and some datagrams overtake [s]."""


class QueueDelay:
    """The least delay of the way, and what comes on top of it.

    A delay is one way, but for a constant. It contains the time that the datagram itself takes on the air, which is
    taken off: a full datagram is no queue beside a short one. The air's speed is the greatest capacity of late: what
    one of many gets of it is less than what it is.
    """

    def __init__(self):
        self.noise = 0.0
        """How much delays differ from one datagram to the next, whatever the queue does [s]."""
        self.base = None
        """The report.Point with the least delay; None at the beginning, and where the clock began anew."""
        self._speed = 0.0       # of the air [byte/s]
        self._noted = -math.inf
        self._confirmed = math.inf

    def note(self, points, capacity, now):
        """Take new points.

        :param points: [report.Point, ...] in the order they left
        :param capacity: as far as it is known [byte/s]
        """
        self._speed *= max(0.0, 1 - (now - self._noted) / REMEMBERS) if self._noted > -math.inf else 1.0
        self._speed, self._noted = max(self._speed, capacity), now
        point = typical(points)
        waits = self._beyond(point) if self.base else -1.0
        if waits < 0:
            self.base = point
        if waits < NEAR + self.noise:
            self._confirmed = now

    def note_noise(self, points):
        """Points between which the queue grew or shrank evenly, if at all."""
        if len(points) > 4:
            sent, delay = (np.array([getattr(point, name) for point in points]) for name in ('sent', 'delay'))
            sent, delay = sent - sent.mean(), delay - delay.mean()
            left = delay - sent * (sent @ delay) / max(sent @ sent, 1e-9)
            self.noise += (float(np.abs(left).mean()) - self.noise) / SMOOTHING

    def expired(self, now):
        """Whether the base is not confirmed any more."""
        return now - self._confirmed > KEEPS

    def believe(self, point, now):
        """This point is the base from now on."""
        self.base, self._confirmed = point, now

    def raise_to(self, point, most, now):
        """The base is no lower than this point's, but it rises by `most` at once [s]."""
        above = self._beyond(point)
        self.believe(point._replace(arrived=point.arrived - max(0.0, above - most)), now)

    def of(self, point):
        """How long a datagram waited [s]."""
        return max(0.0, self._beyond(point))

    def _beyond(self, point):
        # the speed may be far from true: a shorter datagram is not to seem to have waited for that
        return point.delay - self.base.delay - max(0, point.size - self.base.size) / self._speed


def typical(points):
    """The point that speaks for the newest of some points: that of middling delay.

    :param points: [report.Point, ...] in the order they left
    """
    newest = points[-1].arrived
    recent = sorted((point for point in points if newest - point.arrived <= RECENT), key=lambda point: point.delay)
    return recent[(len(recent) - 1) // 2]
