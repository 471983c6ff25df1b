# SPDX-License-Identifier: BSD-3-Clause
"""Fills missing pixels with those of earlier images where the scene stands still (D6.3, section 4.2, last paragraph).

Whether it stands still is measured in the images. A pixel that is received and also known from earlier images is a
pair. The squared differences of the pairs are summed in square cells of pixels. A cell whose sum is more than the
sensor's noise explains (a chi-square test) has changed; it and its neighbours are forgotten.
"""
import math
from typing import NamedTuple, Optional, Tuple, Union

import numpy as np

from ...arrays import Array, BoolArray, DType, Float32Array
from ..wire.interleave import Interleave
from ..wire.partial_image import PartialImage

MIN_CELL, MAX_CELL = 8, 64
"""The side of a cell is a power of two between them: the fewer pixels are received, the larger, so it has pairs
[pixel]."""

PAIRS_EXPECTED = 8
"""Pairs that a cell should have if only one earlier image, with the same loss, is known."""

MIN_PAIRS = 8
"""Earlier pixels are shown only if their cell and its neighbours together have this many pairs as evidence."""

SIGNIFICANCE = 4.75
"""Standard deviations of a normal variable: noise alone makes one cell in a million look changed."""

NOISE_MARGIN = 2.0
"""Factor by which a cell's noise variance may exceed the image's: noise depends on brightness."""

MAX_NOISE_RISE = 1.02
"""The noise variance rises by at most this factor per image, and falls at once. Movement looks like noise, but no
sensor's noise rises like that."""

MIN_INTEGER_VARIANCE = 2.0
"""Lower limit for the variance of the difference of two integers, as if the noise were one count: less is invisible,
and flat parts of a compressed image seem to have none."""

SMOOTHING_FACTOR = 3.0
"""Factor by which a camera that smooths or compresses may reduce the variance between neighbouring pixels."""

NAN_DIFFERENCE = 1e15
"""Difference between a number and NaN. Sums of its square are finite in float32."""

MOVED = 0.5
"""If a larger ratio of the cells has changed, the camera has moved, and everything is forgotten."""


class FilteredImage(NamedTuple):
    """An image whose missing pixels are those of earlier images where possible."""
    items: Array
    """(height, width) array of the image's item dtype."""
    known: BoolArray
    """(height, width) bool: the pixels received, with this image or an earlier one; the others are filled."""
    changed: Optional[float]
    """Ratio of the cells that changed, 0..1; None if nothing could be compared."""

    @property
    def known_ratio(self) -> float:
        """Ratio of the pixels that are known, 0..1."""
        return float(np.count_nonzero(self.known)) / self.known.size


class TemporalFilter:
    """Keeps the pixels of a stream's earlier images. Not thread-safe.

    :param max_age: earlier pixels are shown up to this age [s]
    """

    def __init__(self, max_age: float = 5.0) -> None:
        self.max_age = max_age
        self._layout: Optional[Tuple[Interleave, DType, DType]] = None
        self._began = self._now = -math.inf
        self._items: Array = np.zeros((0, 0))
        self._seen: Float32Array = np.zeros((0, 0), np.float32)
        """When each pixel was received, one second before _began is 0 [s]; 0: never."""
        self._noise = 0.0
        """Variance of the difference of two images of the same scene; 0: unknown."""

    def reset(self) -> None:
        """Forget everything, including the sensor's noise."""
        self._layout = None

    def apply(self, image: PartialImage, items: Array, channel: DType, now: float, use: bool = True) -> FilteredImage:
        """Replace filled pixels by earlier ones where the scene stands still, and keep the received ones.

        An image of another size, depth or pixel type, or a clock that goes back, resets the filter.

        :param image: the subimages received; `image.received` is the only mask this needs
        :param items: (height, width) array of whole pixels, C-contiguous: the image, its missing pixels filled. It is
            not changed, but kept: the caller must not change it either.
        :param channel: dtype of a pixel's numbers, in their byte order, see pixels.pixel_type
        :param now: by a clock that does not jump [s]
        :param use: False: show no earlier pixels and forget all but this image, as while the robot drives
        """
        layout = image.cut, items.dtype, channel
        if layout != self._layout or now < self._now:
            self._begin(layout, now)
        self._now = now
        time = np.float32(now - self._began + 1)
        received, cell = image.received, _cell_side(image.completeness)
        known: BoolArray = self._seen >= max(time - np.float32(self.max_age), np.float32(1))
        changed, pairs = self._compare(_numbers(items, channel), _numbers(self._items, channel), received, known, cell)
        compared = np.count_nonzero(pairs)
        ratio = float(np.count_nonzero(changed)) / compared if compared else None
        if image.have.all():    # no earlier pixel is shown, and all are replaced
            self._items = items
            self._seen.fill(time)
            return FilteredImage(items, received, ratio)
        if not use or (ratio is not None and ratio > MOVED):
            self._seen.fill(0)
            known = np.zeros_like(received)
        else:
            unchanged = _with_neighbours(changed) == 0
            supported = unchanged & (_with_neighbours(pairs) >= MIN_PAIRS)
            if not unchanged.all():
                self._seen *= _pixels_of(unchanged, cell, received.shape)
            known &= _pixels_of(supported, cell, received.shape)
        shown = _select(known & ~received, self._items, items)
        self._items = _select(received, items, self._items)
        np.maximum(self._seen, received * time, out=self._seen)
        return FilteredImage(shown, received | known, ratio)

    def _begin(self, layout: Tuple[Interleave, DType, DType], now: float) -> None:
        cut, dtype, _ = self._layout = layout
        self._began = now
        self._items = np.zeros((cut.height, cut.width), dtype)
        self._seen = np.zeros((cut.height, cut.width), np.float32)
        self._noise = 0.0

    def _compare(self, new: Array, old: Array, received: BoolArray, known: BoolArray,
                 cell: int) -> Tuple[BoolArray, Float32Array]:
        """Which cells changed, (rows, columns) bool, and the number of pairs of each, float32.

        :param new, old: (height, width, channels) numbers of the images
        """
        squares, pairs = _squared_differences(new, old, received & known, cell)
        noise = self._update_noise(squares, pairs, new, received)
        with np.errstate(divide='ignore', invalid='ignore'):
            # quantile of the chi-square distribution: E. B. Wilson and M. M. Hilferty, 1931
            freedom = pairs * new.shape[2]
            spread = 2 / (9 * freedom)
            limit = NOISE_MARGIN * noise * freedom * (1 - spread + SIGNIFICANCE * np.sqrt(spread)) ** 3
            return (squares > limit) & (pairs > 0), pairs

    def _update_noise(self, squares: Float32Array, pairs: Float32Array, new: Array, received: BoolArray) -> float:
        """The noise variance of a difference: by how much the median cell changed.

        If all cells moved, that is too much. But neighbouring pixels of one image differ by the noise and by the scene,
        so the noise is not more than that, except for what SMOOTHING_FACTOR allows.
        """
        lower_limit = MIN_INTEGER_VARIANCE if new.dtype.kind == 'u' else 0.0
        if pairs.any():
            some = slice(None, None, 7)   # rows: enough of them, and of all subimages
            beside = _squared_differences(new[some, 1:], new[some, :-1], received[some, 1:] & received[some, :-1],
                                          MIN_CELL)
            noise = min(_median_square(squares, pairs), SMOOTHING_FACTOR * _median_square(*beside)) / new.shape[2]
            if not self._noise:
                self._noise = max(noise, lower_limit) if math.isfinite(noise) else 0.0
            elif noise:   # with 0 the camera repeats an image, which is no measurement
                self._noise = max(min(noise, self._noise * MAX_NOISE_RISE), lower_limit)
        return max(self._noise, lower_limit)


def _cell_side(completeness: float) -> int:
    """Side of a cell in which PAIRS_EXPECTED pairs are expected [pixel]."""
    side = MIN_CELL
    while side < MAX_CELL and (completeness * side) ** 2 < PAIRS_EXPECTED:
        side *= 2
    return side


def _numbers(items: Array, channel: DType) -> Array:
    """(height, width, channels) view."""
    return items.view(channel).reshape(items.shape + (-1,))


def _squared_differences(first: Array, second: Array, both: BoolArray, side: int) -> Tuple[Float32Array, Float32Array]:
    """Sums of the squared differences of two images in cells, and the number of pixels compared in each.

    :param first, second: (height, width, channels) numbers
    :param both: (height, width) bool: the pixels to compare
    :return: both (rows, columns) float32; NAN_DIFFERENCE stands for the difference of a number and NaN
    """
    weights = both.astype(np.float32)
    with np.errstate(invalid='ignore', over='ignore'):
        difference: Float32Array = np.subtract(first, second, dtype=np.float32, casting='unsafe')
        if first.dtype.kind == 'f':
            # NaN, as where a depth camera sees nothing, equals NaN only
            undefined = ~(np.abs(difference) < NAN_DIFFERENCE)
            if undefined.any():
                number = np.isfinite(first[undefined]) | np.isfinite(second[undefined])
                difference[undefined] = np.where(number, NAN_DIFFERENCE, 0)
        np.multiply(difference, difference, out=difference)
        squares = difference[..., 0]
        for channel in range(1, difference.shape[2]):
            squares = squares + difference[..., channel]
        return _sum_cells(squares * weights, side), _sum_cells(weights, side)


def _sum_cells(pixels: Float32Array, side: int) -> Float32Array:
    """Sums over cells: (height, width) -> (ceil(height / side), ceil(width / side))."""
    (height, width), below, beside = pixels.shape, -pixels.shape[0] % side, -pixels.shape[1] % side
    if below or beside:
        pixels = np.pad(pixels, ((0, below), (0, beside)))
    rows, columns = (height + below) // side, (width + beside) // side
    sums: Float32Array = pixels.reshape(rows, side, width + beside).sum(axis=1).reshape(rows, columns, side).sum(axis=2)
    return sums


def _median_square(squares: Float32Array, pairs: Float32Array) -> float:
    """The mean squared difference of the median cell; infinite if there is none."""
    some = (pairs >= min(PAIRS_EXPECTED, pairs.max(initial=1))) & (squares < NAN_DIFFERENCE)
    return float(np.median(squares[some] / pairs[some])) if some.any() else math.inf


def _with_neighbours(cells: Union[BoolArray, Float32Array]) -> Float32Array:
    """The sum of each cell and the eight around it."""
    padded = np.pad(cells.astype(np.float32), 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    sums: Float32Array = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return sums


def _pixels_of(cells: BoolArray, side: int, shape: Tuple[int, ...]) -> BoolArray:
    """Each pixel's cell: (rows, columns) -> (height, width) bool."""
    return np.repeat(np.repeat(cells, side, axis=1)[:, :shape[1]], side, axis=0)[:shape[0]]


def _select(mask: BoolArray, chosen: Array, others: Array) -> Array:
    """np.where(mask, chosen, others), for whole pixels of any dtype, C-contiguous.

    By bits: a branch for each pixel, which no processor predicts in such a mask, takes ten times as long.
    """
    word = chosen.dtype if chosen.dtype.kind == 'u' else np.dtype(np.uint8)
    old, new = _numbers(others, word), _numbers(chosen, word)
    bits = np.empty(new.shape, word)
    for i in range(new.shape[2]):   # np.repeat takes ten times as long, too
        np.negative(mask, out=bits[..., i], dtype=word, casting='unsafe')
    selected: Array = old ^ ((old ^ new) & bits)
    return selected.view(chosen.dtype).reshape(mask.shape)
