# SPDX-License-Identifier: BSD-3-Clause
"""One map that rounds of segments complete, without clock or ROS (D6.3, section 5).

A map is sent again and again. What came of one round stays until another brings it anew, as long as the map
lies in the same place; a map of another size or origin is a new one. It is shown when a round pauses for
QUIET, or max_wait after the first segment that is not shown yet.
"""
import collections

import numpy as np

from .pictures import RESTART

QUIET = 0.1
"""[s]"""


class Rounds:
    """:param max_wait: [s]"""

    def __init__(self, max_wait):
        self.max_wait = max_wait
        self.dropped = collections.Counter()
        """Segments that changed nothing, by reason: late, contradiction, picture."""
        self._head = self._place = self._map = None     # of the newest segment that fits, where it lies, its cells
        self._since = self._latest = None    # when the first and the latest segment came that are not shown [s]

    @property
    def deadline(self):
        """When the map is to be shown; None where nothing new came [s]."""
        return None if self._since is None else min(self._since + self.max_wait, self._latest + QUIET)

    def add(self, head, place, make_map, segments, now):
        """Take segments of one round.

        :param head: what they say alike; its `stamp` is the map's [ns]
        :param place: what tells one map from another: frame, size, resolution, origin, cut
        :param make_map: f() -> codecs.image.Picture, called where these begin a new map; ValueError drops them
        :param segments: (indexes, counts, payloads) as Picture.add takes them
        :param now: [s] on any steady clock
        """
        count = len(segments[0])
        # only what was overtaken on the way is late: a map whose stamp stays as it is would be late for ever
        if (self._head is not None and 0 < self._head.stamp - head.stamp < RESTART * 1e9
                and now - self._latest < RESTART):
            self.dropped['late'] += count
            return
        grid = self._map
        if place != self._place:
            try:
                grid = make_map()
            except ValueError:
                self.dropped['picture'] += count
                return
        good = grid.add(*segments)
        self.dropped['contradiction'] += count - int(np.count_nonzero(good))
        if good.any():
            self._head, self._place, self._map = head, place, grid
            self._latest = now
            self._since = now if self._since is None else self._since

    def poll(self, now):
        """(head, map) where the map is to be shown now, else None."""
        if self.deadline is None or now < self.deadline:
            return None
        self._since = None
        return self._head, self._map
