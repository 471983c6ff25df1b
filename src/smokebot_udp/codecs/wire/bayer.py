# SPDX-License-Identifier: BSD-3-Clause
"""Bayer mosaics and YUV 4:2:2: raw images of colour cameras (sensor_msgs/image_encodings).

A mosaic is sent as an image of cells of 2 x 2 pixels, which has four channels, one for each place in the cell: so
missing pixels are only filled from those of their own colour.
"""
import cv2
import numpy as np

from ...arrays import Array, UInt8Array

PATTERNS = {'bayer_rggb8': cv2.COLOR_BayerBG2BGR, 'bayer_bggr8': cv2.COLOR_BayerRG2BGR,
            'bayer_gbrg8': cv2.COLOR_BayerGR2BGR, 'bayer_grbg8': cv2.COLOR_BayerGB2BGR}
"""{encoding: OpenCV's conversion}: OpenCV names a pattern by its second row's second and third pixel."""
DEEP = {name[:-1] + '16': conversion for name, conversion in PATTERNS.items()}
"""Likewise, of 16 bits."""
BAYER = {**PATTERNS, **DEEP}

YUV422 = {'yuv422': cv2.COLOR_YUV2BGR_UYVY, 'yuv422_yuy2': cv2.COLOR_YUV2BGR_YUY2}
"""{encoding: OpenCV's conversion}: U Y V Y, and Y U Y V."""

CELLS = '/cells'
"""After a mosaic's encoding: the image is one of its cells."""


def to_cells(mosaic: Array) -> Array:
    """The cells of a mosaic.

    :param mosaic: (2 h, 2 w) array
    :return: (h, w, 4) array, C-contiguous: the upper two pixels of each cell, then the lower two
    """
    height, width = mosaic.shape
    cells = mosaic.reshape(height // 2, 2, width // 2, 2).swapaxes(1, 2)
    return np.ascontiguousarray(cells).reshape(height // 2, width // 2, 4)


def from_cells(cells: Array) -> Array:
    """The mosaic of its cells.

    :param cells: (h, w, 4) array
    :return: (2 h, 2 w) array, C-contiguous
    """
    height, width = cells.shape[:2]
    pairs = cells.reshape(height, width, 2, 2).swapaxes(1, 2)
    return np.ascontiguousarray(pairs).reshape(2 * height, 2 * width)


def debayered(mosaic: Array, encoding: str) -> UInt8Array:
    """The colours of a mosaic. Of 16 bits the upper eight are kept.

    :param mosaic: (height, width) array of uint8 or uint16, in any byte order, at least 2 x 2
    :param encoding: one of BAYER
    :return: (height, width, 3) uint8, blue, green, red
    """
    eight = np.ascontiguousarray(mosaic) if encoding in PATTERNS else (mosaic >> 8).astype(np.uint8)
    colours: UInt8Array = cv2.cvtColor(eight, BAYER[encoding])
    return colours


def from_yuv422(pixels: UInt8Array, encoding: str) -> UInt8Array:
    """The colours of YUV 4:2:2.

    :param pixels: (height, width, 2) uint8, width even
    :param encoding: one of YUV422
    :return: (height, width, 3) uint8, blue, green, red
    """
    colours: UInt8Array = cv2.cvtColor(np.ascontiguousarray(pixels), YUV422[encoding])
    return colours
