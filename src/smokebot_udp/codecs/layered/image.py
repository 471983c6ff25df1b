# SPDX-License-Identifier: BSD-3-Clause
"""Encode and decode an image: doc/layered_images.md describes the stream."""
import itertools
import math
import struct
from typing import NamedTuple, Optional, Tuple

import numpy as np

from ...arrays import Array, DType, FloatArray, IntArray, UInt8Array
from ..wire.interleave import MAX_SIDE
from . import class_map, coefficients, contexts, layout, passes, prediction, range_coder
from .prefixes import Predicted, Prefixes, prefixes_of

SMALLEST = 0.1
"""Sums of squared errors of an exact stream below this are those of adding; one coefficient's is 0.36."""
PARTS = 24
"""A truncation point comes at least once for this part of the image's cells: a 24th."""
MAP_PART = 0.25
"""A map of classes takes this part of the budget at most, unless all of the stream fits."""
LEAST_MAP = 16
"""But it may always take this [byte]."""
PREDICTION_PART = 0.25
"""How the image is predicted takes this part of the budget at most."""
WORTH = 2.0
"""And it is thought to save this times what it takes."""
QUANTISED = 4.0 ** -layout.FINE / 12
"""The squared error of a cell by the rounding of the 9/7's coefficients."""
WRONG_CLASS = 1.0
"""A cell that is shown as finite but is not, or the other way round, counts as this squared error: a map that is not
exact makes no exact image."""
_HEAD, _LENGTH = struct.Struct('<BHHHBI'), struct.Struct('<I')
_LOSSLESS, _CLASSES, _COLOUR, _WIDE, _EXPONENT, _REFERENCE = 1, 2, 4, 8, 4, 128
"""Flags; and the first of the three bits that hold log2 of the sides of the blocks of the map of classes."""


class LayeredStream(NamedTuple):
    """An encoded image."""
    data: bytes
    """A head, then an embedded stream; any prefix decodes, with any bytes behind the whole."""
    ends: IntArray
    """(s,) ascending: truncation points [byte]; the first is the head's end, the last len(data)"""
    errors: FloatArray
    """(s,) about the squared error, summed over all cells, of data[:ends[i]]"""
    cells: int
    """Number of cells: height * width * channels."""
    prefixes: Prefixes
    """What its prefixes show."""
    missing: int = 0
    """What the exact map of classes takes more than the one that was coded [byte]; 0: that is exact."""
    saved: float = 0.0
    """The part of the bits, about, that the reference saves; 0: it was not used."""

    @property
    def predicted(self) -> bool:
        """Whether the reference was used: decode needs it."""
        return bool(self.data[0] & _REFERENCE)

    def cut(self, points: int) -> 'LayeredStream':
        """The stream up to its `points`-th truncation point, from 1 on, as a whole: zeros may follow it."""
        end = int(self.ends[points - 1])
        data = self.data[:_HEAD.size - _LENGTH.size] + _LENGTH.pack(end) + self.data[_HEAD.size:end]
        return self._replace(data=data, ends=self.ends[:points], errors=self.errors[:points],
                             prefixes=self.prefixes._replace(length=end))


class Decoded(NamedTuple):
    """A decoded image."""
    pixels: Array
    """As given to encode."""
    classes: Optional[UInt8Array]
    """(height, width) 0 finite, 1 NaN, 2 +Inf, 3 -Inf; None: all finite"""


class Read(NamedTuple):
    """A stream whose symbols were decoded."""
    prefixes: Prefixes
    classes: Optional[UInt8Array]
    """As of Decoded."""


def _new_work(plan: layout.Layout, data: UInt8Array, values: Array, predicted: bool) -> passes.Work:
    """:param values: see passes.Coefficients
    :param predicted: whether there is a reference
    """
    counted = int((plan.bands[:, layout.ROWS] * plan.bands[:, layout.COLUMNS]).sum())
    counts = np.zeros((len(plan.bands), 9), np.int64)
    counts[:, passes.BLOCKS] = np.diff(plan.firsts)
    live, quiet, found, known = (np.empty(counted, np.int32) for _ in range(4))
    log, marks = np.empty((len(plan.steps) // 3 * 5 + 1, 5), np.int32), np.full(len(data) // 2 + 16, -1, np.int32)
    return passes.Work(
        passes.Coefficients(values, np.zeros(plan.cells, np.uint8), np.zeros(plan.cells, np.int8), live, quiet, found,
                            known),
        passes.BlockLists(np.arange(len(plan.blocks), dtype=np.int32), plan.blocks.reshape(-1), plan.firsts,
                          np.zeros(plan.places, np.uint8), np.zeros(plan.places, np.uint8)),
        passes.Coding(counts, contexts.initial_odds(len(plan.bands)), np.zeros(1),
                      coefficients.guesses_of(plan.lossless, predicted), data, log, marks))


def _rounded(variance: float) -> float:
    """The variance of a normally distributed error once it is rounded to an integer."""
    return 2 * sum((2 * k - 1) * math.erfc((k - 0.5) / math.sqrt(2 * variance)) / 2 for k in range(1, 8))


_VARIANCES = np.concatenate([[0.0], np.geomspace(0.01, 1.0, 40)])
_ROUNDED = np.array([0.0] + [_rounded(float(variance)) for variance in _VARIANCES[1:]])


def _after_rounding(errors: FloatArray, cells: int, lossless: bool) -> FloatArray:
    """The squared errors once pixels are rounded: 1/12 of a count more, unless they are small.

    Of the 5/3, whose lifting steps round and whose coefficients are not orthogonal: fitted to photographs and thermal
    images.
    """
    variances = errors / cells
    if lossless:
        found = cells * (1.1 * variances + 0.42 * np.minimum(variances / 0.45, 1))
        return np.asarray(np.where(errors < SMALLEST, 0.0, found))
    variances = variances + QUANTISED
    small = np.interp(variances, _VARIANCES, _ROUNDED)
    return np.asarray(cells * np.where(variances < 1.0, small, variances + 1 / 12))


def _part(height: int, width: int) -> int:
    return max(height * width // PARTS, 256)


class _CodedMap(NamedTuple):
    """A map of classes, coded behind the head."""
    state: range_coder.State
    exponent: int
    wrong: int
    """Cells of another class."""
    missing: int
    """As LayeredStream.missing."""
    end: int
    """A decoder has read so far when it knows the last class, without which there is no image [byte]."""


def _code_map(classes: UInt8Array, data: UInt8Array, most: int) -> Optional[_CodedMap]:
    """Code the exact map, or the finest one of blocks, that ends before the byte `most`; None: not even the coarsest
    does."""
    room = np.zeros(len(data) + classes.size // 2, np.uint8)
    exact_end = 0
    for exponent, blocks in enumerate(itertools.chain([classes], class_map.reductions(classes))):
        complete, state = class_map.code_classes(True, blocks, room, range_coder.begin(True, room, _HEAD.size))
        at = state[2]
        end = at + range_coder.AHEAD
        exact_end = exact_end or end
        if complete and end <= most:
            data[:at] = room[:at]
            wrong = int((class_map.enlarged(blocks, exponent, *classes.shape) != classes).sum()) if exponent else 0
            return _CodedMap(state, exponent, wrong, exact_end - end, end)
    return None


def _code_prediction(canvas: Array, reference: Optional[Array], plan: layout.Layout, offset: int, data: UInt8Array,
                     beginning: _CodedMap, budget: int) -> Tuple[_CodedMap, Optional[Predicted], float]:
    """Code how a reference predicts the image, behind the map of classes; None: it does not pay. And about what it
    saves [bit].

    :param reference: its pixels
    """
    if reference is None:
        return beginning, None, 0.0
    other = coefficients.analyse(reference, plan, offset)
    chosen, predicted, saved = prediction.choose(canvas, other, plan, 8.0 * len(data))
    room = data.copy()
    complete, state = prediction.code_prediction(True, chosen, plan, room, beginning.state)
    at = state[2]
    end = at + range_coder.AHEAD
    size = end - beginning.end
    if not complete or end > budget or size > PREDICTION_PART * budget or 8 * size * WORTH > saved:
        return beginning, None, 0.0
    data[:at] = room[:at]
    return beginning._replace(state=state, end=end), Predicted(reference, chosen, predicted), saved


def encode(pixels: Array, lossless: bool, budget: int, classes: Optional[UInt8Array] = None,
           reference: Optional[Array] = None) -> LayeredStream:
    """An image's stream, of `budget` bytes at most; the head is always there.

    :param pixels: (height, width) uint8 or uint16, or (height, width, 3) uint8: B, G, R
    :param lossless: the whole stream is exact (5/3); else shorter streams are better (9/7)
    :param classes: (height, width) uint8: coded before anything else; coarsely where that takes more than MAP_PART of a
        budget which does not hold the whole stream with them
    :param reference: of the pixels' shape and dtype: an image that is like it here and there; decode needs the very
        same
    :raises ValueError: reference has another shape or dtype than pixels
    """
    if reference is not None and (reference.shape, reference.dtype) != (pixels.shape, pixels.dtype):
        raise ValueError('a reference of %s %s for %s %s' % (reference.shape, reference.dtype, pixels.shape,
                                                             pixels.dtype))
    most = max(int(MAP_PART * budget), _HEAD.size + LEAST_MAP)
    stream = _encode(pixels, lossless, budget, classes, min(most, budget), reference)
    if stream.missing and len(stream.data) + stream.missing <= budget:
        return _encode(pixels, lossless, budget, classes, budget, reference)
    return stream


def _begun(classes: Optional[UInt8Array], data: UInt8Array, most: int) -> Tuple[_CodedMap, int]:
    """The map, coded where there is one, and its flags."""
    beginning = _CodedMap(range_coder.begin(True, data, _HEAD.size), 0, 0, 0, _HEAD.size)
    if classes is None:
        return beginning, 0
    coded = _code_map(np.require(classes, np.uint8, ['C', 'A', 'W']), data, most)
    if coded is None:
        return beginning._replace(wrong=int(np.count_nonzero(classes)), missing=classes.size // 4), 0
    return coded, _CLASSES | coded.exponent << _EXPONENT


def _encode(pixels: Array, lossless: bool, budget: int, classes: Optional[UInt8Array], most: int,
            reference: Optional[Array]) -> LayeredStream:
    """As `encode`, with a map of classes that ends before the byte `most`."""
    height, width = pixels.shape[:2]
    channels = 1 if pixels.ndim == 2 else 3
    plan = layout.layout_of(height, width, channels, lossless)
    room = min(budget, layout.most_bytes(pixels.size, pixels.itemsize))
    data = np.zeros(room + 64, np.uint8)
    offset = int(pixels[::4, ::4].mean())
    canvas = coefficients.analyse(pixels, plan, offset)
    beginning, flags = _begun(classes, data, most)
    flags |= lossless * _LOSSLESS | (channels == 3) * _COLOUR | (pixels.itemsize == 2) * _WIDE
    beginning, predicted, saved = _code_prediction(canvas, reference, plan, offset, data, beginning, budget)
    flags |= 0 if predicted is None else _REFERENCE
    tops, energies = coefficients.quantise(canvas, plan, None if predicted is None else predicted.canvas)
    work = _new_work(plan, data[:room + 4], canvas, predicted is not None)
    work.coding.counts[:, passes.TOP], planes, error = tops, int(tops.max()), work.coding.error
    error[0] = float((plan.weights ** 2 * energies).sum())
    ends, errors = np.zeros(2000, np.int64), np.zeros(2000)
    ends[0], errors[0] = beginning.end, error[0]
    points, complete, logged, state = passes.code_planes(
        True, work, plan, planes, _part(height, width), passes.Points(ends, errors), beginning.state)
    end = range_coder.finish(data, state)
    if complete:    # as a truncation point
        end = state[2] + range_coder.AHEAD
    end = max(min(end, budget), int(ends[0]))
    points = min(points, int(np.searchsorted(ends[:points], end)))
    ends[points], errors[points] = end, max(error[0], 0.0)
    head = _HEAD.pack(flags, height, width, offset, planes, end)
    data[:len(head)] = np.frombuffer(head, np.uint8)
    cells = height * width * channels
    return LayeredStream(data[:end].tobytes(), ends[:points + 1].copy(),
                         _after_rounding(errors[:points + 1], cells, lossless) + WRONG_CLASS * beginning.wrong, cells,
                         prefixes_of(plan, work, logged, offset, pixels.itemsize, beginning.end, end, predicted),
                         beginning.missing, saved / (saved + 8 * end))


def _checked_head(data: bytes, height: int, width: int, channels: int, itemsize: int
                  ) -> Optional[Tuple[int, int, int, int]]:
    """Flags, offset, planes and the stream's length; None: too little, or another image's."""
    if len(data) < _HEAD.size or not _may_be(height, width, channels, itemsize):
        return None
    flags, its_height, its_width, offset, planes, length = _HEAD.unpack_from(data)
    same = (its_height, its_width, 3 if flags & _COLOUR else 1, 2 if flags & _WIDE else 1) == (
        height, width, channels, itemsize)
    impossible = flags >> _EXPONENT & 7 and not flags & _CLASSES
    if not same or impossible or planes > layout.MAX_PLANES - (0 if flags & _WIDE else 8):
        return None
    return flags, offset, planes, min(length, layout.most_bytes(height * width * channels, itemsize))


def _may_be(height: int, width: int, channels: int, itemsize: int) -> bool:
    return (0 < height <= MAX_SIDE and 0 < width <= MAX_SIDE
            and (channels, itemsize) in ((1, 1), (1, 2), (3, 1)) and height * width * channels <= layout.MAX_CELLS)


def _dtype_of(itemsize: int) -> DType:
    found: DType = np.dtype(np.uint8 if itemsize == 1 else np.uint16)
    return found


def decode(data: bytes, height: int, width: int, channels: int, itemsize: int, reference: Optional[Array] = None
           ) -> Optional[Decoded]:
    """The image of a stream or of its beginning; None: of too little, or of none of this shape.

    :param reference: what the stream was encoded with. Where it is missing or of another shape or dtype although the
        stream needs it, there is no image; a stream that needs none ignores it
    """
    found = read(data, height, width, channels, itemsize, reference)
    return None if found is None else Decoded(found.prefixes.all_pixels(), found.classes)


def read(data: bytes, height: int, width: int, channels: int, itemsize: int, reference: Optional[Array] = None
         ) -> Optional[Read]:
    """As decode, but for the pixels."""
    head = _checked_head(data, height, width, channels, itemsize)
    if head is None:
        return None
    flags, offset, planes, length = head
    used = reference if flags & _REFERENCE else None
    shape = (height, width) if channels == 1 else (height, width, channels)
    if flags & _REFERENCE and (used is None or (used.shape, used.dtype) != (shape, _dtype_of(itemsize))):
        return None
    plan = layout.layout_of(height, width, channels, bool(flags & _LOSSLESS))
    stream = np.frombuffer(data, np.uint8)[:length].copy()
    state = range_coder.begin(False, stream, _HEAD.size)
    classes, predicted = None, None
    if flags & _CLASSES:
        exponent = flags >> _EXPONENT & 7
        blocks = np.zeros(class_map.reduced_size(height, width, exponent), np.uint8)
        complete, state = class_map.code_classes(False, blocks, stream, state)
        if not complete:
            return None
        classes = class_map.enlarged(blocks, exponent, height, width)
    if used is not None:
        chosen = prediction.nothing(plan)
        complete, state = prediction.code_prediction(False, chosen, plan, stream, state)
        if not complete:
            return None
        other = coefficients.analyse(used, plan, offset)
        predicted = Predicted(used, chosen, prediction.predicted(other, plan, chosen))
    begun = state[2] if flags & (_CLASSES | _REFERENCE) else _HEAD.size
    work = _new_work(plan, stream, np.zeros(0, np.int32), predicted is not None)
    no_points = passes.Points(np.zeros(1, np.int64), np.zeros(1))
    _, _, logged, _ = passes.code_planes(False, work, plan, planes, _part(height, width), no_points, state)
    return Read(prefixes_of(plan, work, logged, offset, itemsize, begun, length, predicted), classes)
