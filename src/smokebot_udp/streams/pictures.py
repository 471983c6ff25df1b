# SPDX-License-Identifier: BSD-3-Clause
"""Which picture is shown when: pictures in progress by their stamp, without clock or ROS (D6.3, section 4.2).

A picture is finished when all that is sent of it has come, when its end has come and nothing follows for
QUIET, when a segment of a newer one comes, or max_wait after its first segment. What comes of a finished one
is late, and changes nothing.
"""
import collections

import numpy as np

RESTART = 2.0
"""A stamp older than the newest by more is no late segment: the source's clock was set back, a recording
began again [s]."""

QUIET = 0.02
"""A picture whose end has come waits so long for what was overtaken on the way [s]."""


class Dated:
    """A picture, the stamp of its source [ns], when its first and its latest segment came [s]."""

    def __init__(self, stamp, picture, began):
        self.stamp, self.picture, self.began, self.latest = stamp, picture, began, began


class PictureSequence:
    """Gathers segments into pictures, one at a time.

    :param max_wait: [s]
    """

    def __init__(self, max_wait):
        self.max_wait = max_wait
        self.dropped = collections.Counter()
        """Segments that changed nothing, by reason: late, contradiction, picture."""
        self._newest = None     # stamp of the picture in progress, or of the last one finished
        self._current = None    # Dated

    @property
    def deadline(self):
        """When the picture in progress is finished at the latest; None where there is none [s]."""
        current = self._current
        if current is None:
            return None
        patience = current.began + self.max_wait
        return min(patience, current.latest + QUIET) if current.picture.ending else patience

    def add(self, stamp, make_picture, fits, segments, now):
        """Take segments of one picture.

        :param stamp: the picture's [ns]
        :param make_picture: f() -> codecs.image.Picture, called where these begin one; ValueError drops them
        :param fits: f(picture) -> bool, whether they describe that picture
        :param segments: (indexes, counts, payloads) as Picture.add takes them
        :param now: [s] on any steady clock
        :return: [Dated, ...], 0 to 2 pictures, in order
        """
        finished = []
        count = len(segments[0])
        if self._newest is not None and 0 < self._newest - stamp < RESTART * 1e9:
            self.dropped['late'] += count
            return finished
        if stamp != self._newest:
            try:
                picture = make_picture()
            except ValueError:
                self.dropped['picture'] += count
                return finished
            # only segments that fit make a picture: forged ones must not end the one in progress
            if self._take(picture, segments):
                if self._current is not None:
                    finished.append(self._finish())
                self._newest, self._current = stamp, Dated(stamp, picture, now)
        elif self._current is None:
            self.dropped['late'] += count
        elif not fits(self._current.picture):
            self.dropped['contradiction'] += count
        elif self._take(self._current.picture, segments):
            self._current.latest = now
        if self._current is not None and self._current.picture.complete:
            finished.append(self._finish())
        return finished

    def _take(self, picture, segments):
        """Add segments to a picture; returns whether any of them fits it."""
        good = picture.add(*segments)
        self.dropped['contradiction'] += len(good) - int(np.count_nonzero(good))
        return good.any()

    def poll(self, now):
        """The picture in progress, where its time is over; else None."""
        return self._finish() if self._current is not None and now >= self.deadline else None

    def _finish(self):
        current, self._current = self._current, None
        return current
