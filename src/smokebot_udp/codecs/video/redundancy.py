# SPDX-License-Identifier: BSD-3-Clause
"""How much of an image's bytes protects the rest: as much as makes the expected error on the screen least.

More parity pieces leave fewer bytes for the slices, whose coding error rises. Fewer make it likelier that an image
cannot be restored. Then a part of it shows the last image, and what is predicted from it remains wrong until the intra
refresh has passed. What is minimised is the expected logarithm of the error: the mean PSNR.
"""
import bisect
import functools
import math
from typing import Callable, Iterator, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ...arrays import FloatArray
from ..layered.survival import arrivals
from .protection import LENGTH_BYTES, MAX_PIECES

RATE_EXPONENT = 1.0
"""The coding error falls with this power of the bytes. Measured: 0.65 (a slow camera with noise) to 1.4 (each image
another view)."""

REMAINS = 0.5
"""What is lost remains wrong for this part of a refresh cycle, on average."""

UNPREDICTABLE = 300.0
"""Where images differ by this mean squared error, half of the next image is coded without reference [count^2]."""

CLEARLY = 0.06
"""A quarter of a decibel: a logarithm of the error that is lower by less is not worth a change."""

BELIEVED = 0.9
"""Losses are considered from the lightest one on, up to this probability in total. Heavier ones are mixed in as layers
need it: to protect their first bytes against them is cheap, but to protect whole images is not."""

NEGLIGIBLE = 0.004
"""Losses that are less likely are left out, too."""

LEAST_SLICES = 0.25
"""However heavy the losses, slices take this part of the bytes: a blurred image is of no use."""

MOST_COPIES = int(1 / LEAST_SLICES) - 1
"""Parity pieces of an only slice: they are as short as the slice."""

CACHED = 256
"""Numbers of datagrams whose probabilities are cached."""


class Scene(NamedTuple):
    """What losses do to the images of a stream."""
    coding_error: float
    """Mean squared error of a coded image, if there were no parity pieces, above 0 [count^2]."""
    change: float
    """Mean squared difference between an image and the next one [count^2]."""
    refresh: int
    """Number of images of a refresh cycle."""
    intra_cost: float = math.inf
    """The coding error if no image were predicted, relative to that with a long refresh cycle."""

    @property
    def damage(self) -> float:
        """The damage that the loss of an image does to the image itself, relative to the coding error."""
        return self.change / self.coding_error

    @property
    def later(self) -> float:
        """The damage that the loss of an image does to later images, relative to that to the image itself."""
        return max(REMAINS * self.refresh - 1, 0.0) / (1 + self.change / UNPREDICTABLE)


class Link(NamedTuple):
    """What becomes of an image's datagrams."""
    losses: Mapping[float, float]
    """{packet loss: its probability}"""
    burst: Optional[float] = None
    """Mean number of datagrams lost in a row; None: losses are independent."""


class Sizes(NamedTuple):
    """Sizes of the parts of an image's datagrams [byte]."""
    room: int
    """Room for a slice."""
    head: int
    """Size of a datagram on the air without its piece."""

    @property
    def parity(self) -> int:
        """The size of a parity piece on the air."""
        return self.room + LENGTH_BYTES + self.head


class Division(NamedTuple):
    """How an image's bytes are divided."""
    size: int
    """For all slices [byte]."""
    parities: int
    """Parity pieces that this leaves room for."""
    error: float
    """As `expected_error`."""


def divide(budget: float, sizes: Sizes, scene: Scene, link: Link, usual: Optional[int] = None) -> Division:
    """Divide the bytes of an image among slices and parity pieces.

    :param budget: all datagrams on the air [byte]
    :param usual: parity pieces that the last image was divided for, which are kept unless others are clearly better:
        one piece more may take a third of a small image's slices, and libx264 follows slowly
    """
    def error(number: int) -> float:
        return division(budget, number, sizes, scene, link).error - CLEARLY * (number == usual)
    whole = math.ceil(slice_bytes(budget, 0, sizes) / sizes.room)
    most = min(max(int((1 - LEAST_SLICES) * budget / sizes.parity), MOST_COPIES), MAX_PIECES - whole)
    likely = whole * math.fsum(loss * weight for loss, weight in link.losses.items())
    return division(budget, _best(error, most, [usual or 0, int(likely)]), sizes, scene, link)


def division(budget: float, number: int, sizes: Sizes, scene: Scene, link: Link) -> Division:
    """What a number of parity pieces leaves, and promises.

    :param budget: as of `divide`
    """
    size = slice_bytes(budget, number, sizes)
    cost = slice_bytes(budget, 0, sizes) / size
    return Division(int(size), number, expected_error(math.ceil(size / sizes.room), number, cost, scene, link))


def parities(slices: Sequence[int], most: int, sizes: Sizes, scene: Scene, link: Link) -> int:
    """The number of parity pieces of an image that is coded.

    :param slices: their lengths [byte]
    :param most: parity pieces that there is room for
    """
    count, parity = len(slices), max(slices) + LENGTH_BYTES + sizes.head
    on_air = sum(slices) + count * sizes.head

    def error(number: int) -> float:
        return expected_error(count, number, 1 + number * parity / on_air, scene, link)
    return _best(error, min(most, MAX_PIECES - count), [most])


def expected_error(count: int, parities: int, cost: float, scene: Scene, link: Link) -> float:
    """The expected logarithm of the mean squared error on the screen, relative to the coding error without parity.

    :param count: slices
    :param cost: bytes that the slices would have without parity, relative to those that they have
    """
    weights = _believed(link.losses)
    matter = weights >= NEGLIGIBLE
    pieces = count + parities
    likely = _arrivals(pieces, tuple(link.losses), link.burst)[matter]
    lost = 1 - np.arange(pieces + 1) / pieces
    lost[count:] = 0
    usually = np.minimum(likely @ lost, 0.999)[:, np.newaxis]
    wrong = lost + scene.later * usually / (1 - usually)
    errors = np.log(cost ** RATE_EXPONENT + scene.damage * wrong)
    return float(weights[matter] @ (likely * errors).sum(axis=1) / weights[matter].sum())


def slice_bytes(budget: float, parities: int, sizes: Sizes) -> float:
    """What parity pieces leave of a budget for the slices, without their heads [byte].

    They are as long as the longest slice: where one slice remains, it is shorter than a datagram's room, and so are
    they.
    """
    left = budget - parities * sizes.parity
    if left < sizes.room + sizes.head:
        return max((budget - parities * LENGTH_BYTES) / (parities + 1) - sizes.head, 1.0)
    return left * sizes.room / (sizes.room + sizes.head)


def _believed(losses: Mapping[float, float]) -> FloatArray:
    """(losses,) their probabilities, without those of the heaviest."""
    order = np.argsort(list(losses))
    weights: FloatArray = np.array(list(losses.values()))
    total = np.minimum(np.cumsum(weights[order]), BELIEVED * weights.sum())
    weights[order] = np.diff(total, prepend=0.0)
    return weights


@functools.lru_cache(maxsize=CACHED)
def _arrivals(pieces: int, losses: Tuple[float, ...], burst: Optional[float]) -> FloatArray:
    """(losses, pieces + 1): how likely each number of datagrams comes."""
    loss: FloatArray = np.clip(np.array(losses), 1e-6, 1 - 1e-6)
    recovery = 1 - loss if burst is None else np.minimum(1 / burst, 1 - loss)
    likely = arrivals(pieces, loss, recovery)
    likely.setflags(write=False)
    return likely


def _best(error: Callable[[int], float], most: int, starts: Sequence[int]) -> int:
    """The number of parity pieces with the least error: downhill from none, and from other numbers."""
    numbers = list(_candidates(max(most, 0)))
    error_at = functools.lru_cache(maxsize=None)(lambda place: error(numbers[place]))
    best = 0
    for start in [0, *starts]:
        place, last = min(bisect.bisect_left(numbers, start), len(numbers) - 1), -1
        while place != last:
            place, last = min((near for near in (place, place - 1, place + 1) if 0 <= near < len(numbers)),
                              key=error_at), place
        best = min(best, place, key=error_at)
    return numbers[best]


def _candidates(most: int) -> Iterator[int]:
    """Numbers of parity pieces from 0 on, in steps of a tenth."""
    number = 0
    while number <= most:
        yield number
        number += max(1, number // 10)
