# SPDX-License-Identifier: BSD-3-Clause
"""Chooses between interleaved and layered coding of an image stream: `coding: auto`.

Raw pixels need no computing and are exact, but they are the worse image wherever some of them are lost or do not fit.
So images are interleaved where all raw pixels fit the link with time to spare, are shown no later than layered ones and
nearly none is lost, and where layered coding takes longer than both the frame period and all raw pixels on the link.
With hysteresis: a change costs the operator's temporal filter its memory.
"""
import math
import statistics
from collections import deque
from typing import Deque, NamedTuple, Optional

FITS, STILL_FITS = 0.5, 0.8
"""Raw pixels fit if they take this part of the bandwidth that is there; once in use, until they take this part."""

QUICK, STILL_QUICK = 0.02, 0.03
"""A raw image is on the air for this time at most, which is about what coding and decoding a layered one take; once in
use, for this time [s]."""

TRIAL, TRIAL_INTERVAL = 3.0, 60.0
"""Whether the link is so wide shows only while much is sent. So where raw pixels fit they are in use for this long; if
they are not quick by then, they are tried again after this time [s]."""

EXPLORATION, EXPLORED, HOPELESS = 1.5, 2.0, 8.0
"""Where it is not known whether this many times the room for raw pixels is there, layered images are as large as the
link allows for this long, as often; not where raw pixels take that many times the room [s, 1, 1]."""

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
        self._trial: Optional[float] = None     # since when raw pixels are in use without being quick [s]
        self._next_trial = -math.inf            # not before [s]
        self._explored = -math.inf              # when an exploration began last [s]
        self.exploring = False
        """Whether the next image should take as much of the link as it may."""

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
        self._explore(conditions, now)
        if now < self._slow_until:
            self._set(False)
        elif not self._raw_fits(conditions, now):
            self._fits_since = None
            self._set(True)
        else:
            self._fits_since = now if self._fits_since is None else self._fits_since
            if self.layered is None or now - self._fits_since >= HOLD:
                self._set(False)
        return bool(self.layered)

    def _explore(self, conditions: Conditions, now: float) -> None:
        open_ = (self.is_possible(conditions) and EXPLORED * conditions.raw > FITS * conditions.room
                 and conditions.raw <= HOPELESS * conditions.room)
        if open_ and now - self._explored >= TRIAL_INTERVAL:
            self._explored = now
        self.exploring = open_ and now - self._explored < EXPLORATION

    def is_possible(self, conditions: Conditions) -> bool:
        """Whether images would be interleaved if the link had enough room."""
        most = STILL_LOSSLESS if self.layered is False else LOSSLESS
        return conditions.loss is not None and conditions.loss <= most and math.isfinite(conditions.raw)

    def _raw_fits(self, conditions: Conditions, now: float) -> bool:
        chosen = self.layered is False
        part, time = (STILL_FITS, STILL_QUICK) if chosen else (FITS, QUICK)
        if not self.is_possible(conditions) or conditions.raw > part * conditions.room:
            self._trial = None
            return False
        if conditions.raw * conditions.period <= time * conditions.room:
            self._trial = None
            return True
        if not chosen:
            return now >= self._next_trial
        self._trial = now if self._trial is None else self._trial
        if now - self._trial < TRIAL:
            return True
        self._trial, self._next_trial = None, now + TRIAL_INTERVAL
        return False

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
