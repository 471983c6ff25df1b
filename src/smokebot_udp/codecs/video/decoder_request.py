# SPDX-License-Identifier: BSD-3-Clause
"""One image for the decoder of video: what is left of it after the loss."""
from typing import NamedTuple, Sequence

from .nal import START_CODE

MAX_SIDE = 16384
"""Of an image; x264's limit [pixel]."""

MAX_PIXELS = 1 << 22
"""Of an image."""

MAX_BYTES = 1 << 19
"""Of an image's parameter sets and slices together, start codes included."""

MAX_SESSION = 2 ** 32 - 1


class Request(NamedTuple):
    """What is known of an image. Its bytes come from the air."""
    session: int
    """Of the encoder, uint32. Another one than before: the decoder begins anew."""
    height: int
    """As it is to be shown, without what was padded [pixel]."""
    width: int
    """Likewise [pixel]."""
    colour: bool
    """Whether the pixels have three channels."""
    parameter_sets: bytes
    """With start codes, see parameter_sets.parse; empty: those of an image before are used."""
    slices: Sequence[bytes]
    """Those of its slices that are there, in order: NAL units without start codes. One at least."""

    def check(self) -> None:
        """:raises ValueError: a field is out of range, or there are no slices, or more bytes than MAX_BYTES"""
        if not 0 <= self.session <= MAX_SESSION:
            raise ValueError('session %d' % self.session)
        if not (0 < self.height <= MAX_SIDE and 0 < self.width <= MAX_SIDE) or self.height * self.width > MAX_PIXELS:
            raise ValueError('a video image of %d x %d pixels' % (self.width, self.height))
        if not self.slices:
            raise ValueError('a video image without a slice')
        size = len(self.parameter_sets) + sum(len(START_CODE) + len(unit) for unit in self.slices)
        if size > MAX_BYTES:
            raise ValueError('a video image of %d bytes' % size)
