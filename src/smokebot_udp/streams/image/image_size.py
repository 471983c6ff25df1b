# SPDX-License-Identifier: BSD-3-Clause
"""How many bytes an image has: one decision, made twice for each image.

An image on the screen differs from the scene by the error of its coding and by what has moved since. The first falls
with each byte, along the codec's own curve of this image. The second grows with the time that the image takes until it
is shown, and so with each byte that is coded, sent and decoded before. But a sharp image of a moment ago is of more use
than a blurred one of now: until an image is good, its error counts 1 / MOTION times. So one size has the least sum.
Where a scene moves fast nothing but its motion would count, and images would be blurred to be a few ms newer. There
another size is larger, that of the best mean PSNR until the next image: the screen shows the last one for t(n) of the
period T. The size is the larger of the two, among those that the link has room for until the next image:

    minimise    max(D(n) - D(good), 0) / MOTION + min(D(n), D(good)) + G t(n)
    minimise    (1 - t(n) / T) log D(n) + t(n) / T log(D(n) + G T)      with D(n) >= D(good)
    where       t(n) = max(n overhead - tokens, 0) / room + n coding
    subject to  n overhead <= granted
    D(n)        mean squared error of n bytes of the stream; good: GOOD_ERROR, or that of GOOD_BITS if it is larger
    G           growth of the mean squared error with the age of an image

What a token bucket on the path has tokens for passes at once. `grant` knows the link and the settings, and comes before
the image is coded: no more is coded than fits. `choose` knows the curve. Each names the bound that decided (`Bound`).
The room is the median of the latest estimates (Outlook): quality is nearly linear in the logarithm of the size, so what
is lost by an image that is too small by some factor equals what is lost by one that is too large, whose rest never
leaves. The median is what promises most then; a single estimate that is wrong changes nothing, and a link that has
changed is followed within two.
"""
import enum
import math
from typing import Any, Mapping, NamedTuple, Tuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ..frame_assembler import MAX_WAIT

FILL, LEAST_FILL = 0.95, 0.5
"""An image leaves within this part of the time until the next one, as images come with jitter; and takes this part at
least, where what is left of the last image leaves first."""

LATEST = MAX_WAIT / 2
"""It leaves within this time at what its stream may use of the link, however rare images are, and what is left of it
then is waited for as long: its last datagrams come before the operator stops waiting for them, also where the link is
slower than expected [s]."""

LEAST_BYTES = 600
"""Size of an image on the air, at least: a datagram that is of use [byte]."""

LEAST_ROOM = 1.0
"""A stream that may use less of the link counts as if it could use this [byte/s]."""

MOTION = 0.03
"""What has moved counts as this part of what an image lacks until it is good. On a recorded camera that flies slowly
(752 x 480, G 45 count^2/s) each image takes all of 1 Mbit/s up to 0.3. With more than 0.03 images of a robot that turns
fast are blurred, with less they are older: a simulated thermal camera at 57 degrees/s, 20 Mbit/s."""

GOOD_ERROR = 255 ** 2 / 10 ** (42.5 / 10)
"""Mean squared error of a good image, 42.5 dB of 8 bits: with more bytes the recorded camera gains less from its coding
than it loses by its age, at 3 Mbit/s and above [count^2]."""

ROUNDING = 1 / 12
"""Mean squared error of what is exact but for the rounding of the values [count^2]."""

GOOD_BITS = 1.2
"""An image of this size is good, whatever its error is: of a noisy sensor the error stays above GOOD_ERROR
[bit per value]."""

CLEARLY = 0.98
"""Where no further bytes bring the squared error to this part of it, an image is not made shorter for its freshness."""

SPARE = 1.25
"""Limit of the bytes coded of an image of a moving scene, in multiples of those that the last one was worth."""

MORE = 2.0
"""Replaces SPARE where all that was coded of the last image was worth sending."""


class Bound(enum.Enum):
    """What decided the size of an image."""
    ROOM = 'room'
    """What the link has for it until the next image."""
    MAX_BYTES = 'max_bytes'
    """Setting `max_bytes`."""
    AIR_TIME = 'air_time'
    """Setting `air_time`."""
    FRESHNESS = 'freshness'
    """Further bytes gain less than the scene moves meanwhile."""
    CODING = 'coding'
    """So little was expected to be worth sending that no more was coded."""
    MAX_QUALITY = 'max_quality'
    """Setting `max_quality`, or an error that 8 bits do not show."""
    EXACT = 'exact'
    """There is no more."""


class Grant(NamedTuple):
    """What an image may take."""
    size: float
    """On the air [byte]; inf: there is no limit."""
    bound: Bound


class Costs(NamedTuple):
    """What a byte of an image's stream takes."""
    overhead: float
    """Bytes on the air, for its protection and the heads of datagrams."""
    coding: float
    """Time in the processors of both sides [s]."""
    room: float
    """What the stream may use of the link [byte/s]."""
    tokens: float = 0.0
    """What passes at once, whatever `room` is [byte on the air]."""

    def durations(self, sizes: IntArray) -> FloatArray:
        """Until images of these sizes are on the screen [byte, s]."""
        waiting = np.maximum(sizes * self.overhead - self.tokens, 0.0)
        found: FloatArray = waiting / max(self.room, LEAST_ROOM) + sizes * self.coding
        return found


def period_of(rate: float) -> float:
    """The time from an image to the next one at a rate [Hz], or LATEST if that is less [s]."""
    return min(1 / rate, LATEST)


def grant(settings: Mapping[str, Any], room: float, period: float, waiting: float = 0.0) -> Grant:
    """What the next image may take on the air.

    :param settings: air_time and max_bytes as requested
    :param room: see Costs
    :param period: see `period_of` [s]
    :param waiting: how long what is left of the last image takes, once this one is coded [s]
    """
    limits = [Grant(room * max(FILL * period - waiting, LEAST_FILL * period), Bound.ROOM)]
    if settings['air_time']:
        limits.append(Grant(room * settings['air_time'], Bound.AIR_TIME))
    if settings['max_bytes']:
        limits.append(Grant(settings['max_bytes'], Bound.MAX_BYTES))
    size, bound = min(limits, key=lambda limit: limit.size)
    return Grant(max(size, LEAST_BYTES), bound)


def choose(ends: IntArray, errors: FloatArray, cells: int, growth: float, period: float, costs: Costs,
           least: float = GOOD_ERROR) -> Tuple[int, float]:
    """The number of truncation points with which the screen is best, and the mean squared error then.

    :param ends: (s,) truncation points of a stream, those that the grant has room for [byte]
    :param errors: (s,) mean squared errors there [count^2]
    :param cells: values of the image
    :param growth: of the mean squared error with the age of an image [count^2/s]
    :param period: see `period_of` [s]
    :param least: mean squared error from which on an image is good; 0: of measurements only GOOD_BITS say so [count^2]
    """
    good = max(least, errors[min(int(np.searchsorted(ends, GOOD_BITS / 8 * cells)), len(ends) - 1)])
    lacking = np.maximum(errors - good, 0) + MOTION * np.minimum(errors, good)
    durations = costs.durations(ends)
    best = int(np.argmin(lacking + age_cost(growth) * durations))
    if growth:
        seen = np.maximum(errors, max(good, ROUNDING))
        best = max(best, int(np.argmin(_log_errors(seen, growth * period, durations / period))))
    better_later = bool((errors[best + 1:] < CLEARLY * errors[best]).any())
    points = best + 1 if better_later else len(ends)
    return points, float(errors[points - 1])


def _log_errors(errors: FloatArray, moved: float, parts: FloatArray) -> FloatArray:
    """Mean logarithm of the squared error of the screen until the next image; infinite: an image comes after that.

    :param errors: mean squared errors of images [count^2]
    :param moved: what they grow by within a period [count^2]
    :param parts: fractions of the period that pass until an image is shown; until then the screen shows the last one
    """
    found: FloatArray = (1 - parts) * np.log(errors) + parts * np.log(errors + moved)
    return np.where(parts < 1, found, math.inf)


def age_cost(growth: float) -> float:
    """What a second costs, as a mean squared error that a good image has not [count^2]."""
    return MOTION * growth
