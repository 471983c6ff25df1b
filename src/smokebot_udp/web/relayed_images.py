# SPDX-License-Identifier: BSD-3-Clause
"""Images that cross as relays: they have no view, so they get their colours here."""
import math
from typing import Any

from ..codecs.display.colouring import Colouring
from ..codecs.display.view import Limits, judged
from ..codecs.wire import compressed
from ..codecs.wire.pixels import image_pixels
from .pictures import MAX_PIXELS, Picture


class RelayedColours:
    """Makes pictures of sensor_msgs/Image and CompressedImage."""

    def __init__(self) -> None:
        self._colouring, self._limits = Colouring(), Limits()

    def picture(self, message: Any, came: float, now: float) -> Picture:
        """The picture of a message.

        :param came: by a steady clock [s]
        :param now: by the robot's clock [s]
        :raises ValueError: it cannot be shown
        """
        if hasattr(message, 'format'):
            decoded = compressed.decode(message.data, message.format)
            pixels, encoding = decoded.pixels, decoded.encoding
        else:
            if message.height * message.width > MAX_PIXELS:
                raise ValueError('an image of %d x %d pixels' % (message.width, message.height))
            pixels, encoding = image_pixels(message), message.encoding
        coloured = self._colouring(pixels, encoding, came)
        stamp = message.header.stamp.to_sec()
        age = now - stamp if stamp else math.nan
        judgement = judged(coloured, age, 1.0, self._limits)
        height, width = coloured.pixels.shape[:2]
        fields = {
            'at_least': False, 'state': judgement.state, 'reason': 'age' if judgement.old else '', 'quality': '',
            'completeness': 1.0, 'error': None, 'old_after': self._limits.old_after,
            'frozen_after': self._limits.frozen_after, 'full_width': width, 'full_height': height, 'scale': None,
            'notice': ''}
        return Picture(coloured.pixels, stamp, came, age, fields)

