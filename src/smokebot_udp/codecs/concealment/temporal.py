# SPDX-License-Identifier: BSD-3-Clause
"""Completes a picture with what came of earlier ones, while the scene stands (D6.3, section 4.2, last paragraph).

Whether it stands is seen in the pictures themselves. A pixel that came now and is remembered too makes a pair;
in a square cell of pixels the pairs' squared differences add up, and where they are more than the sensor's noise
explains (a chi-square test), the cell has changed: it and its neighbours are forgotten.
"""
import math
from typing import NamedTuple, Optional

import numpy as np

from ..wire.interleave import table

SMALLEST_CELL, LARGEST_CELL = 8, 64
"""The side of a cell [pixel], a power of two between them: the less came, the larger, so that each has pairs."""

PAIRS_WANTED = 8
"""So many pairs a cell is to have where only one earlier picture, with as much loss, is remembered."""

PAIRS_NEEDED = 8
"""Remembered pixels are shown only where their cell and its neighbours have so many pairs to vouch for them."""

CERTAIN = 4.75
"""Standard deviations of a normal variable: one cell in a million is forgotten for noise alone."""

MARGIN = 2.0
"""Noise of so many times the usual variance is still noise: bright and dark parts of a picture differ in it."""

RISE = 1.02
"""What is held for the noise's variance grows by at most so much a picture, and falls at once: what moves looks
like noise, but no sensor's noise rises like that."""

LEAST = 2.0
"""The variance of the difference of two whole numbers is never thought to be less, as if a sensor's noise were one
count: nobody sees less, and where a compressed picture is flat there seems to be none."""

ALIKE = 3.0
"""So much less may a camera that smooths or compresses make neighbours differ than its noise does, in variance."""

MUCH = 1e15
"""What a number differs from what is none. Sums of its square are still float32."""

MOVED = 0.5
"""Where a larger share of the cells has changed, the camera has moved, and everything is forgotten."""


class Integrated(NamedTuple):
    """A completed picture."""
    items: np.ndarray
    """(height, width) array of the picture's item dtype."""
    known: np.ndarray
    """(height, width) bool: the pixels that were received, now or earlier; the others are filled."""
    oldest: float
    """The age of the oldest pixel shown, 0 where all are of this picture [s]."""
    changed: Optional[float]
    """The share of the cells that changed, 0..1; None where there was nothing to compare with."""

    @property
    def share(self):
        """The share of the pixels that are known, 0..1."""
        return float(np.count_nonzero(self.known)) / self.known.size


class Memory:
    """What came of the earlier pictures of a stream; of one thread only.

    :param max_age: pixels are remembered so long [s]
    """

    def __init__(self, max_age=5.0):
        self.max_age = max_age
        self._layout = None
        self._now = -math.inf

    def forget(self):
        """Forget everything, the sensor's noise too."""
        self._layout = None

    def complete(self, items, have, cut, channel, now, use=True):
        """Show a picture as well as it is known, and remember what came of it.

        :param items: (height, width) array of whole pixels, C-contiguous: the picture, its missing pixels filled;
                      not changed, but kept: it must stay as it is
        :param have: (n,) bool, which subimages were received, in cut.order
        :param cut: Interleave of the picture
        :param channel: dtype of a pixel's numbers, in their byte order, see pixels.pixel_type
        :param now: [s], of a clock that does not jump
        :param use: False: show nothing remembered, and forget all but this picture: the robot drives
        :return: Integrated
        """
        layout = cut, items.dtype, channel
        if layout != self._layout or now < self._now:
            self._begin(layout, now)
        self._now = now
        moment = np.float32(now - self._began + 1)
        came = received(have, cut)
        known = self._seen >= max(moment - np.float32(self.max_age), np.float32(1))
        side = _side(have)
        changed, pairs = self._changed(_numbers(items, channel), _numbers(self._items, channel), came, known, side)
        compared = np.count_nonzero(pairs)
        share = float(np.count_nonzero(changed)) / compared if compared else None
        if have.all():    # nothing remembered is shown, and everything is remembered anew
            self._items = items
            self._seen.fill(moment)
            return Integrated(items, came, 0.0, share)
        if not use or (compared and share > MOVED):
            self._seen.fill(0)
            known = np.zeros_like(came)
        else:
            stands = _with_neighbours(changed) == 0
            vouched = stands & (_with_neighbours(pairs) >= PAIRS_NEEDED)
            if not stands.all():
                self._seen *= _of_cells(stands, side, came.shape)
            known &= _of_cells(vouched, side, came.shape)
        return self._show(items, came, known & ~came, moment, share)

    def _begin(self, layout, now):
        cut, dtype, _ = self._layout = layout
        self._began = now
        self._items = np.zeros((cut.height, cut.width), dtype)
        self._seen = np.zeros((cut.height, cut.width), np.float32)   # when, a second before _began is 0 [s]; 0: never
        self._noise = 0.0   # variance of the difference of two pictures of the same scene; 0: never heard

    def _show(self, items, came, remembered, moment, share):
        shown = _choose(remembered, self._items, items)
        oldest = float(((moment - self._seen) * remembered).max())
        self._items = _choose(came, items, self._items)
        np.maximum(self._seen, came * moment, out=self._seen)
        return Integrated(shown, came | remembered, oldest, share)

    def _changed(self, new, old, came, known, side):
        """Which cells changed, (rows, columns) bool, and how many pairs each has, float32."""
        squares, pairs = _differences(new, old, came & known, side)
        noise = self._hear(squares, pairs, new, came)
        with np.errstate(divide='ignore', invalid='ignore'):
            # the chi-square distribution's far end, by Wilson and Hilferty
            freedom = pairs * new.shape[2]
            spread = 2 / (9 * freedom)
            most = MARGIN * noise * freedom * (1 - spread + CERTAIN * np.sqrt(spread)) ** 3
            return (squares > most) & (pairs > 0), pairs

    def _hear(self, squares, pairs, new, came):
        """The variance of a difference that is the noise's: as much as most cells changed by.

        If all of them moved, that is too much. But neighbours in one picture differ by the noise and by what is
        seen: the noise is no more than that, give or take what a camera does to make neighbours alike.
        """
        least = LEAST if new.dtype.kind == 'u' else 0.0
        if pairs.any():
            few = slice(None, None, 7)   # rows, enough of them, and of all subimages
            beside = _differences(new[few, 1:], new[few, :-1], came[few, 1:] & came[few, :-1], SMALLEST_CELL)
            noise = min(_usual(squares, pairs), ALIKE * _usual(*beside)) / new.shape[2]
            if not self._noise:
                self._noise = max(noise, least) if math.isfinite(noise) else 0.0
            elif noise:   # else the camera repeats itself, which tells nothing
                self._noise = max(min(noise, self._noise * RISE), least)
        return max(self._noise, least)


def received(have, cut):
    """(height, width) bool: the pixels that came, of the subimages that came."""
    positions = cut.positions[table(cut.depth)]
    block = (positions >= 0) & have[positions]
    (rows, columns), p = cut.shape, cut.p
    across = np.tile(block, (1, columns))[:, :cut.width]
    return np.broadcast_to(across, (rows, p, cut.width)).reshape(rows * p, cut.width)[:cut.height]


def _side(have):
    share = np.count_nonzero(have) / len(have)
    side = SMALLEST_CELL
    while side < LARGEST_CELL and (share * side) ** 2 < PAIRS_WANTED:
        side *= 2
    return side


def _numbers(items, channel):
    """(height, width, channels) view."""
    return items.view(channel).reshape(items.shape + (-1,))


def _differences(first, second, both, side):
    """The squared differences of two pictures where there are both, by cells.

    :param both: (height, width) bool
    :return: their sums, and how many pairs of pixels, both (rows, columns) float32; of what is no number in
             one of them only, MUCH squared
    """
    weights = both.astype(np.float32)
    with np.errstate(invalid='ignore', over='ignore'):
        difference = np.subtract(first, second, dtype=np.float32, casting='unsafe')
        if first.dtype.kind == 'f':
            _settle(difference, first, second)
        np.multiply(difference, difference, out=difference)
        squares = sum((difference[..., channel] for channel in range(1, difference.shape[2])), difference[..., 0])
        return _cells(squares * weights, side), _cells(weights, side)


def _settle(difference, first, second):
    """What is no number, as where a depth camera sees nothing, differs from numbers only, and much."""
    strange = ~(np.abs(difference) < MUCH)
    if strange.any():
        difference[strange] = np.where(np.isfinite(first[strange]) | np.isfinite(second[strange]), MUCH, 0)


def _cells(pixels, side):
    """Their sums in cells: (height, width) -> (ceil(height / side), ceil(width / side))."""
    (height, width), below, beside = pixels.shape, -pixels.shape[0] % side, -pixels.shape[1] % side
    if below or beside:
        pixels = np.pad(pixels, ((0, below), (0, beside)))
    rows, columns = (height + below) // side, (width + beside) // side
    return pixels.reshape(rows, side, width + beside).sum(axis=1).reshape(rows, columns, side).sum(axis=2)


def _usual(squares, pairs):
    """The mean squared difference of the median cell of numbers; infinite where there is none."""
    some = (pairs >= min(PAIRS_WANTED, pairs.max(initial=1))) & (squares < MUCH)
    return float(np.median(squares[some] / pairs[some])) if some.any() else math.inf


def _with_neighbours(cells):
    """The sum of each cell and the eight around it."""
    ringed = np.pad(cells.astype(np.float32), 1)
    rows = ringed[:-2] + ringed[1:-1] + ringed[2:]
    return rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]


def _of_cells(cells, side, shape):
    """What holds for cells, for their pixels: (height, width) bool."""
    return np.repeat(np.repeat(cells, side, axis=1)[:, :shape[1]], side, axis=0)[:shape[0]]


def _choose(mask, chosen, others):
    """np.where(mask, chosen, others), for whole pixels of any dtype, C-contiguous.

    By bits: a branch for each pixel, which no processor foresees in such a mask, takes ten times as long.
    """
    word = chosen.dtype if chosen.dtype.kind == 'u' else np.dtype(np.uint8)
    old, new = _numbers(others, word), _numbers(chosen, word)
    bits = np.empty(new.shape, word)
    for i in range(new.shape[2]):   # np.repeat takes ten times as long, too
        np.negative(mask, out=bits[..., i], dtype=word, casting='unsafe')
    return (old ^ ((old ^ new) & bits)).view(chosen.dtype).reshape(mask.shape)
