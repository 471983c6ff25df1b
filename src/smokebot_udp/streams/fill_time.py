# SPDX-License-Identifier: BSD-3-Clause
"""Which fill a receiver has the time for: the wanted one, or for a while the cheapest. Without clock."""
import math

CHEAPEST = 'nearest'

STRIKES = 2
"""So many pictures in a row must take too long: a single one may only have been interrupted."""

PATIENCE = 10.0
"""So long the cheapest fill is taken before the wanted one is tried again, once [s]."""

LONGEST_PERIOD = 2.0
"""Pictures farther apart than this tell nothing of how often they come: some were lost, or the source paused [s]."""

SMOOTHING = 0.2
"""Share of the newest interval in how often pictures are thought to come."""


class FillTime:
    """Holds the filling of a stream's pictures to a time: a limit, and never longer than they come apart.

    :param wanted: the method of codecs.fill that is used where there is time
    """

    def __init__(self, wanted):
        self.wanted = wanted
        self._period = math.inf     # smoothed [s]
        self._stamp = None          # of the newest picture [ns]
        self._strikes = 0
        self._until = -math.inf     # the cheapest fill is used till then [s]

    def came(self, stamp):
        """A picture comes, whether it is filled or not; its source's stamp [ns]."""
        if self._stamp is not None and 0 < stamp - self._stamp <= LONGEST_PERIOD * 1e9:
            interval = (stamp - self._stamp) / 1e9
            known = interval if self._period == math.inf else self._period
            self._period = known + SMOOTHING * (interval - known)
        self._stamp = stamp

    def method(self, now):
        """What the next picture is filled by.

        :param now: [s], of a clock that does not jump
        """
        return self.wanted if now >= self._until else CHEAPEST

    def took(self, seconds, limit, now):
        """The last picture was filled by what `method` said.

        :param seconds: how long that took
        :param limit: how long it may take, at most [s]
        :return: whether the cheapest fill is used from now on, for this took too long
        """
        if self.method(now - seconds) == CHEAPEST:
            return False
        self._strikes = self._strikes + 1 if seconds > min(limit, self._period) else 0
        if self._strikes < STRIKES:
            return False
        self._strikes = STRIKES - 1
        self._until = now + PATIENCE
        return True
