# SPDX-License-Identifier: BSD-3-Clause
"""Images as image_transport's plugins compress them: sensor_msgs/CompressedImage to pixels and back.

`format` names the encoding of the original image, then the compression (compressed_image_transport,
compressed_depth_image_transport). A driver may as well write only the compression:

    jpeg                                  mono8, or bgr8
    rgb8; jpeg compressed bgr8            a colour image that was converted to bgr8 before
    mono16; png compressed                16 bits are kept
    16UC1; compressedDepth png            12 bytes of configuration, then a PNG

A few bytes may announce millions of pixels, and OpenCV fills what a truncated JPEG lacks with grey. So the header is
read first, and an image without its end is refused.
"""
import struct
from typing import NamedTuple, Tuple

import cv2
import numpy as np

from ...arrays import Array, Buffer, UInt8Array
from .interleave import MAX_SIDE
from .pixels import pixel_type

MAX_PIXELS = 1 << 24
"""Larger images are not decoded: MAX_SIDE x MAX_SIDE."""

PNG, PNG_END = b'\x89PNG\r\n\x1a\n', b'IEND\xaeB`\x82'
JPEG, JPEG_END = b'\xff\xd8', b'\xff\xd9'
START_OF_SCAN = 0xda
START_OF_FRAME = set(range(0xc0, 0xd0)) - {0xc4, 0xc8, 0xcc}
"""Markers of a JPEG that are followed by its size (ITU-T T.81, table B.1)."""
BARE = {0x01, *range(0xd0, 0xd9)}
"""Markers that nothing follows."""

DEPTH_FORMAT = 'compressedDepth'
DEPTH = struct.Struct('<iff')
"""Configuration before a compressed depth image: format, and the quantisation's parameters a and b."""

NAMES = {('uint8', 1): ('mono8', '8UC1'), ('uint16', 1): ('mono16', '16UC1'), ('uint8', 3): ('bgr8', '8UC3'),
         ('uint8', 4): ('bgra8', '8UC4')}
"""{(dtype, channels): names of the encoding, the first of them if the format names none of them}"""
SWAPPED = {'bgr8': 'rgb8', 'bgra8': 'rgba8'}
BAYER = 'bayer_'

JPEG_ENCODINGS = {'mono8': None, '8UC1': None, 'bgr8': None, '8UC3': None, 'rgb8': cv2.COLOR_RGB2BGR,
                  'bgra8': cv2.COLOR_BGRA2BGR, '8UC4': cv2.COLOR_BGRA2BGR, 'rgba8': cv2.COLOR_RGBA2BGR}
"""{encoding that becomes a JPEG: OpenCV's conversion before, None: none}"""
PNG_ENCODINGS = 'mono16', '16UC1'
PNG_OPTIONS = cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY
"""Each pixel less the one at its left, and no search for repetitions: noise has none. Without a level OpenCV tries no
other filters. Of 640 x 480 pixels, simulated: in colour 14 ms and 47 % of the bytes, with 16 bits 9 ms and 29 %; with
level 1 that is 29 ms and 54 %, 15 ms and 31 %."""


class Decoded(NamedTuple):
    """An image."""
    pixels: Array
    """(height, width) or (height, width, channels), C-contiguous, in native byte order."""
    encoding: str
    """As in sensor_msgs/Image."""
    problem: str = ''
    """How the format contradicts the pixels, which decide; empty: it does not."""


def decode(data: Buffer, description: str) -> Decoded:
    """Decode the data of a CompressedImage.

    :param description: its `format`
    :raises ValueError: saying what is wrong with it
    """
    if not len(data):
        raise ValueError('format is %r, but there are no data' % description)
    if not np.frombuffer(data, np.uint8).any():
        raise ValueError('format is %r, but all %d bytes of the data are 0' % (description, len(data)))
    if DEPTH_FORMAT in description:     # some write it without the semicolon
        return _depth(bytes(data), description.partition(DEPTH_FORMAT)[0].strip('; '), description)
    named, _, compression = (part.strip() for part in description.partition(';'))
    pixels = _pixels(bytes(data), description)
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    names = NAMES.get((pixels.dtype.name, channels))
    if names is None:
        raise ValueError('format is %r with %d channels %s, must be one of 8 or 16 bits, or 3 or 4 of 8 bits' % (
            description, channels, pixels.dtype.name))
    problem = _contradiction(description, pixels, channels)
    if named in names or channels == 1 and named.startswith(BAYER) and named.endswith(names[0][len('mono'):]):
        return Decoded(pixels, named, problem)
    # what was not converted before it was compressed has its own order, which OpenCV took for blue, green, red
    swapped = compression and named in SWAPPED.values() and 'compressed bgr' not in compression
    return Decoded(pixels, SWAPPED.get(names[0], names[0]) if swapped else names[0], problem)


def _contradiction(description: str, pixels: Array, channels: int) -> str:
    """How the format of an image contradicts its pixels; empty: it does not, or names no encoding that is known here.

    What image_transport converted before it compressed an image has the encoding that follows `compressed`.
    """
    named, _, compression = (part.strip() for part in description.partition(';'))
    converted = compression.partition('compressed')[2].strip()
    try:
        dtype, expected = pixel_type(converted or named)
    except ValueError:
        return ''
    if (dtype.itemsize, expected) == (pixels.dtype.itemsize, channels):
        return ''
    lost = '; what was above 255 is lost: 16 bits have to be compressed as png' * (dtype.itemsize > pixels.itemsize)
    return 'format is %r, but the data have %d channel%s of %d bits, which count%s' % (
        description, channels, 's' * (channels > 1), 8 * pixels.itemsize, lost)


def encode(pixels: Array, encoding: str) -> Tuple[str, bytes]:
    """Compress an image: 8 bits as JPEG, 16 bits as PNG.

    :param pixels: (height, width) or (height, width, channels) array, in any byte order, see pixels.as_pixels
    :return: format and data of a CompressedImage
    :raises ValueError: images of this encoding are not compressed
    """
    native = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
    if encoding in PNG_ENCODINGS:
        _, data = cv2.imencode('.png', native, PNG_OPTIONS)
        return '%s; png compressed ' % encoding, data.tobytes()
    if encoding not in JPEG_ENCODINGS:
        raise ValueError('encoding is %r, which is not compressed; %s are' % (
            encoding, ', '.join((*JPEG_ENCODINGS, *PNG_ENCODINGS))))
    conversion = JPEG_ENCODINGS[encoding]
    _, data = cv2.imencode('.jpg', native if conversion is None else cv2.cvtColor(native, conversion))
    return '%s; jpeg compressed %s' % (encoding, 'bgr8' if native.ndim == 3 else ''), data.tobytes()


LOSSLESS = 'mono8', '8UC1', 'mono16', '16UC1', 'bgr8', 'rgb8'
"""Encodings of `lossless`."""


def lossless(pixels: Array, encoding: str) -> Tuple[str, bytes]:
    """Compress an image without loss, as PNG.

    :param pixels: as of `encode`
    :param encoding: one of LOSSLESS
    :return: format and data of a CompressedImage; colours are in the order that OpenCV reads them in
    """
    native = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('='))
    if encoding == 'rgb8':
        native = cv2.cvtColor(native, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode('.png', native, PNG_OPTIONS)
    return '%s; png compressed %s' % (encoding, 'bgr8' if native.ndim == 3 else ''), data.tobytes()


def announced_size(data: bytes) -> Tuple[int, int]:
    """(height, width) of a JPEG or PNG by its header; its end is there, too.

    :raises ValueError: it is neither, or is truncated
    """
    if data.startswith(PNG):
        if len(data) < 24 or PNG_END not in data[-64:]:
            raise ValueError('the PNG of %d bytes has no end: it is truncated' % len(data))
        width, height = struct.unpack_from('>II', data, 16)
        return height, width
    if data.startswith(JPEG):
        return _jpeg_size(data)
    raise ValueError('data of %d bytes begins with %s: it is neither JPEG nor PNG' % (len(data), data[:4].hex() or '-'))


def _jpeg_size(data: bytes) -> Tuple[int, int]:
    """:raises ValueError: it is truncated, or has no size"""
    size, at = None, 2
    while at + 4 <= len(data) and data[at] == 0xff:
        marker = data[at + 1]
        if marker == 0xff or marker in BARE:
            at += 1 if marker == 0xff else 2
            continue
        if marker in START_OF_FRAME and at + 9 <= len(data):
            size = struct.unpack_from('>HH', data, at + 5)
        if marker == START_OF_SCAN:
            # compressed data never has this marker; cameras may append zeros
            if size is None or JPEG_END not in data[at:]:
                break
            return int(size[0]), int(size[1])
        at += 2 + int.from_bytes(data[at + 2:at + 4], 'big')
    raise ValueError('the JPEG of %d bytes has no size or no end: it is truncated' % len(data))


def _pixels(data: bytes, description: str) -> Array:
    """(height, width) or (height, width, channels) array.

    :raises ValueError: it is no image, a truncated one, or too large
    """
    height, width = announced_size(data)
    if not (1 <= height <= MAX_SIDE and 1 <= width <= MAX_SIDE and height * width <= MAX_PIXELS):
        raise ValueError('it announces %d x %d pixels, must be from 1 x 1 to %d x %d' % (
            width, height, MAX_SIDE, MAX_SIDE))
    compressed: UInt8Array = np.frombuffer(data, np.uint8)
    try:
        pixels = cv2.imdecode(compressed, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError('format is %r, but it cannot be decoded: %s' % (description, error)) from None
    if pixels is None or pixels.shape[:2] != (height, width):
        raise ValueError('format is %r, but its %d bytes cannot be decoded' % (description, len(data)))
    found: Array = pixels
    return found


def _depth(data: bytes, named: str, description: str) -> Decoded:
    """A compressed depth image: 16 bits [mm] as they are, 32FC1 [m] from its quantised inverse.

    :raises ValueError: saying what is wrong with it
    """
    if named not in (*PNG_ENCODINGS, '32FC1'):
        raise ValueError('format is %r, must begin with %s or 32FC1' % (description, ', '.join(PNG_ENCODINGS)))
    if len(data) <= DEPTH.size or not data.startswith(PNG, DEPTH.size):
        raise ValueError("format is %r, but the data are no PNG: set compressed_depth_image_transport's format to png, "
                         'or use the raw topic' % description)
    _, a, b = DEPTH.unpack_from(data)
    counts = _pixels(data[DEPTH.size:], description)
    if counts.dtype != np.uint16 or counts.ndim != 2:
        raise ValueError('format is %r, but its PNG is not of one channel of 16 bits' % description)
    if named in PNG_ENCODINGS:
        return Decoded(counts, named)
    if counts.any() and not (a and np.isfinite((a, b)).all()):
        raise ValueError('format is %r, but its quantisation is %g and %g: there is no depth' % (description, a, b))
    with np.errstate(divide='ignore', invalid='ignore'):
        metres = np.float32(a) / (counts.astype(np.float32) - np.float32(b))
    return Decoded(np.where(counts == 0, np.float32('nan'), metres).astype(np.float32), named)
