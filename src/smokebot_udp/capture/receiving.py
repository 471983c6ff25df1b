# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of one transfer: joins the pieces, in whatever order and however often they come."""
from typing import Optional

import numpy as np

from ..arrays import BoolArray
from .sending import MAX_PIECES, MAX_SIZE, Piece

MAX_BEGINNINGS = 8
"""How often the robot may send another original than before, as after a restart of its node."""


class Receiving:
    """Joins the pieces of one transfer, which come from the network."""

    def __init__(self) -> None:
        self.order = 0
        """Highest order that was received."""
        self.dropped = 0
        """Number of impossible pieces."""
        self.size = self.held = 0
        """Size of the whole transfer, 0: unknown; and size of what was received of it [byte]."""
        self._length = self._begun = 0
        self._data = bytearray()
        self._came: BoolArray = np.zeros(0, bool)

    def take(self, piece: Piece) -> None:
        """Take a piece; an impossible one is counted."""
        another = (piece.size, piece.length) != (self.size, self._length)
        if not self._possible(piece) or (another and self._begun >= MAX_BEGINNINGS):
            self.dropped += 1
            return
        if another:
            self._begin(piece)
        self.order = max(self.order, piece.order)
        if self._came[piece.number]:
            return
        start = piece.number * piece.length
        self._data[start:start + len(piece.data)] = piece.data
        self._came[piece.number] = True
        self.held += len(piece.data)

    @property
    def received(self) -> bytes:
        """As in CaptureRequest."""
        return np.packbits(self._came, bitorder='little').tobytes()

    @property
    def whole(self) -> Optional[bytes]:
        """All of it; None: pieces lack."""
        return bytes(self._data) if self.size and self.held == self.size else None

    @staticmethod
    def _possible(piece: Piece) -> bool:
        if not (0 < piece.size <= MAX_SIZE and piece.length and piece.order):
            return False
        count = -(-piece.size // piece.length)
        expected = min(piece.length, piece.size - piece.number * piece.length)
        return piece.number < count <= MAX_PIECES and len(piece.data) == expected

    def _begin(self, piece: Piece) -> None:
        """The first piece; or the robot's node was started again, and sends another original."""
        self._begun += 1
        self.size, self._length, self.held, self.order = piece.size, piece.length, 0, 0
        self._data = bytearray(piece.size)
        self._came = np.zeros(-(-piece.size // piece.length), bool)
