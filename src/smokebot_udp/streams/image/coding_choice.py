# SPDX-License-Identifier: BSD-3-Clause
"""Chooses between interleaved and layered coding of an image stream: `coding: auto`.

Raw pixels need no computing and are exact, but they are the worse image wherever some of them are lost or do not fit.
So images are interleaved where all raw pixels fit the link with time to spare, are shown no later than layered ones and
nearly none is lost, and where layered coding takes longer than both the frame period and all raw pixels on the link.
Images of 8 bits are looked at: where layers show them well enough, they do not take ten times the rate for what nobody
sees. Images of more bits are measurements, which are to be exact. With hysteresis: a change costs the operator's
temporal filter its memory.
"""
import math
import statistics
from collections import deque
from typing import Deque, NamedTuple, Optional

from .image_size import GOOD_ERROR

FITS, STILL_FITS = 0.5, 0.8
"""Raw pixels fit if they take this part of the frame period; once in use, until they take this part."""

QUICK, STILL_QUICK = 0.02, 0.03
"""A raw image is on the air for this time at most, which is about what coding and decoding a layered one take; once in
use, for this time [s]."""

LOSSLESS, STILL_LOSSLESS = 0.01, 0.03
"""Nearly nothing is lost if the packet-loss ratio is this; once interleaved, until it is this."""

HOLD = 1.5
"""Conditions for a change to interleaved must hold for this long [s]."""

RETRY = 30.0
"""After this time without layered coding, its duration and its error are measured again [s]."""

MEASURED = 5
"""The duration and the error of layered coding are the medians of this many images; the first one after a change counts
for nothing."""

ENOUGH = 10 ** (0.5 / 20) * math.sqrt(GOOD_ERROR)
"""Rms error of an image that is shown well enough: half a decibel more than that of a good image, which is no sharper
where the scene moves, so that it is younger. Else such a scene would cross as raw pixels, at ten times the rate
[count]."""


class Conditions(NamedTuple):
    """What the choice depends on."""
    raw: float
    """Size of an interleaved image; inf: it would be larger than requested [byte]."""
    room: float
    """What the stream may use of the link [byte/s]."""
    loss: Optional[float]
    """Packet-loss ratio that is expected; None: unknown."""
    period: float
    """From an image to the next one [s]."""
    looked_at: bool = False
    """Whether an image of 8 bits, which need not be exact."""


class CodingChoice:
    """Whether images are layered. Times are by a steady clock [s]."""

    def __init__(self) -> None:
        self.layered: Optional[bool] = None
        """As chosen last; None: nothing was chosen yet."""
        self._durations: Deque[float] = deque(maxlen=MEASURED)
        self._errors: Deque[float] = deque(maxlen=MEASURED)
        self._warm = False
        self._fits_since: Optional[float] = None
        self._slow_until = self._coarse_until = -math.inf

    def took(self, duration: float, error: float = 0.0) -> None:
        """Record how long layered coding of an image took [s], and its rms error once all of it has come [count]."""
        if self._warm:
            self._durations.append(duration)
            self._errors.append(error)
        self._warm = True

    def update(self, conditions: Conditions, now: float) -> bool:
        """Choose for the next image."""
        # raw images that are larger than requested are never whole, nor is any while other streams take all of the link
        possible = conditions.raw < math.inf and conditions.room > 0
        whole = max(conditions.period, conditions.raw / conditions.room) if possible else math.inf
        if len(self._durations) == MEASURED and statistics.median(self._durations) > whole:
            self._slow_until = now + RETRY
            self._durations.clear()
        if len(self._errors) == MEASURED:
            self._coarse_until = now + RETRY if statistics.median(self._errors) > ENOUGH else -math.inf
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

    def is_possible(self, conditions: Conditions, now: float) -> bool:
        """Whether images would be interleaved if the link had enough room."""
        most = STILL_LOSSLESS if self.layered is False else LOSSLESS
        return (conditions.loss is not None and conditions.loss <= most and math.isfinite(conditions.raw)
                and (not conditions.looked_at or now < self._coarse_until))

    def _raw_fits(self, conditions: Conditions, now: float) -> bool:
        part, time = (STILL_FITS, STILL_QUICK) if self.layered is False else (FITS, QUICK)
        return (self.is_possible(conditions, now)
                and conditions.raw <= min(part * conditions.period, time) * conditions.room)

    def _set(self, layered: bool) -> None:
        if layered != self.layered:
            self._warm = False
            self._durations.clear()
            self._errors.clear()
        self.layered = layered
