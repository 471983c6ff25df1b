# SPDX-License-Identifier: BSD-3-Clause
"""How the screen of `bench live` is judged, as it is at each moment. Pure.

An image is compared with the camera's image that it shows; the screen with what the camera sees at that moment.
"""
import bisect
import math
import statistics
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.monitoring.stages import Sized

from .quality import MAX_PSNR

SAMPLED = 0.017
"""The screen is judged this often: no part of the time between two images, so that each part of it counts [s]."""

SETTLED = 5.0
"""What comes within this time after the beginning, see live_run.BEGUN, does not count [s]."""

TOLERANCE = 0.1
"""Maximum error of a capacity that counts as known, relative to the true rate."""

SHARP = 42.0
"""The link is to be used as long as the PSNR of images is below this [dB]."""

FROZEN = 0.5
"""The last sample is taken a moment after the one before: that no image came meanwhile says nothing [s]."""

STEADY, STEADY_IMAGES = 1.5, 5
"""After a step the quality is steady again from the image on with which so many in a row are no more than this below
the mean of the second half of the time until the next step [dB]."""

Row = Dict[str, Any]
"""A row of a table."""

Quality = Callable[[int, int], float]
"""f(number of the camera's image, place of the image shown) -> PSNR [dB]"""


class Taken(NamedTuple):
    """An image that the camera took."""
    number: int
    stamp: float
    """Time at which it was taken, by time.time() [s]."""


class Shown(NamedTuple):
    """An image that appeared on the screen."""
    number: Optional[int]
    """Which of the camera's; None: unknown."""
    arrival: float
    """By time.time() [s]."""
    place: int
    """Among the images recorded."""


class LinkSample(NamedTuple):
    """What the robot's side says of the link, and what the link has carried."""
    time: float
    """By time.time() [s]."""
    rate: float
    """The link's true one [Mbit/s]."""
    carried: float
    """Since the last sample [Mbit/s]."""
    dropped: int
    """Datagrams in the link's queue since the last sample."""
    status: Dict[str, float]
    """See LinkStatus; empty: nothing is known."""


@dataclass
class Screen:
    """What was seen of a method on a link."""
    taken: Sequence[Taken]
    shown: Sequence[Shown]
    quality: Quality

    def __post_init__(self) -> None:
        self.stamps = {one.number: one.stamp for one in self.taken}
        self._taken_at = [one.stamp for one in self.taken]
        self._shown_at = [one.arrival for one in self.shown]

    def age(self, one: Shown) -> Optional[float]:
        """The age of an image when it appeared; None: unknown [s]."""
        stamp = None if one.number is None else self.stamps.get(one.number)
        return None if stamp is None else one.arrival - stamp

    def image_psnr(self, one: Shown) -> Optional[float]:
        """The PSNR of an image, compared with that of the camera's that it shows; None: that is unknown [dB]."""
        return None if one.number is None else self.quality(one.number, one.place)

    def psnr(self, when: float) -> Optional[float]:
        """The PSNR of the screen at a time, compared with what the camera sees; None before the first image [dB]."""
        seen, shown = (bisect.bisect(times, when) - 1 for times in (self._taken_at, self._shown_at))
        if seen < 0 or shown < 0:
            return None
        return self.quality(self.taken[seen].number, self.shown[shown].place)

    def course(self, begun: float, ended: float) -> List[Tuple[float, float]]:
        """[(time, PSNR of the screen [dB])], each SAMPLED."""
        course = [(when, self.psnr(when)) for when in np.arange(begun, ended, SAMPLED).tolist()]
        return [(when, psnr) for when, psnr in course if psnr is not None]


def spread(values: Sequence[float], share: float = 5) -> Tuple[Optional[float], Optional[float], Optional[float]]:
    """(mean, 5th percentile, least) of some values; None each: there are none."""
    if not values:
        return None, None, None
    return statistics.fmean(values), float(np.percentile(values, share)), min(values)


def longest_gap(times: Sequence[float], begun: float, ended: float) -> float:
    """The longest time without an image between two moments [s]."""
    inside = [begun, *(when for when in times if begun < when < ended), ended]
    return max(after - before for before, after in zip(inside, inside[1:]))


def judged(screen: Screen, samples: Sequence[LinkSample], begun: float, ended: float) -> Row:
    """A row of the table: of what was seen between two moments."""
    shown = [one for one in screen.shown if begun <= one.arrival < ended]
    images = [psnr for psnr in map(screen.image_psnr, shown) if psnr is not None]
    ages = [age for age in map(screen.age, shown) if age is not None]
    row: Row = {}
    for name, values in (('image', images), ('screen', [psnr for _, psnr in screen.course(begun, ended)])):
        row.update(zip(('%s mean [dB]' % name, '%s 5 %% [dB]' % name, '%s worst [dB]' % name), spread(values)))
    for share in (50, 95):
        row['age p%d [s]' % share] = float(np.percentile(ages, share)) if ages else None
    row['freeze [s]'] = longest_gap([one.arrival for one in screen.shown], begun, ended)
    row['rate [Hz]'] = len(shown) / (ended - begun)
    said = [one for one in samples if begun <= one.time < ended]
    return {**row, **link_use(said), 'used while blurred': link_use(blurred(screen, said))['used']}


def blurred(screen: Screen, samples: Sequence[LinkSample]) -> List[LinkSample]:
    """The samples of the times in which images were not SHARP, on average, or there were none for FROZEN."""
    found = []
    for before, one in zip(samples, samples[1:]):
        images = [psnr for psnr in (screen.image_psnr(image) for image in screen.shown
                                    if before.time <= image.arrival < one.time) if psnr is not None]
        is_blurred = statistics.fmean(images) < SHARP if images else one.time - before.time > FROZEN
        if is_blurred:
            found.append(one)
    return found


def link_use(samples: Sequence[LinkSample]) -> Row:
    """How much of the link was used, and how often its capacity was known; None: nothing is known."""
    capacities = [abs(one.status['capacity'] / one.rate - 1) <= TOLERANCE for one in samples if one.status]
    return {'used': statistics.fmean(one.carried / one.rate for one in samples) if samples else None,
            'capacity known': statistics.fmean(capacities) if capacities else None,
            'dropped': sum(one.dropped for one in samples)}


def judged_step(screen: Screen, samples: Sequence[LinkSample], begun: float, ended: float) -> Row:
    """A row of the table of steps: of what was seen from one change of the rate to the next."""
    shown = [one for one in screen.shown if begun <= one.arrival < ended]
    ages = [age for age in map(screen.age, shown) if age is not None]
    images = [(one.arrival, psnr) for one in shown for psnr in [screen.image_psnr(one)] if psnr is not None]
    steady = [psnr for when, psnr in images if when > (begun + ended) / 2]
    return {'oldest [s]': max(ages, default=None), 'steady after [s]': settled_after(images, steady, begun),
            'steady mean [dB]': spread(steady)[0], 'worst [dB]': spread([psnr for _, psnr in images])[2],
            **link_use([one for one in samples if begun <= one.time < ended])}


def settled_after(images: Sequence[Tuple[float, float]], steady: Sequence[float], begun: float) -> Optional[float]:
    """How long after a step its steady quality is reached [s]; None: never.

    :param images: [(arrival, PSNR)]
    :param steady: PSNR of the later ones of them
    """
    good = [psnr >= statistics.fmean(steady) - STEADY for _, psnr in images] if steady else []
    for at in range(len(good) - STEADY_IMAGES + 1):
        if all(good[at:at + STEADY_IMAGES]):
            return images[at][0] - begun
    return None


def aged_as(screen: Screen, quality: Quality) -> Screen:
    """The same screen, if its images had been other ones of the same moments.

    :param quality: of these, whose place is the number of the camera's image
    """
    return Screen(screen.taken, [one._replace(place=one.number) for one in screen.shown if one.number is not None],
                  quality)


def image_rows(screen: Screen, sizes: Mapping[int, Sized]) -> List[Row]:
    """A line for each image shown: when it appeared, what it is like, and what both sides say of it, where they do."""
    rows = []
    for one in screen.shown:
        said = sizes.get(-1 if one.number is None else one.number)
        rows.append({'time [s]': one.arrival - screen.shown[0].arrival, 'number': one.number,
                     'age [s]': screen.age(one),
                     'coding': said and said.coding, 'used [byte]': said and said.used,
                     'granted [byte]': said and said.granted, 'bound': said and said.bound,
                     'estimated PSNR [dB]': of_rms(said.error) if said else None,
                     'PSNR [dB]': screen.image_psnr(one)})
    return rows


def of_rms(error: float) -> float:
    """The PSNR of an image of 8 bits with this rms error, at most MAX_PSNR [dB]."""
    return min(MAX_PSNR, 20 * math.log10(255 / error)) if error > 0 else MAX_PSNR


def link_rows(samples: Sequence[LinkSample], begun: float) -> List[Row]:
    """A line for each sample of the link; rates in Mbit/s, times in s."""
    fields = sorted({name for one in samples for name in one.status})
    return [{'time': one.time - begun, 'true rate': one.rate, 'carried': one.carried, 'dropped': one.dropped,
             **{name: one.status.get(name) for name in fields}} for one in samples]
