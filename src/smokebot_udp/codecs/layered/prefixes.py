# SPDX-License-Identifier: BSD-3-Clause
"""What the prefixes of a stream show, without decoding them again.

Encoder and decoder log their passes: how many bytes a decoder has read when a pass begins, and which coefficients were
found or refined when it needs the next bytes. They find and refine them in the same order. So what a prefix says is
known from where its bytes end, on both sides alike: what was decoded before the first bytes that it has not.
"""
from typing import NamedTuple, Optional

import numpy as np

from ...arrays import Array, IntArray
from . import coefficients, prediction
from .layout import NEAR, REFINEMENT, START, Layout
from .loops import compiled
from .passes import FOUND, LOG_AT, LOG_BAND, LOG_FOUND, LOG_KIND, LOG_PLANE, OLD, PLANE, REFINED, Work

KEPT = 1 << 20
"""The canvas of what is predicted is kept if it has at most this number of cells; a larger one is computed again."""


class Predicted(NamedTuple):
    """What a stream is coded against."""
    reference: Array
    """Its pixels."""
    how: prediction.Prediction
    canvas: Optional[Array]
    """(cells,) int32: of what is predicted; None: it is not kept"""

    def copy_of_canvas(self, plan: Layout, offset: int) -> Array:
        """The canvas of what is predicted of an image with this layout and offset, to be written to."""
        if self.canvas is not None:
            return self.canvas.copy()
        return prediction.predicted(coefficients.analyse(self.reference, plan, offset), plan, self.how)


class Prefixes(NamedTuple):
    """A stream whose symbols are known."""
    plan: Layout
    offset: int
    itemsize: int
    begun: int
    """End of what comes before the passes [byte]. With fewer bytes there is no image."""
    length: int
    """Length of the stream [byte]. Bytes beyond it are ignored."""
    log: Array
    """(passes, 5) int32, see passes.Coding"""
    marks: Array
    """(m,) int32, see passes.Coding"""
    counts: Array
    """(bands, 9) int64: in the end, see passes.Coding"""
    firsts: IntArray
    """(bands + 1,) where the coefficients of each band begin in the next two"""
    places: Array
    """(f,) int32: significant coefficients, in the order in which they became so"""
    values: Array
    """(f,) int32: the values of these coefficients, see passes.Coefficients"""
    predicted: Optional[Predicted]
    """None: it has no reference"""

    def pixels(self, end: int) -> Optional[Array]:
        """The image of the first `end` bytes; None: it takes more of them."""
        end = min(end, self.length)
        if end < self.begun:
            return None
        counts = np.zeros_like(self.counts)
        count_until(self.log, self.marks, end, counts)
        return self._shown(counts)

    def all_pixels(self) -> Array:
        """The image of all symbols that are known."""
        return self._shown(self.counts)

    def _shown(self, counts: Array) -> Array:
        if self.predicted is None:
            canvas = np.zeros(self.plan.cells, np.int32)
        else:
            canvas = self.predicted.copy_of_canvas(self.plan, self.offset)
        coefficients.add_estimates(canvas, self.plan, self.firsts, self.places, self.values, counts,
                                   coefficients.guesses_of(self.plan.lossless, self.predicted is not None))
        return coefficients.synthesise(canvas, self.plan, self.offset, self.itemsize)


@compiled
def count_until(log: Array, marks: Array, end: int, counts: Array) -> None:
    """The counts of all bands when the first pair of bytes is needed that reaches beyond `end`."""
    passes = 0
    while passes < len(log) and log[passes, LOG_AT] <= end:
        passes += 1
    for i in range(passes):
        own, progress = counts[log[i, LOG_BAND]], -1
        if i == passes - 1 and end // 2 + 1 < len(marks):
            progress = marks[end // 2 + 1]
        if log[i, LOG_KIND] == NEAR:
            own[OLD], own[REFINED], own[PLANE] = own[FOUND], 0, log[i, LOG_PLANE]
        if log[i, LOG_KIND] == REFINEMENT:
            own[REFINED] = own[OLD] if progress < 0 else progress
        else:
            own[FOUND] = log[i, LOG_FOUND] if progress < 0 else progress


@compiled
def _gather(starts: Array, firsts: Array, lists: Array, result: Array) -> None:
    """What a list has of each band, one after the other."""
    for number in range(len(starts)):
        first, count = firsts[number], firsts[number + 1] - firsts[number]
        result[first:first + count] = lists[starts[number]:starts[number] + count]


def prefixes_of(plan: Layout, work: Work, logged: int, offset: int, itemsize: int, begun: int, length: int,
                predicted: Optional[Predicted]) -> Prefixes:
    """The Prefixes of a stream that was encoded or decoded.

    :param logged: length of the log
    """
    coding = work.coding
    firsts = np.concatenate([[0], np.cumsum(coding.counts[:, FOUND])])
    places, values = np.empty(firsts[-1], np.int32), np.empty(firsts[-1], np.int32)
    starts = np.ascontiguousarray(plan.bands[:, START])
    _gather(starts, firsts, work.coefficients.found, places)
    _gather(starts, firsts, work.coefficients.known, values)
    if predicted is not None and plan.cells > KEPT:
        predicted = predicted._replace(canvas=None)
    # the encoder's marks are for all the bytes that it may write
    marks = coding.marks[:length // 2 + 2].copy()
    return Prefixes(plan, offset, itemsize, begun, length, coding.log[:logged].copy(), marks, coding.counts, firsts,
                    places, values, predicted)
