# SPDX-License-Identifier: BSD-3-Clause
"""A video image as it is received, see msg/VideoSlice.msg: its slices, and pieces that replace lost ones."""
from types import SimpleNamespace
from typing import Any, Dict, List, Optional

import numpy as np

from ...arrays import BoolArray, IntArray, UInt8Array
from ...codecs.video.protection import restore
from .pixel_layers import WITHOUT_ALPHA, CodedShape, cannot_be_layered, coded_shape
from .size_guard import SizeGuard

INTRA = 1
"""In `flags`: the image is not predicted from others."""

MAX_REFRESH = 120
"""Images until all parts of an image were coded anew: 4 s at 30 Hz."""

MAX_PARAMETER_SETS = 256
"""[byte]"""

ENCODINGS = 'mono8', '8UC1', 'bgr8', 'rgb8', '8UC3'
"""Encodings that can be sent as video."""


def cannot_be_video(message: Any, scale: int) -> Optional[str]:
    """Why an Image cannot be sent as video; None: it can.

    :param scale: by which it is reduced
    """
    encoding = WITHOUT_ALPHA.get(message.encoding, message.encoding)
    if encoding not in ENCODINGS:
        return 'encoding is %r, which cannot be video; %s can' % (
            message.encoding, ', '.join((*ENCODINGS, *WITHOUT_ALPHA)))
    return cannot_be_layered(message, scale, 0.0)


class VideoImage:
    """The datagrams of one image, as far as they were received.

    :param head: stamp, frame_id and the fields that its datagrams repeat, see segments.head_of
    :param guard: of the stream
    :param now: by the guard's clock [s]
    :raises ValueError: the head contradicts itself, or exceeds a limit
    """

    def __init__(self, head: SimpleNamespace, guard: SizeGuard, now: float) -> None:
        if head.encoding not in ENCODINGS:
            raise ValueError('encoding is %r, must be one of %s' % (head.encoding, ', '.join(ENCODINGS)))
        self.shape: CodedShape = coded_shape(head.height, head.width, head.encoding, 0.0)
        if not 1 <= head.sources <= head.count:
            raise ValueError('%d slices in %d datagrams' % (head.sources, head.count))
        if not 1 <= head.refresh <= MAX_REFRESH:
            raise ValueError('refresh is %d, must be from 1 to %d' % (head.refresh, MAX_REFRESH))
        if head.flags & ~INTRA:
            raise ValueError('flags are %d' % head.flags)
        # after all others, so that only what is possible in itself counts as announced
        guard.check(self.shape.cells, now)
        self._sources, self._count = head.sources, head.count
        self._pieces: Dict[int, bytes] = {}
        self.parameter_sets = b''
        """As received last; empty: none were."""

    @property
    def complete(self) -> bool:
        """Whether all slices can be restored; further datagrams bring nothing."""
        return len(self._pieces) >= int(self._sources)

    @property
    def completeness(self) -> float:
        """Share of the slices that can be restored, 0..1."""
        return 1.0 if self.complete else sum(index < self._sources for index in self._pieces) / self._sources

    @property
    def awaited(self) -> int:
        """The index of the missing datagram that matters last: a slice, or one without which the slices cannot be
        restored. Not to be asked of a complete image."""
        missing = [index for index in range(self._count) if index not in self._pieces]
        slices = [index for index in missing if index < self._sources]
        needed = int(self._sources) - len(self._pieces)
        return max([missing[-needed], *slices[-1:]])

    def places(self, numbers: IntArray) -> IntArray:
        """(m,) int: the places of datagrams in the order in which they are sent; -1: there is none such."""
        places: IntArray = np.where(numbers < self._count, numbers, -1)
        return places

    def add(self, indexes: IntArray, parameter_sets: UInt8Array, data: UInt8Array) -> BoolArray:
        """Add datagrams.

        :param indexes: (m,) int
        :param parameter_sets: (m, j) uint8
        :param data: (m, k) uint8
        :return: (m,) bool, those that fit the image, copies included; the others were dropped
        """
        fit: BoolArray = indexes < self._count
        if not data.shape[1] or parameter_sets.shape[1] > MAX_PARAMETER_SETS:
            fit[:] = False
        for row in np.flatnonzero(fit).tolist():
            self._pieces.setdefault(int(indexes[row]), data[row].tobytes())
            self.parameter_sets = parameter_sets[row].tobytes() or self.parameter_sets
        return fit

    def slices(self) -> List[bytes]:
        """The slices that can be restored, in their order.

        Where the pieces contradict each other, one of them is forged: then those that came.
        """
        try:
            restored = restore(self._pieces, self._sources)
        except ValueError:
            restored = {index: piece for index, piece in self._pieces.items() if index < self._sources}
        return [restored[index] for index in sorted(restored)]
