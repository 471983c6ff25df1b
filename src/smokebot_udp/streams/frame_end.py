# SPDX-License-Identifier: BSD-3-Clause
"""When the datagrams of a frame are no longer expected, from those that came: without clock or ROS.

Datagrams leave in order, at a pace that the robot's packet scheduler sets and changes. So what is missing is expected
as long after the latest datagram as its place is behind that one's, at the pace of the datagrams so far (their
least-squares line), which is remembered from frame to frame. It is given up when it is late by more than usual: by the
mean and four mean deviations of the largest lateness of each frame, as TCP waits for acknowledgments (V. Jacobson,
M. Karels, SIGCOMM 1988; RFC 6298). Each datagram renews the estimate, also one that comes when its frame was given up,
so a link of more jitter is waited for from the next frame on.

Where nearly all datagrams come, a missing one is rather late than lost: it is waited for longer, which costs nothing
where none is missing.
"""
import math
from typing import Optional, Tuple

import numpy as np

from ..arrays import IntArray

FIRST_MARGIN = 0.02
"""How much later than expected a datagram may be while nothing is known of the jitter, or where none is lost [s]."""

LEAST_MARGIN = 0.002
"""This much later it may always be: senders and receivers handle datagrams in batches [s]."""

GAIN, DEVIATION_GAIN, DEVIATIONS = 1 / 8, 1 / 4, 4
"""Weights of the newest frame in means and in the mean deviation of the lateness, and how many of these are waited for;
of RFC 6298."""

PRIOR = 100.0
"""The pace of the frames before weighs as much as datagrams of this sum of squared distances of their places from the
mean: some ten in a row."""


class FrameEnd:
    """Estimates when the datagrams of one frame after the other come."""

    def __init__(self) -> None:
        self._mean = 0.0        # of the largest lateness of each frame, and its mean deviation [s]
        self._deviation = (FIRST_MARGIN - LEAST_MARGIN) / DEVIATIONS
        self._lossy = 0.0       # share of the frames of which datagrams were lost
        self._usual: Optional[float] = None     # pace of the frames before [s]
        # of the frame in progress:
        self._line = _Line()
        self._latest: Optional[int] = None  # the last place from which a datagram came, and when [s]
        self._came = 0.0
        self._lateness: Optional[float] = None      # the largest; None: a single datagram has none [s]

    @property
    def margin(self) -> float:
        """How much later than expected a datagram may be [s]."""
        usual = LEAST_MARGIN + self._mean + DEVIATIONS * self._deviation
        return usual + (1 - self._lossy) * max(0.0, FIRST_MARGIN - usual)

    @property
    def pace(self) -> Optional[float]:
        """From one datagram to the next one; None: unknown [s]."""
        variation, covariation = self._line.moments()
        if self._usual is not None:
            variation, covariation = variation + PRIOR, covariation + PRIOR * self._usual
        return max(0.0, covariation / variation) if variation else None

    def begin(self) -> None:
        """A new frame begins: the next datagrams are of it."""
        if self._lateness is not None:
            self._deviation += DEVIATION_GAIN * (abs(self._lateness - self._mean) - self._deviation)
            self._mean += GAIN * (self._lateness - self._mean)
        if self._latest is not None:
            self._lossy += GAIN * ((self._line.count <= self._latest) - self._lossy)
        self._usual = self.pace
        self._line = _Line()
        self._latest = self._lateness = None

    def add(self, places: IntArray, now: float) -> None:
        """Datagrams of the frame came together, whether it was given up or not.

        :param places: (m,) int, m >= 1: their places in the order in which the frame's datagrams leave, from 0 on
        :param now: by a steady clock [s]
        """
        first, last = int(places.min()), int(places.max())
        if self._latest is not None:
            due = self._due(first)
            self._lateness = max(self._lateness or 0.0, 0.0 if due is None else now - due)
        elif last > first:
            self._lateness = 0.0
        self._line.add(places, now)
        if self._latest is None or last > self._latest:
            self._latest, self._came = last, now

    def given_up(self, place: int) -> float:
        """When a datagram that did not come is no longer expected, unless more come; infinite: it is not known [s].

        :param place: its place, see `add`
        """
        due = self._due(place)
        return math.inf if due is None else due + self.margin

    def _due(self, place: int) -> Optional[float]:
        """When the datagram in a place is expected; None: unknown [s]."""
        if self._latest is None or place > self._latest and self.pace is None:
            return None
        return self._came + (place - self._latest) * (self.pace or 0.0)


class _Line:
    """The least-squares line of arrival times over places."""

    def __init__(self) -> None:
        self.count = 0
        """Datagrams."""
        self._origin = 0.0      # of the times: the first one [s]
        self._places = self._times = self._squares = self._products = 0.0      # sums

    def add(self, places: IntArray, now: float) -> None:
        if not self.count:
            self._origin = now
        self.count += len(places)
        self._places += float(places.sum())
        self._squares += float(np.square(places, dtype=float).sum())
        self._times += len(places) * (now - self._origin)
        self._products += float(places.sum()) * (now - self._origin)

    def moments(self) -> Tuple[float, float]:
        """The sums of the places' squared deviations from their mean, and of their products with those of the times."""
        if not self.count:
            return 0.0, 0.0
        return (self._squares - self._places * self._places / self.count,
                self._products - self._places * self._times / self.count)
