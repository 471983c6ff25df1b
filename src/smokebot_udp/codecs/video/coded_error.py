# SPDX-License-Identifier: BSD-3-Clause
"""How far the images of an encoder are from their originals: decoded as an operator who loses nothing decodes them.

The quantiser does not say it: at the same one the error of a smooth scene is a tenth of that of a rough one. Importing
this module loads PyAV, or fails where it is missing.
"""
from typing import Optional

import cv2
import numpy as np

from ...arrays import UInt8Array
from .decoder import Decoder, Picture
from .decoder_pixels import COLOUR
from .decoder_request import Request
from .encoder import EncodedImage
from .planes import GREY, even, from_planes


class CodedError:
    """Follows the images of one encoder, all of them, in their order.

    :param height: [pixel]
    :param width: [pixel]
    :param colour: whether they are bgr8; otherwise mono8
    """

    def __init__(self, height: int, width: int, colour: bool) -> None:
        self._decoder, self._height, self._width, self._colour = Decoder(), height, width, colour

    def mean_square(self, coded: EncodedImage, pixels: UInt8Array) -> Optional[float]:
        """The mean squared error of the next image, over all channels [count^2]; None: libavcodec does not decode it.

        :param pixels: of its original, (height, width) or (height, width, 3) uint8
        """
        try:
            picture = self._decoder.decode(Request(0, self._height, self._width, self._colour, coded.parameter_sets,
                                                   coded.slices))
        except ValueError:
            return None
        if picture is None:
            return None
        shown = from_planes(_planes(picture), self._height, self._width, COLOUR if self._colour else GREY)
        return float(cv2.norm(np.ascontiguousarray(shown), pixels, cv2.NORM_L2SQR) / pixels.size)


def _planes(picture: Picture) -> UInt8Array:
    """(rows, even width) uint8: see planes.to_planes."""
    height, width = even(picture.height), even(picture.width)
    parts = []
    for index, (plane, line) in enumerate(zip(picture.planes, picture.lines)):
        half = 1 if index == 0 else 2
        lines = np.frombuffer(plane, np.uint8)[:height // half * line].reshape(height // half, line)
        parts.append(lines[:, :width // half].ravel())
    planes: UInt8Array = np.concatenate(parts).reshape(-1, width)
    return planes
