# SPDX-License-Identifier: BSD-3-Clause
"""The value at a place of an image, such as a temperature."""
import math
from typing import Any, Dict, Mapping

from ..codecs.display.colouring import SCALED
from ..codecs.wire.pixels import image_pixels


def value_at(message: Any, x: float, y: float, scale: Mapping[str, Any]) -> Dict[str, Any]:
    """The fields value, unit, text, stamp: as in doc/web_protocol.md.

    :param message: sensor_msgs/Image
    :param x, y: from its left and upper edge, 0..1
    :param scale: counts_per_unit, zero, unit; empty: unknown
    :raises ValueError: the image contradicts itself
    """
    pixels = image_pixels(message)
    height, width = pixels.shape[:2]
    row, column = min(int(y * height), height - 1), min(int(x * width), width - 1)
    stamp, pixel = message.header.stamp.to_sec(), pixels[row, column]
    if pixels.ndim > 2:
        return {'value': None, 'unit': '', 'text': '%s (%s)' % (
            ', '.join(str(one) for one in pixel.tolist()), message.encoding), 'stamp': stamp}
    if message.encoding not in SCALED:
        return {'value': float(pixel), 'unit': '', 'text': '%d' % pixel, 'stamp': stamp}
    if not math.isfinite(pixel) or (message.encoding != '32FC1' and not pixel):
        return {'value': None, 'unit': '', 'text': 'no reading', 'stamp': stamp}
    unit = scale.get('unit', 'counts')
    value = float(pixel) / scale.get('counts_per_unit', 1.0) + scale.get('zero', 0.0)
    return {'value': round(value, 4), 'unit': unit, 'text': '%.4g %s' % (value, unit), 'stamp': stamp}
