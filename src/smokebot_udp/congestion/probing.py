# SPDX-License-Identifier: BSD-3-Clause
"""Short trains that find out whether the link carries more: datagrams that are due anyway, sent faster."""
import math
from typing import NamedTuple

LASTS = 0.025
"""What a train may take of the link's capacity as it is known [s]."""

LEAST = 3
"""A train has so many datagrams at least: two ways between three."""

GAINS = 2.0, 4.0
"""How much faster a train leaves than the known capacity: the first, and one after one that got through."""

THROUGH = 1.3
"""Where the known capacity has grown by this since it left, a train got through."""

PAUSE = 1.0
"""After a train that did not [s]."""

REGULAR = 2.0
"""Where the queue is not empty, for its delay may be mistaken, so much later [s]."""

LOST = 0.5
"""A train that tells nothing for so long is lost [s]."""


class Train(NamedTuple):
    """Some of the datagrams that are due anyway are to leave faster."""
    rate: float
    """[byte/s]"""
    size: float
    """So many bytes of them [byte]."""


class Trains:
    """Decides when a train leaves: one at a time, while the queue is empty and more is wanted."""

    def __init__(self):
        self._got_through = False
        self._next = -math.inf      # not before [s]
        self._under_way = None      # (bytes that will have left with it, the capacity then, when)

    def next(self, capacity, empty, wanted, newest, unreported, now):
        """The Train that is to leave now, or None.

        :param capacity: as known [byte/s]
        :param empty: whether the queue is
        :param wanted: whether more would be sent than is
        :param newest: the report.Point of the newest datagram that is known to have come
        :param unreported: bytes that left since
        """
        if self._under_way:
            ends, before, left = self._under_way
            if newest.total < ends and now - left < LOST:
                return None
            self._under_way = None
            self._got_through = capacity > THROUGH * before
            if not self._got_through:
                self._next = now + PAUSE
        least, usual = LEAST * newest.size, capacity * LASTS
        if not wanted or now < self._next or (not empty and (usual < least or now < self._next + REGULAR)):
            return None
        train = Train(capacity * GAINS[self._got_through], max(least, usual))
        self._under_way = newest.total + unreported + train.size, capacity, now
        return train
