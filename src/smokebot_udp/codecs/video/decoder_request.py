# SPDX-License-Identifier: BSD-3-Clause
"""One image for the decoder of video: what is left of it after the loss."""
from typing import NamedTuple, Sequence

from .nal import START_CODE

MAX_SIDE = 16384
"""Maximum side of an image, as in x264 [pixel]."""

MAX_PIXELS = 1 << 22
"""Maximum number of pixels of an image."""

MAX_BYTES = 1 << 19
"""Maximum size of an image's parameter sets and slices together, start codes included [byte]."""

MAX_SESSION = 2 ** 32 - 1


class Request(NamedTuple):
    """What is known of an image. Its bytes come from the air."""
    session: int
    """Session of the encoder, uint32. If it is another one than before, the decoder begins anew."""
    height: int
    """Height of the image as it is to be shown, without padding [pixel]."""
    width: int
    """Width of the image as it is to be shown, without padding [pixel]."""
    colour: bool
    """Whether the pixels have three channels."""
    parameter_sets: bytes
    """Parameter sets with start codes, see parameter_sets.parse. If they are empty, those of an earlier image are
    used."""
    slices: Sequence[bytes]
    """Slices of the image that are there, in order: NAL units without start codes. There is at least one."""

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
