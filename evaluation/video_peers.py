# SPDX-License-Identifier: BSD-3-Clause
"""H.264 as robot teams send it, through PyAV: with or without an erasure code across the slices of an image.

The code is an ideal one: any k of the packets of an image restore its k slices, and no packet carries more than its
share. Where fewer come, the slices among them are decoded.
"""
import math
import re
import time
from fractions import Fraction
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import cv2
import numpy as np

from smokebot_udp.arrays import Array, BoolArray, UInt8Array
from smokebot_udp.link_lab.channel import LinkConditions
from smokebot_udp.streams.air import Air

from .losses import failing
from .video_clips import RATE, Clip
from .video_link import CHOICE_SEED, SETTLED, Way, constant, watch

OVERHEAD = 28 + 60
"""Size of a packet without its part of the image: IP, UDP and a small message [byte]."""

ROOM = 1500 - OVERHEAD
SLICE_SIZE = 1300
"""x264's slice-max-size [byte]."""

BUFFER = 0.2
"""The encoder's rate control may save and borrow this much [s]."""

LADDER = 1.05
"""Bit rates that are tried differ by this factor."""

FAILURES = 0.2, 0.03, 0.003
"""How often a code may fail, of those that are chosen for a known loss."""

MAX_PARITIES = 200
MIN_BIT_RATE, LIKELY_PART, MAX_OVERSHOOT = 20e3, 0.8, 1.3
"""Bit rates are tried from the first [bit/s] to the last, in terms of the rate on the wire; the other comes first."""

HOPELESS = 4.0
"""A coding that is worse by this without losses is not tried with them [dB]."""

START = re.compile(b'\x00\x00\x00?\x01')
"""Before each NAL unit."""

PARAMETER_SETS, NO_SLICES = (7, 8), (6, 9)
"""Types of NAL units: SPS and PPS; SEI and access unit delimiters."""

GAP_HEADER = 16
"""Bytes of a slice that contain its header, for an image of which nothing came."""


def _pyav() -> Any:
    """PyAV, which is optional; what libavcodec finds missing is not worth a line."""
    import av
    av.logging.set_level(av.logging.PANIC)
    return av


class Coding(NamedTuple):
    """Settings of x264."""
    name: str
    preset: str
    tune: str
    parameters: str
    whole: bool = False
    """Whether an image is sent in packets of any size, and lost with any of them."""
    predicted: bool = True
    """Whether any image is predicted from another one."""


def sliced(refresh: int) -> Coding:
    """Slices no larger than a packet, each decodable by itself, and intra refresh within so many images; 1: all intra.
    """
    return Coding('refresh %d' % refresh, 'veryfast', 'psnr,zerolatency',
                  '%skeyint=%d:ref=1:bframes=0:threads=1:slice-max-size=%d:constrained-intra=1:aq-mode=0'
                  % ('intra-refresh=1:' if refresh > 1 else '', refresh, SLICE_SIZE), predicted=refresh > 1)


NIMBRO_NETWORK = Coding('nimbro_network', 'ultrafast', 'zerolatency',
                'intra-refresh=1:keyint=20:ref=1:bframes=0:threads=4:sliced-threads=1', whole=True)
"""Its sender.cpp leaves rate control at x264's constant quality; here it keeps to a rate."""


class Encoded(NamedTuple):
    """A clip as H.264."""
    parameter_sets: bytes
    images: List[List[bytes]]
    """The slices of each, with start codes."""
    cpu: float
    """Per image [s]."""


def encode(clip: Clip, coding: Coding, bit_rate: float) -> Encoded:
    """Encode a clip; bit_rate: of the rate control [bit/s]."""
    av = _pyav()
    context = av.CodecContext.create('libx264', 'w')
    context.height, context.width = clip[0].shape[:2]
    context.pix_fmt, context.framerate, context.time_base = 'yuv420p', Fraction(int(RATE)), Fraction(1, int(RATE))
    context.bit_rate = int(bit_rate)
    parameters = '%s:vbv-maxrate=%d:vbv-bufsize=%d' % (coding.parameters, bit_rate / 1e3, bit_rate * BUFFER / 1e3)
    context.options = {'preset': coding.preset, 'tune': coding.tune, 'x264-params': parameters}
    images: List[List[bytes]] = []
    parameter_sets = b''
    began = time.process_time()
    for number, image in enumerate(clip):
        frame = av.VideoFrame.from_ndarray(to_planes(image), 'yuv420p')
        frame.pts = number
        units = [unit for packet in context.encode(frame) for unit in START.split(bytes(packet)) if unit]
        if not number:
            parameter_sets = b''.join(b'\0\0\0\1' + unit for unit in units if unit[0] & 31 in PARAMETER_SETS)
        images.append([b'\0\0\0\1' + unit for unit in units if unit[0] & 31 not in PARAMETER_SETS + NO_SLICES])
    return Encoded(parameter_sets, images, (time.process_time() - began) / len(clip))


def to_planes(image: UInt8Array) -> UInt8Array:
    """I420: (3 / 2 height, width) uint8 of an image with even sides; grey: chroma is flat."""
    if image.ndim == 3:
        planes: UInt8Array = cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420)
        return planes
    return np.concatenate([image, np.full((image.shape[0] // 2, image.shape[1]), 128, np.uint8)])


class Decoder:
    """Decodes with libavcodec, set up for losses as this package's decoder is.

    :param shape: of the images
    :param predicted: see Coding
    """

    def __init__(self, parameter_sets: bytes, shape: Tuple[int, ...], predicted: bool = True) -> None:
        self._av = _pyav()
        self._context = self._av.CodecContext.create('h264', 'r')
        self._context.thread_count = 1
        from smokebot_udp.codecs.video import decoder  # it needs PyAV
        self._context.options = {**decoder.OPTIONS, 'ec': decoder.CONCEALMENT[predicted]}
        self._shape, self._parameter_sets = shape, parameter_sets

    def decode(self, slices: Sequence[bytes]) -> Optional[Array]:
        """The image of some of its slices; None: libavcodec gives none."""
        data, self._parameter_sets = self._parameter_sets + b''.join(slices), b''
        try:
            frames = self._context.decode(self._av.Packet(data))
        except self._av.AVError:
            return None
        if not frames:
            return None
        planes: UInt8Array = frames[-1].to_ndarray()
        if len(self._shape) == 3:
            image: Array = cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420)
            return image
        return planes[:self._shape[0]]


class Video(Way):
    """An encoded clip over the link.

    :param parities: f(slices of an image) -> packets that the code adds
    :param mended: whether the receiver gives the decoder a slice header for an image of which nothing came
    """

    def __init__(self, encoded: Encoded, coding: Coding, shape: Tuple[int, ...],
                 parities: Callable[[int], int] = lambda count: 0, mended: bool = True) -> None:
        self._encoded, self._coding, self._parities, self._mended = encoded, coding, parities, mended
        self.beforehand = encoded.cpu
        self._decoder = Decoder(encoded.parameter_sets, shape, coding.predicted)
        self._slices: List[bytes] = []

    def send(self, image: Array, number: int, air: Air) -> Sequence[int]:
        self._slices = self._encoded.images[number]
        return packet_sizes(self._slices, self._coding, self._parities)

    def receive(self, arrived: BoolArray) -> Optional[Array]:
        count = len(self._slices)
        if self._coding.whole or np.count_nonzero(arrived) >= count:
            came = self._slices if arrived.all() or not self._coding.whole else []
        else:
            came = [data for data, have in zip(self._slices, arrived) if have]
        if came:
            return self._decoder.decode(came)
        if self._mended:
            self._decoder.decode([self._slices[0][:GAP_HEADER]])
        return None


def packet_sizes(slices: Sequence[bytes], coding: Coding, parities: Callable[[int], int]) -> List[int]:
    """The sizes of the IP packets of an image [byte]. Parity packets are as large as its largest slice."""
    if coding.whole:
        size = sum(map(len, slices))
        return [OVERHEAD + min(ROOM, size - start) for start in range(0, size, ROOM)]
    sizes = [OVERHEAD + len(data) for data in slices]
    return sizes + [max(sizes)] * parities(len(slices))


def redundancy(share: float) -> Callable[[int], int]:
    """A code of this share of the slices, rounded up."""
    return lambda count: math.ceil(share * count)


def matched(conditions: LinkConditions, failure: float) -> Callable[[int], int]:
    """The code that fails no more often than this on such a link."""
    known: Dict[int, int] = {}

    def parities(count: int) -> int:
        if count not in known:
            known[count] = next((more for more in range(MAX_PARITIES)
                                 if failing(conditions, count, count + more) <= failure), MAX_PARITIES)
        return known[count]
    return parities


class Encodings:
    """A clip at all the bit rates that were asked for; what was encoded is kept."""

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self._known: Dict[Tuple[Coding, int], Encoded] = {}

    def fitted(self, coding: Coding, rate: float, parities: Callable[[int], int] = lambda count: 0
               ) -> Encoded:
        """The best that stays within a rate, headers and parity included; the poorest, where none does.

        :param rate: on the wire, on average [bit/s]
        """
        fits, exceeds = (int(math.log(bit_rate, LADDER)) for bit_rate in (MIN_BIT_RATE, MAX_OVERSHOOT * rate))
        step = int(math.log(LIKELY_PART * rate, LADDER))
        while exceeds - fits > 1:
            used = self._used(coding, step, parities)
            fits, exceeds = (step, exceeds) if used <= rate else (fits, step)
            # the rate on the wire nearly follows the bit rate
            step = min(max(step + math.floor(math.log(rate / used, LADDER)), fits + 1), exceeds - 1)
        return self._encoded(coding, fits)

    def _used(self, coding: Coding, step: int, parities: Callable[[int], int]) -> float:
        images = self._encoded(coding, step).images[SETTLED:]
        return sum(sum(packet_sizes(slices, coding, parities)) for slices in images) * 8 * RATE / len(images)

    def _encoded(self, coding: Coding, step: int) -> Encoded:
        if (coding, step) not in self._known:
            self._known[coding, step] = encode(self.clip, coding, LADDER ** step)
        return self._known[coding, step]


Known = Tuple[Coding, Callable[[int], int]]
"""A coding and its code."""


def known_loss(short: Encodings, rate: float, conditions: LinkConditions, codings: Sequence[Coding]) -> Known:
    """What is best on a link that is known beforehand, found by simulation with another seed.

    :param short: of the beginning of the clip
    :param codings: to choose from
    """
    def quality(candidate: Known, link: LinkConditions = conditions) -> float:
        coding, parities = candidate
        way = Video(short.fitted(coding, rate, parities), coding, short.clip[0].shape, parities)
        return watch(short.clip, way, constant(link), CHOICE_SEED, rate).mean
    lossless = {coding: quality((coding, redundancy(0.0)), LinkConditions()) for coding in codings}
    hopeful = [coding for coding in codings if lossless[coding] > max(lossless.values()) - HOPELESS]
    return max(_candidates(conditions, hopeful), key=quality)


def _candidates(conditions: LinkConditions, codings: Sequence[Coding]) -> Iterator[Known]:
    for coding in codings:
        yield coding, redundancy(0.0)
        if conditions.loss:
            for failure in FAILURES:
                yield coding, matched(conditions, failure)
