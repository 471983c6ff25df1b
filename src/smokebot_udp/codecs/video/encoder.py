# SPDX-License-Identifier: BSD-3-Clause
"""H.264 by libx264: images in slices of one datagram each, each of about the same size.

Instead of one image in ten, a tenth of each is coded without reference to the last one (intra refresh): images have
equal sizes, and what was lost is mended within ten images. libx264's buffer holds about one image, so the size of each
is bounded. Importing this module loads PyAV, or fails where it is missing.
"""
from fractions import Fraction
from typing import List, NamedTuple

import av
import numpy as np
from av.video.frame import PictureType

from ...arrays import UInt8Array
from . import nal, parameter_sets, slice_header
from .planes import even, has_colour, to_planes

NOMINAL_RATE = 10
"""Images per second as libx264 is told. It only divides by it: sizes of images are what counts [Hz]."""

BUFFERED = 1.0
"""Size of libx264's buffer, in images of the mean size."""

LEVEL = '5.1'
"""Level that is written in the parameter sets. With a fixed one they are the same for all sizes of coded images."""

LEAST_ROOM = 750
"""A slice has at least one macroblock. One of black and white noise takes 725 at the finest quantiser [byte]."""

LEAST_SIZE = 100
"""Minimum size of a coded image [byte]. libx264 counts it in kilobits per second."""


def check_library() -> None:
    """:raises ValueError: libavcodec was built without libx264"""
    av.Codec('libx264', 'w')


class EncodedImage(NamedTuple):
    """An image, coded."""
    slices: List[bytes]
    """NAL units without start codes, in order, each at most as long as the room for it."""
    parameter_sets: bytes
    """Parameter sets of the session, with start codes. They are the same for each of its images."""
    intra: bool
    """Whether decoding may begin with this image."""
    qp: float
    """Mean quantiser of its slices, 0..51."""

    @property
    def size(self) -> int:
        """The size of all slices [byte]."""
        return sum(map(len, self.slices))


class VideoEncoder:
    """Encodes the images of one session: of one size, one encoding, and about one size when coded.

    :param height: [pixel]
    :param width: [pixel]
    :param encoding: mono8, bgr8 or rgb8
    :param size: of a coded image, and the most that `encode` may ask for [byte]
    :param room: for a slice, at least LEAST_ROOM [byte]
    :param refresh: all of the image is coded without reference to others within this many images
    :raises ValueError: a value is out of range
    """

    def __init__(self, height: int, width: int, encoding: str, size: int, room: int, refresh: int) -> None:
        if room < LEAST_ROOM or size < LEAST_SIZE or refresh < 1:
            raise ValueError('a slice of %d bytes, an image of %d or a refresh after %d images is out of range' % (
                room, size, refresh))
        self._encoding, self._images, self._parameter_sets = encoding, 0, b''
        self._codec = codec = av.CodecContext.create('libx264', 'w')
        codec.width, codec.height = even(width), even(height)
        codec.pix_fmt = 'yuv420p' if has_colour(encoding) else 'gray'
        codec.time_base, codec.framerate = Fraction(1, NOMINAL_RATE), Fraction(NOMINAL_RATE)
        codec.thread_count = 1
        codec.bit_rate = self._bit_rate = _bit_rate(size)
        codec.options = {
            'preset': 'veryfast', 'tune': 'psnr,zerolatency',
            'maxrate': str(codec.bit_rate), 'bufsize': str(int(BUFFERED * codec.bit_rate / NOMINAL_RATE)),
            'x264-params': 'intra-refresh=%d:keyint=%d:slice-max-size=%d:constrained-intra=1:ref=1:bframes=0:aq-mode=0:'
                           'level=%s:threads=1:log=0' % (refresh > 1, refresh, room, LEVEL)}
        codec.open()    # before `encode` asks for less: libx264 follows only if it was opened with maxrate as bit_rate

    def encode(self, pixels: UInt8Array, size: int, intra: bool = False) -> EncodedImage:
        """Encode the next image.

        :param pixels: (height, width) uint8 of mono8, (height, width, 3) uint8 of the others
        :param size: of this and the next images when coded; more than that of the session counts as that [byte]
        :param intra: decoding must be able to begin with this image; it always is with the first one
        """
        bit_rate = min(_bit_rate(max(size, LEAST_SIZE)), self._bit_rate)
        if bit_rate != self._codec.bit_rate:
            self._codec.bit_rate = bit_rate
        frame = av.VideoFrame.from_ndarray(to_planes(pixels, self._encoding), self._codec.pix_fmt)
        frame.pts = self._images
        if intra:
            frame.pict_type = PictureType.I
        self._images += 1
        return self._image(nal.split(b''.join(bytes(packet) for packet in self._codec.encode(frame))))

    def _image(self, units: List[bytes]) -> EncodedImage:
        sets = [unit for unit in units if nal.unit_type(unit) in nal.PARAMETER_SETS]
        if sets:
            self._parameter_sets = nal.byte_stream(sets)
        slices = [unit for unit in units if nal.unit_type(unit) in nal.SLICES]
        parsed = parameter_sets.parse(self._parameter_sets)
        headers = [slice_header.parse(unit, parsed) for unit in slices]
        return EncodedImage(slices, self._parameter_sets, headers[0].is_idr,
                            float(np.mean([header.qp for header in headers])))


def _bit_rate(size: int) -> int:
    """What libx264 is told for images of this size [bit/s]."""
    return 8 * NOMINAL_RATE * size // 1000 * 1000
