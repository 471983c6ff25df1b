# SPDX-License-Identifier: BSD-3-Clause
"""Chooses between interleaved and layered coding of an image stream: `coding: auto`.

Raw pixels need no computing and are exact, but they are the worse image wherever some of them are lost or do not fit.
So images are interleaved where all raw pixels fit the link with time to spare and nearly none is lost, and where
layered coding takes longer than both the frame period and all raw pixels on the link. With hysteresis: a change costs
the operator's temporal filter its memory.
"""
import math
import statistics
from collections import deque
from typing import Deque, NamedTuple, Optional

FITS, STILL_FITS = 0.5, 0.8
"""Raw pixels fit if they take this part of the bandwidth that is there; once in use, until they take this part."""

LOSSLESS, STILL_LOSSLESS = 0.01, 0.03
"""Nearly nothing is lost if the packet-loss ratio is this; once interleaved, until it is this."""

HOLD = 5.0
"""Conditions for a change to interleaved must hold for this long [s]."""

RETRY = 30.0
"""After this time without layered coding, its duration is measured again [s]."""

MEASURED = 5
"""The duration of layered coding is the median of this many images; the first one after a change counts for nothing."""


class Conditions(NamedTuple):
    """What the choice depends on."""
    raw: float
    """Interleaved images as requested, or as many as the source has; inf: they are larger than requested [byte/s]."""
    room: float
    """What the stream may use of the link [byte/s]."""
    loss: Optional[float]
    """Packet-loss ratio that is expected; None: unknown."""
    period: float
    """From an image to the next one [s]."""


class CodingChoice:
    """Whether images are layered. Times are by a steady clock [s]."""

    def __init__(self) -> None:
        self.layered: Optional[bool] = None
        """As chosen last; None: nothing was chosen yet."""
        self._durations: Deque[float] = deque(maxlen=MEASURED)
        self._warm = False
        self._fits_since: Optional[float] = None
        self._slow_until = -math.inf

    def took(self, duration: float) -> None:
        """Record how long layered coding of an image took [s]."""
        if self._warm:
            self._durations.append(duration)
        self._warm = True

    def update(self, conditions: Conditions, now: float) -> bool:
        """Choose for the next image."""
        if len(self._durations) == MEASURED and statistics.median(self._durations) > _interleaved_period(conditions):
            self._slow_until = now + RETRY
            self._durations.clear()
        if now < self._slow_until:
            self._set(False)
        elif not self._raw_fits(conditions):
            self._fits_since = None
            self._set(True)
        else:
            self._fits_since = now if self._fits_since is None else self._fits_since
            if self.layered is None or now - self._fits_since >= HOLD:
                self._set(False)
        return bool(self.layered)

    def _raw_fits(self, conditions: Conditions) -> bool:
        chosen = self.layered is False
        if conditions.loss is None or conditions.loss > (STILL_LOSSLESS if chosen else LOSSLESS):
            return False
        if math.isinf(conditions.raw):      # so may be the room
            return False
        return conditions.raw <= (STILL_FITS if chosen else FITS) * conditions.room

    def _set(self, layered: bool) -> None:
        if layered != self.layered:
            self._warm = False
            self._durations.clear()
        self.layered = layered


def _interleaved_period(conditions: Conditions) -> float:
    """From a whole interleaved image to the next one, as far as the link lets them through [s]."""
    if math.isinf(conditions.raw):      # never whole
        return math.inf
    return conditions.period * max(1.0, conditions.raw / conditions.room)
