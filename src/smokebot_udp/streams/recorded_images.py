# SPDX-License-Identifier: BSD-3-Clause
"""What the black box records of images: raw ones losslessly compressed, at a rate, compressed ones as they are."""
import collections
import math
from typing import Any, Counter, Deque, Optional, Tuple

from sensor_msgs.msg import CompressedImage, Image

from ..codecs.wire.compressed import LOSSLESS, lossless
from ..codecs.wire.pixels import as_pixels

MOST_WAITING = 64 << 20
"""Images that wait for being compressed take this at most: 2 s of a camera of 1280 x 720 at 12 Hz [byte]."""

HURRY = MOST_WAITING // 4
"""Where more waits, images are recorded raw [byte]."""

RAW_RATE = 10e6
"""Maximum rate of images that are recorded raw: an SD card writes it [byte/s]."""


NEARLY = 0.8
"""An image this part of a period after the last one is recorded even in the same period. A source whose rate is the
highest one, and whose stamps jitter, is thus recorded as a whole."""


class Thinning:
    """Limits the rate of the images of a topic by their stamps, so that both sides record the same ones: the first of
    each period.

    :param rate: at most [Hz]; 0: all
    """

    def __init__(self, rate: float) -> None:
        self._rate, self._last = rate, -1.0

    def takes(self, stamp: float) -> bool:
        """Whether the image with this stamp [s], a later one than before, is recorded."""
        if not self._rate:
            return True
        at = self._rate * stamp     # in periods
        if math.floor(at) == math.floor(self._last) and abs(at - self._last) < NEARLY:
            return False
        self._last = at
        return True


class RawRate:
    """Limits what is recorded raw."""

    def __init__(self) -> None:
        self._next = 0.0

    def take(self, size: int, now: float) -> bool:
        """Whether an image of this size [byte] may be recorded raw now, by a steady clock [s]; it counts then."""
        if now < self._next:
            return False
        self._next = now + size / RAW_RATE
        return True


class Backlog:
    """Messages that wait, of bounded size: where they are too many the oldest one is left out.

    :param most: size of all of them [byte]
    """

    def __init__(self, most: int = MOST_WAITING) -> None:
        self._most, self._size = most, 0
        self._waiting: Deque[Tuple[str, Any, int]] = collections.deque()
        self.left_out: Counter[str] = collections.Counter()
        """{name: messages}"""

    def add(self, name: str, message: Any, size: int) -> None:
        """:param size: of the message [byte]"""
        self._waiting.append((name, message, size))
        self._size += size
        while self._size > self._most and len(self._waiting) > 1:
            oldest, _, length = self._waiting.popleft()
            self._size -= length
            self.left_out[oldest] += 1

    @property
    def hurries(self) -> bool:
        """Whether so much waits that it cannot all be compressed."""
        return self._size > HURRY

    def take(self) -> Optional[Tuple[str, Any]]:
        """(name, message) that has waited longest; None: there is none."""
        if not self._waiting:
            return None
        name, message, size = self._waiting.popleft()
        self._size -= size
        return name, message


def recorded(message: Any) -> Any:
    """The message to be recorded of one of a camera's: a CompressedImage, or an Image whose encoding PNG has not.

    :param message: sensor_msgs/Image or CompressedImage
    """
    if message._type != Image._type or message.encoding not in LOSSLESS:
        return message
    try:
        pixels = as_pixels(message.data, message.height, message.width, message.step, message.encoding,
                           message.is_bigendian)
    except ValueError:      # it contradicts itself, which is worth being recorded
        return message
    if not pixels.size:
        return message
    kind, data = lossless(pixels, message.encoding)
    return CompressedImage(header=message.header, format=kind, data=data)
