# SPDX-License-Identifier: BSD-3-Clause
"""What a video encoder is opened for, when it is opened anew, and what it is asked for to get what is wanted.

libx264 follows the size that it is asked for down to about a third of that at which it was opened, and back, but never
above it. An encoder that is opened anew begins with an intra image: a blurred one, at that size. So it is opened for
some more than all that an image may take, whatever part of it parity pieces take, and small excesses are not worth it.
"""
import math
from typing import NamedTuple, Optional

import numpy as np

from .redundancy import Division, Link, Scene, Sizes, divide, division, slice_bytes

HEADROOM = 1.15
"""An encoder is opened for this many times the size that is wanted."""

RISE = 1.2
"""An encoder that is old enough is opened anew where the wanted size is above this many times its own."""

FALL = 1 / 3
"""An encoder of any age is opened anew where the wanted size is below this part of its own."""

LEAST_AGE = 10
"""Minimum number of images before an encoder is opened anew, unless a far smaller size is wanted."""

LONG, SHORT, EACH = 10, 5, 1
"""Numbers of images of a refresh cycle. A short one costs quality, and mends sooner what was lost; without prediction
nothing is left to mend."""

SHORT_COST = 1.35
"""The coding error with a short cycle, relative to that with a long one; measured: 1.29 to 1.48."""

ALIKE, UNLIKE = 0.03, 0.3
"""Mean squared difference of successive images in terms of that of independent ones: up to the first, prediction pays
fully; from the second on it does not."""

ALIKE_COST, UNLIKE_COST = 4.0, 0.8
"""The coding error without prediction, relative to that with a long cycle; measured: 1.3 to 5.4 where images are alike,
0.8 to 0.94 where they are not."""

CLEARLY = 0.15
"""A new encoder has another cycle where that lowers the logarithm of the expected error by this: 0.7 dB."""

REPAID = 4.0
"""Where losses come in bursts, an encoder is opened anew for another cycle where the logarithm of the expected error
would have been lower by this, summed over images: reports of bursts vary too much for less. Measured on several clips;
the intra image of a new encoder costs 7 dB at first, and nothing any more after 15 images."""

LESS, MORE = 0.7, 1.4
"""An encoder is asked for at least and at most this many times the size that is wanted."""

SMOOTHING = 0.1
"""Weight of the newest image in the factor between the size that is wanted and the size that is asked for."""

ERROR_AT_0, DOUBLING = 0.25, 6.0
"""The mean squared error at quantiser 0, and the steps that double it. Measured, within a factor of 2."""


class Opening(NamedTuple):
    """What an encoder is opened for."""
    size: int
    """Maximum size of an image [byte]."""
    refresh: int
    """Number of images of a refresh cycle."""


class Plan(NamedTuple):
    """What is wanted of an image."""
    division: Division
    size: int
    """Size of all slices if there were no parity pieces, for which an encoder is opened [byte]."""
    refresh: int
    """Number of images of a refresh cycle that a new encoder would have."""
    gain: float
    """How much lower the expected error (`Division.error`) would be with the best other cycle; negative: higher."""
    at_once: bool
    """Whether an encoder is opened anew for that cycle whatever was missed until now: losses are independent, so that
    reports do not vary, or prediction gains nothing, so that a new encoder costs nothing."""


def plan(budget: float, sizes: Sizes, scene: Scene, link: Link, usual: Optional[int] = None) -> Plan:
    """Divide the bytes of an image, and choose the refresh cycle.

    :param budget: of all datagrams on the air [byte]
    :param scene: `refresh` is that of the encoder in use
    :param usual: parity pieces of the last plan; None: there is none
    """
    costs = {LONG: 1.0, SHORT: SHORT_COST, EACH: scene.intra_cost}
    usual_cost = costs.pop(scene.refresh)
    best = divide(budget, sizes, scene, link, usual)

    def error(refresh: int) -> float:
        cost = costs[refresh] / usual_cost
        changed = scene._replace(coding_error=scene.coding_error * cost, refresh=refresh)
        return division(budget, best.parities, sizes, changed, link).error + math.log(cost)
    other = min((refresh for refresh, cost in costs.items() if cost < math.inf), key=error)
    gain = best.error - error(other)
    return Plan(best, int(slice_bytes(budget, 0, sizes)), other if gain > CLEARLY else scene.refresh, gain,
                link.burst is None or scene.intra_cost < 1)


def intra_cost(difference: Optional[float]) -> float:
    """The coding error if no image were predicted, relative to that with a long cycle.

    :param difference: of successive images in terms of that of independent ones; None: unknown
    """
    if difference is None:
        return ALIKE_COST
    logarithms = math.log(ALIKE), math.log(UNLIKE)
    return float(np.exp(np.interp(math.log(max(difference, 1e-9)), logarithms,
                                  (math.log(ALIKE_COST), math.log(UNLIKE_COST)))))


def reopening(opened: Optional[Opening], age: int, size: int, refresh: int) -> Optional[Opening]:
    """What to open an encoder for now; None: the one in use stays.

    :param opened: what the one in use was opened for; None: there is none of this room and kind of image
    :param age: images that it has encoded
    :param size: of the plan [byte]
    :param refresh: images of a refresh cycle that are wanted
    """
    wanted = Opening(int(HEADROOM * size), refresh)
    if opened is None or size < FALL * opened.size:
        return wanted
    outgrown = size > RISE * opened.size or refresh != opened.refresh
    return wanted if outgrown and age >= LEAST_AGE else None


class Openings:
    """What the encoder of a session is open for, and when another one takes its place.

    That is where the size needs it, or where another refresh cycle repays the intra image (REPAID).
    """

    def __init__(self) -> None:
        self.opening: Optional[Opening] = None
        """What the encoder in use was opened for; None: there is none yet."""
        self.age = 0
        """Number of images that the encoder in use has coded."""
        self._missed = 0.0      # what the best other cycle would have gained, since another one was last worse in sum

    @property
    def refresh(self) -> int:
        """Images of a refresh cycle."""
        return self.opening.refresh if self.opening else LONG

    def renew(self, plan: Plan) -> bool:
        """Take the plan of the next image; whether a new encoder codes it."""
        self.age += 1
        self._missed = max(self._missed + plan.gain, 0.0)
        wanted = plan.refresh if plan.at_once or self._missed > REPAID else self.refresh
        opening = reopening(self.opening, self.age, plan.size, wanted)
        if opening is None:
            return False
        self.opening, self.age, self._missed = opening._replace(refresh=plan.refresh), 0, 0.0
        return True


class SizeControl:
    """Asks for as much as makes images as large as wanted, on average; one for each encoder that is opened.

    libx264 keeps below what it is asked for so that no image exceeds it, and headers and whole parity pieces make the
    rest of a plan inexact.
    """

    def __init__(self) -> None:
        self._factor = HEADROOM

    def asked(self, size: int) -> int:
        """What to ask for [byte].

        :param size: of the slices that are wanted [byte]
        """
        return int(size * self._factor)

    def add(self, budget: float, size: float) -> None:
        """Note the size of an image.

        :param budget: what it was to take on the air [byte]
        :param size: what it takes [byte]
        """
        self._factor = min(max(self._factor * (budget / size) ** SMOOTHING, LESS), MORE)


def coding_error(qp: float) -> float:
    """The mean squared error of an image, about [count^2].

    :param qp: mean quantiser
    """
    return ERROR_AT_0 * 2 ** (qp / DOUBLING)
