# SPDX-License-Identifier: BSD-3-Clause
"""The last images of a stream, from which later ones are predicted: kept by both sides, which must decode them alike.

A reference is what the first layers of an image restore, exactly these and no byte more. The robot may name fewer
layers than an operator has restored, because another operator has only those. So what the bytes of each image say is
kept, and pixels are made of it on demand.
"""
import zlib
from collections import OrderedDict
from typing import TYPE_CHECKING, Dict, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ...arrays import Array
from ...codecs.layered.pieces import Layer
from .pixel_layers import CodedShape

if TYPE_CHECKING:
    from ...codecs.layered.prefixes import Prefixes  # compiled

MAX_PICTURES = 16
"""Number of images that are kept of a stream, at most. At 30 Hz a report may come half a second after the image."""

MAX_BYTES = 32 << 20
"""Size of the pixels of all kept images of one size, at most. With what their streams say, and what these were
predicted from, they take 3 times as much, and 9 times where all images are exact [byte]."""

LEAST_PICTURES = 3
"""Number of images that are kept, however large they are."""

Key = Tuple[int, int]
"""Session and number of an image."""


class Reference(NamedTuple):
    """What an image is predicted from."""
    pixels: Array
    """As image.decode returns them, before they are displaced."""
    checksum: int
    """See checksum_of."""


def checksum_of(pixels: Array) -> int:
    """CRC-32 of pixels, rows first, little-endian.

    :return: uint32
    """
    return zlib.crc32(np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('<')).data)


def ends_of(layers: Sequence[Layer], count: int) -> Tuple[int, ...]:
    """Where each layer of a stream ends [byte].

    :param count: number of datagrams
    """
    return tuple(np.cumsum([layer.length(count) for layer in layers]).tolist())


def with_motion(motion: bytes, stream: bytes) -> bytes:
    """The stream of a predicted image: its motion is in front, so that it is protected best.

    :param motion: at most 255 bytes
    """
    return bytes([len(motion)]) + motion + stream


def split_motion(stream: bytes) -> Optional[Tuple[bytes, bytes]]:
    """(motion, the rest) of the stream of a predicted image, or of its beginning; None: of too little."""
    if not stream or len(stream) <= stream[0]:
        return None
    return stream[1:1 + stream[0]], stream[1 + stream[0]:]


class CodedImage:
    """An image, as far as its stream is known.

    :param prefixes: of the stream without its motion
    :param ends: where each known layer ends in it; 0 or less: it has nothing of it [byte]
    """

    def __init__(self, shape: CodedShape, prefixes: 'Prefixes', ends: Sequence[int]) -> None:
        self.shape, self.layers = shape, len(ends)
        self._prefixes, self._ends = prefixes, tuple(ends)
        self._decoded: Optional[Tuple[int, Reference]] = None   # the last one: layers, and what they restore

    def reference(self, layers: int) -> Optional[Reference]:
        """What the first layers restore; None: they are not known, or restore nothing."""
        if not 0 < layers <= self.layers:
            return None
        if self._decoded is None or self._decoded[0] != layers:
            pixels = self._prefixes.pixels(self._ends[layers - 1])
            if pixels is None:
                return None
            self._decoded = layers, Reference(pixels, checksum_of(pixels))
        return self._decoded[1]


class References:
    """The last images, the newest MAX_PICTURES of them or MAX_BYTES."""

    def __init__(self) -> None:
        self._images: OrderedDict[Key, CodedImage] = OrderedDict()

    def add(self, key: Key, image: CodedImage) -> None:
        """Keep an image, in place of the oldest ones where there are too many."""
        self._images[key] = image
        self._images.move_to_end(key)
        size = image.shape.cells * image.shape.itemsize
        while len(self._images) > max(LEAST_PICTURES, min(MAX_PICTURES, MAX_BYTES // size)):
            self._images.popitem(last=False)

    def get(self, key: Key, layers: int, shape: CodedShape) -> Optional[Reference]:
        """What the first layers of an image restore; None: they are not kept, or the image has another shape."""
        image = self._images.get(key)
        return None if image is None or image.shape != shape else image.reference(layers)

    def layers(self, session: int) -> Dict[int, int]:
        """{number: known layers} of the images of a session."""
        return {number: image.layers for (its_session, number), image in self._images.items()
                if its_session == session}

    def forget_before(self, key: Key) -> None:
        """Forget the images of a session before one of them."""
        session, first = key
        for one in [one for one in self._images if one[0] == session and one[1] < first]:
            del self._images[one]

    def clear(self) -> None:
        """Forget all."""
        self._images.clear()
