# SPDX-License-Identifier: BSD-3-Clause
"""The messages of a batch of datagrams as records, those of one layout at a time."""
from typing import Any, Dict, List, Tuple

import numpy as np

from ..arrays import BoolArray, IntArray, Records, UInt8Array
from .datagram import OVERHEAD
from .records import DType, LayoutError, lengths_of, record_dtype, same_layout

MAX_LAYOUTS = 256
"""Layouts remembered; a topic whose messages keep changing in length must not fill the memory."""


class BatchReader:
    """Views datagrams of one message type as structured arrays, and remembers the layouts for the next batch."""

    def __init__(self, message_class: Any) -> None:
        self._message_class = message_class
        self._layouts: Dict[int, DType] = {}   # {datagram length: dtype last seen with it}

    def __len__(self) -> int:
        """The number of layouts remembered."""
        return len(self._layouts)

    def read(self, datagrams: UInt8Array, lengths: IntArray,
             rows: BoolArray) -> Tuple[List[Tuple[Records, BoolArray]], int]:
        """View a batch as records.

        :param datagrams: (n, slot) uint8, each row a message behind OVERHEAD bytes
        :param lengths: (n,) int, the datagrams' lengths [byte]
        :param rows: (n,) bool, the rows to read
        :return: ([(records, mask), ...], the number of rows that are not a message of the type). records is the whole
            batch seen through one layout, (n,) structured; mask is (n,) bool, the rows that have this layout
        """
        left, views, bad = rows.copy(), [], 0
        while left.any():
            first = int(left.argmax())
            try:
                records, mask = self._view(datagrams, lengths, left, first)
            except LayoutError:
                bad += 1
                left[first] = False
            else:
                views.append((records, mask))
                left ^= mask
        return views, bad

    def _view(self, datagrams: UInt8Array, lengths: IntArray, left: BoolArray,
              first: int) -> Tuple[Records, BoolArray]:
        """The batch through the layout of row `first`, and the rows of `left` that have it."""
        length = int(lengths[first])
        if length in self._layouts:
            records, mask = self._view_as(self._layouts[length], datagrams, left & (lengths == length))
            if mask[first]:
                return records, mask
        dtype = record_dtype(self._message_class,
                             lengths_of(self._message_class, datagrams[first, OVERHEAD:length].tobytes()))
        if len(self._layouts) >= MAX_LAYOUTS:
            self._layouts.clear()
        self._layouts[length] = dtype
        return self._view_as(dtype, datagrams, left & (lengths == length))

    def _view_as(self, dtype: DType, datagrams: UInt8Array, rows: BoolArray) -> Tuple[Records, BoolArray]:
        records: Records = np.ndarray((len(datagrams),), dtype, datagrams, OVERHEAD, (datagrams.shape[1],))
        return records, rows & same_layout(records, self._message_class)
