# SPDX-License-Identifier: BSD-3-Clause
"""What cameras publish, as images that can be coded: compressed ones decoded, raw colours converted, cut to a region.

The work is done in the worker's thread, for the images that are sent only.
"""
from typing import Any, Mapping, NamedTuple, Tuple

import numpy as np
from sensor_msgs.msg import CompressedImage, Image

from ...arrays import Array
from ...codecs.wire import bayer, compressed, pixels
from .camera_info import Region, parse_region, whole

ACCEPTED = Image, CompressedImage
"""Classes of the source's messages."""


class SourceImage(NamedTuple):
    """An image to be coded."""
    message: Any
    """sensor_msgs/Image. A mosaic that is kept is an image of its cells, see codecs.wire.bayer."""
    region: Region
    """The part of the source's image that it shows."""
    height: int
    """Height of the source's whole image; `width` is its width."""
    width: int
    problem: str = ''
    """What contradicts the data, which decide; empty: nothing."""


def source_image(message: Any, settings: Mapping[str, Any]) -> SourceImage:
    """The image that a message of the source becomes.

    :param message: of a class of ACCEPTED
    :param settings: {name: value}, the effective ones
    :raises ValueError: saying what is wrong with the message, or that the region is outside
    """
    found, encoding, is_bigendian, problem = _pixels(message)
    height, width = found.shape[:2]
    mosaic = encoding in bayer.BAYER
    if mosaic and min(height, width) < 2:
        raise ValueError('encoding is %s, but the image is %d x %d pixels, less than one cell of 2 x 2' % (
            encoding, width, height))
    region = (parse_region(settings['region']) or whole(height, width)).within(height, width, mosaic)
    if (message._type == Image._type and encoding == message.encoding and region == whole(height, width) and not mosaic
            and not problem):
        return SourceImage(message, region, height, width)
    part = found[region.y:region.y + region.height, region.x:region.x + region.width]
    if mosaic and _is_kept(settings):
        part, encoding = bayer.to_cells(part), encoding + bayer.CELLS
    elif mosaic:
        part, encoding = bayer.debayered(part, encoding), 'bgr8'
    return SourceImage(_message(message.header, part, encoding, is_bigendian), region, height, width, problem)


def raw_image(message: Any) -> Any:
    """The whole image that a message of the source shows, as sensor_msgs/Image: decoded, YUV in colours.

    :param message: other messages than those of ACCEPTED are returned as they are
    :raises ValueError: saying what is wrong with the message
    """
    if message._type != CompressedImage._type and (
            message._type != Image._type or message.encoding not in bayer.YUV422):
        return message
    return _message(message.header, *_pixels(message)[:3])


def _pixels(message: Any) -> Tuple[Array, str, bool, str]:
    """(height, width) or (height, width, channels) array, encoding, whether it is big-endian, and the problem as of
    SourceImage. YUV is in colours.

    :raises ValueError: saying what is wrong with the message
    """
    if message._type == CompressedImage._type:
        decoded = compressed.decode(message.data, message.format)
        return decoded.pixels, decoded.encoding, False, decoded.problem
    layout = message.data, message.height, message.width, message.step, message.encoding
    found, step = pixels.as_pixels(*layout, message.is_bigendian), pixels.row_length(*layout)
    problem = '' if step == message.step else 'step is %d, by the data it is %d' % (message.step, step)
    if message.encoding not in bayer.YUV422:
        return found, message.encoding, bool(message.is_bigendian), problem
    if message.width % 2:
        raise ValueError('encoding is %s, but the width of %d pixels is odd' % (message.encoding, message.width))
    return bayer.from_yuv422(found, message.encoding), 'bgr8', False, problem


def _is_kept(settings: Mapping[str, Any]) -> bool:
    """Whether a mosaic is sent as it is: only interleaved pixels can be, in full size."""
    return settings['coding'] == 'interleaved' and settings['scale'] == 1 and not settings['debayer']


def _message(header: Any, found: Array, encoding: str, is_bigendian: bool) -> Image:
    """:param found: (height, width) or (height, width, channels) array"""
    whole_rows = np.ascontiguousarray(found)
    return Image(header=header, height=found.shape[0], width=found.shape[1], encoding=encoding,
                 is_bigendian=is_bigendian, step=whole_rows.strides[0], data=whole_rows.tobytes())
