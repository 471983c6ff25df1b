# SPDX-License-Identifier: BSD-3-Clause
"""Images as PNG."""
import cv2
import numpy as np

from ..arrays import UInt8Array

COMPRESSION = 6
"""Level of zlib, 0..9."""


def encoded(pixels: UInt8Array) -> bytes:
    """An image as PNG.

    :param pixels: (height, width) grey, (height, width, 3) bgr or (height, width, 4) bgra
    :raises ValueError: it cannot be encoded
    """
    done, data = cv2.imencode('.png', np.ascontiguousarray(pixels), [cv2.IMWRITE_PNG_COMPRESSION, COMPRESSION])
    if not done:
        raise ValueError('an image of %s cannot be encoded' % (pixels.shape,))
    return data.tobytes()
