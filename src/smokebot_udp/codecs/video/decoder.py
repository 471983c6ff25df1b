# SPDX-License-Identifier: BSD-3-Clause
"""Decodes H.264 of which slices and whole images are missing, by libavcodec. It parses bytes from the air: nodes run it
in a process of its own (decoder_process.py).

What is missing of an image is taken from the one before, at the same place (`ec=deblock+favor_inter`): libavcodec's
default guesses motion, which costs up to 6 dB, and without favor_inter it smears the border of what arrived over all
that is missing, where most of what arrived is coded without prediction. That is better only where no image is
predicted: there the one before shows another view. Images that are wholly lost show in a gap of frame_num: in their
place it decodes slices of our own, see slice_header.lost_slice.
"""
from typing import Any, List, NamedTuple, Optional, Sequence, Tuple

import av

from . import nal, slice_header
from .decoder_memory import PLANES, check_fit
from .decoder_request import Request
from .parameter_sets import ParameterSets, parse

OPTIONS = {
    'err_detect': 'ignore_err',
    'flags': '+low_delay+output_corrupt', 'flags2': '+showall',     # an image for each access unit, at once
}
"""Options of libavcodec."""

CONCEALMENT = {True: 'deblock+favor_inter', False: 'deblock'}
"""{whether images are predicted: libavcodec's option `ec`}"""

GREY, COLOUR = 'gray', 'yuv420p'
"""Pixel formats of decoded images. Grey images have either: libavcodec is built with or without 4:0:0."""

MAX_FRAME_NUM_BITS = 6
"""libx264 writes 4 for a refresh within 10 images. An image is decoded for each number that is missing."""

ALIGNED = 128
"""Maximum length that libavcodec adds to the sides of images that it allocates [pixel]."""

REPLACED = -1
"""Time stamp of the images in place of lost ones, which are not shown."""

SELF_TEST = bytes.fromhex('000000016764000aacb4f42000000300200000030291e244d4' '0000000168ef0fcb'), bytes.fromhex(
    '6588843ffeee87e1')
"""Parameter sets, and the slice of a grey image of 16 x 16 pixels."""

SELF_TEST_SIDE, SELF_TEST_LUMA = 16, 128


class Picture(NamedTuple):
    """A decoded image. It is valid until the next one is decoded."""
    height: int
    """Height of the first plane [pixel]."""
    width: int
    """Width of the first plane [pixel]."""
    lines: Tuple[int, ...]
    """Number of bytes from one line to the next, for each plane."""
    planes: Sequence[memoryview]
    """The planes: luma, and for colour both of chroma. Each has its lines one after the other."""


class Decoder:
    """Decodes the images of one stream, one after the other, without delay."""

    def __init__(self) -> None:
        av.logging.set_level(av.logging.PANIC)      # faults of what comes from the air are no news
        self._context: Any = None
        self._stream: Any = None    # session, height and width that the context is for
        self._predicted = True      # whether the context is for images that are predicted
        self._time = 0              # stamp of the image decoded last
        self._parameter_sets = b''
        self._parsed: Optional[ParameterSets] = None
        self._frame_num: Optional[int] = None       # of the image decoded last

    def test(self) -> None:
        """Decode an image, and fail to decode one: PyAV loads parts of itself when they are first needed.

        :raises RuntimeError: the image is not the right one
        """
        sets, unit = SELF_TEST
        request = Request(0, SELF_TEST_SIDE, SELF_TEST_SIDE, True, sets, [unit])
        picture = self.decode(request)
        if picture is None or picture.planes[0][0] != SELF_TEST_LUMA:
            raise RuntimeError('libavcodec does not decode H.264')
        self.decode(request._replace(slices=[unit[:1]]))

    def decode(self, request: Request) -> Optional[Picture]:
        """Decode one image.

        :return: None: libavcodec makes no image of it. Then it begins anew with the next one
        :raises ValueError: its parameter sets are bad, or the image has another size or format than announced; likewise
        """
        picture = None
        try:
            picture = self._decoded(request)
        finally:
            if picture is None:
                self.forget()
        return picture

    def forget(self) -> None:
        """Begin anew with the next image."""
        self._context = self._stream = None

    def _decoded(self, request: Request) -> Optional[Picture]:
        stream = request.session, request.height, request.width, request.colour
        if stream != self._stream:
            self._context, self._stream = None, stream
            self._parameter_sets, self._parsed, self._frame_num = b'', None, None
        self._learn(request)
        if self._parsed is None:
            return None
        headers = [_header(unit, self._parsed) for unit in request.slices]
        first = next(filter(None, headers), None)
        if first is None:
            return None
        # an image that is predicted needs those before it
        if self._context is None or first.is_idr and self._parsed.predicted != self._predicted:
            self._open(request, self._parsed)
        self._fill_gap(first, self._parsed)
        self._time += 1
        slices = [unit for unit, header in zip(request.slices, headers) if header is not None]
        frames = self._feed(self._parameter_sets + nal.byte_stream(slices), self._time)
        return self._picture(frames[-1], request) if frames else None

    def _open(self, request: Request, sets: ParameterSets) -> None:
        self._context, self._predicted = av.CodecContext.create('h264', 'r'), sets.predicted
        self._context.thread_count = 1
        self._context.options = {**OPTIONS, 'ec': CONCEALMENT[sets.predicted],
                                 'max_pixels': str((request.height + ALIGNED) * (request.width + ALIGNED))}

    def _learn(self, request: Request) -> None:
        """Parse new parameter sets.

        :raises ValueError: they are bad, or for images of another size
        """
        if request.parameter_sets and request.parameter_sets != self._parameter_sets:
            parsed = parse(request.parameter_sets)
            if parsed.frame_num_bits > MAX_FRAME_NUM_BITS:
                raise ValueError('frame_num has %d bits' % parsed.frame_num_bits)
            check_fit(request, parsed.height, parsed.width)
            self._parameter_sets, self._parsed = request.parameter_sets, parsed

    def _fill_gap(self, header: slice_header.SliceHeader, sets: ParameterSets) -> None:
        """Decode something in place of the images between the last one and this one."""
        if self._frame_num is not None and not header.is_idr:
            gap = (header.frame_num - self._frame_num - 1) % (1 << sets.frame_num_bits)
            for number in range(self._frame_num + 1, self._frame_num + 1 + gap):
                self._feed(nal.byte_stream([slice_header.lost_slice(sets, number)]), REPLACED)
        self._frame_num = header.frame_num

    def _feed(self, unit: bytes, time: int) -> List[Any]:
        """The images that libavcodec makes of an access unit, and has not made late of one before."""
        packet = av.Packet(unit)
        packet.pts = time
        try:
            frames = self._context.decode(packet)
        except av.error.FFmpegError:
            return []
        return [frame for frame in frames if frame.pts == time]

    @staticmethod
    def _picture(frame: Any, request: Request) -> Picture:
        check_fit(request, frame.height, frame.width)
        if frame.format.name != COLOUR and (request.colour or frame.format.name != GREY):
            raise ValueError('%s of format %s' % ('colour' if request.colour else 'grey', frame.format.name))
        planes = frame.planes[:PLANES if request.colour else 1]
        return Picture(frame.height, frame.width, tuple(plane.line_size for plane in planes),
                       [memoryview(plane) for plane in planes])


def _header(unit: bytes, sets: ParameterSets) -> Optional[slice_header.SliceHeader]:
    """The header of a slice; None: it is none."""
    try:
        return slice_header.parse(unit, sets)
    except ValueError:
        return None
