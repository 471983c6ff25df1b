# SPDX-License-Identifier: BSD-3-Clause
"""Fills missing pixels with those of earlier images where the scene stands still (D6.3, section 4.2, last paragraph).

Whether it stands still is measured in the images, see cells.py: a pixel that is received and also known from earlier
images is a pair. A cell that has changed and its neighbours are forgotten.
"""
import math
from typing import NamedTuple, Optional, Tuple, Union

import numpy as np

from ...arrays import Array, BoolArray, DType, Float32Array
from ..wire.interleave import Interleave
from ..wire.partial_image import PartialImage
from .cells import MIN_CELL, PAIRS_EXPECTED, CellComparison, numbers_of

MAX_CELL = 64
"""The side of a cell is a power of two from MIN_CELL to this: the fewer pixels are received, the larger, so it has
PAIRS_EXPECTED if only one earlier image, with the same loss, is known [pixel]."""

MIN_PAIRS = 8
"""Earlier pixels are shown only if their cell and its neighbours together have this many pairs as evidence."""

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
        return float(np.count_nonzero(self.known)) / int(self.known.size)


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
        self._cells = CellComparison()

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
        changed, pairs = self._cells.compare(numbers_of(items, channel), numbers_of(self._items, channel), received,
                                             known, cell)
        compared = np.count_nonzero(pairs)
        ratio = float(np.count_nonzero(changed)) / compared if compared else None
        if image.have.all():    # no earlier pixel is shown, and all are replaced
            self._items = items
            self._seen.fill(time)
            return FilteredImage(items, received, ratio)
        if not use or (ratio is not None and ratio > MOVED):    # nor is any pixel of before kept
            self._items = items
            np.multiply(received, time, out=self._seen)
            return FilteredImage(items, received, ratio)
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
        self._cells = CellComparison()


def _cell_side(completeness: float) -> int:
    """Side of a cell in which PAIRS_EXPECTED pairs are expected [pixel]."""
    side = MIN_CELL
    while side < MAX_CELL and (completeness * side) ** 2 < PAIRS_EXPECTED:
        side *= 2
    return side


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
    """Select whole pixels of any dtype as np.where(mask, chosen, others) does; the result is C-contiguous.

    By bits: a branch for each pixel, which no processor predicts in such a mask, takes ten times as long.
    """
    word = chosen.dtype if chosen.dtype.kind == 'u' else np.dtype(np.uint8)
    old, new = numbers_of(others, word), numbers_of(chosen, word)
    bits = np.empty(new.shape, word)
    for i in range(new.shape[2]):   # np.repeat takes ten times as long, too
        np.negative(mask, out=bits[..., i], dtype=word, casting='unsafe')
    selected: Array = old ^ ((old ^ new) & bits)
    return selected.view(chosen.dtype).reshape(mask.shape)
