# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot bench layered --prediction: what predicts a layered image, where its bytes go, and x264 without refresh.

Nothing is lost, and there are no datagrams. A report takes as long as one of LAGS says. Quality and bytes do not depend
on the machine's load.
"""
import math
import statistics
from typing import Any, Callable, Dict, List, NamedTuple, Sequence

from evaluation.quality import psnr
from evaluation.video_clips import RATE, Clip, clips
from evaluation.video_link import SETTLED
from evaluation.video_peers import Coding, Decoder, Encoded, encode
from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered import blend, image, motion
from smokebot_udp.codecs.layered.prefixes import Prefixes

RATES = 0.3, 1.0, 3.0
"""[Mbit/s]"""

IMAGES, QUICK_IMAGES = 60, 20
LAGS = 1, 2
"""Numbers of images minus those of their references."""

HEAD = 12
"""Size of the head of a stream [byte]."""

NO_REFRESH = Coding('no refresh', 'veryfast', 'psnr,zerolatency',
                    'keyint=infinite:scenecut=0:ref=1:bframes=0:threads=1:aq-mode=0')
TRIALS = 12
"""Bit rates of x264 that are tried."""


class Tools(NamedTuple):
    """What is used to predict."""
    prediction: bool = True
    motion: bool = True
    second: bool = True
    """A second reference."""


WAYS = {'all': Tools(), 'one reference': Tools(second=False), 'no motion': Tools(motion=False),
        'no motion, one reference': Tools(motion=False, second=False), 'no prediction': Tools(prediction=False)}


class Bytes(NamedTuple):
    """Where the bytes of an image go."""
    motion: int
    """Motions, and which the second reference is."""
    blocks: int
    """Weights of bands, and flags of blocks."""
    residual: int
    """The passes."""


def course_of(held: Sequence[Array], lag: int, pixels: Array, tools: Tools) -> Any:
    """How an image is predicted, and what it is predicted to be; None: not at all.

    :param held: all images before
    """
    if len(held) < lag or not tools.prediction:
        return None
    first = held[-lag]
    course = blend.Course(motion.estimate(first, pixels) if tools.motion else motion.NONE, None)
    found = blend.predicted(course, first, first)
    if tools.second and len(held) > lag:
        second = held[-lag - 1]
        moved = motion.estimate(second, pixels) if course.motion else motion.NONE
        share = blend.share_of(found, motion.compensate(second, moved), pixels)
        if share:
            course = blend.Course(course.motion, blend.Second(lag + 1, 1, 0, share, moved))
            found = blend.predicted(course, first, second)
    return course, found


def coded(clip: Clip, rate: float, lag: int, tools: Tools) -> Dict[str, Any]:
    """PSNR of a clip [dB], and means of its Bytes; of all images but the first SETTLED.

    :param rate: [Mbit/s]
    """
    held: List[Array] = []
    qualities, spent = [], []
    for pixels in clip:
        found = course_of(held, lag, pixels, tools)
        beginning = 0 if found is None else 1 + len(blend.to_bytes(found[0]))
        stream = image.encode(pixels, False, int(1e6 * rate / 8 / RATE) - beginning, None, found and found[1])
        prefixes: Prefixes = stream.prefixes
        held.append(prefixes.all_pixels())
        qualities.append(psnr(pixels, held[-1]))
        spent.append(Bytes(beginning, prefixes.begun - HEAD, len(stream.data) - prefixes.begun))
    return {'PSNR': statistics.mean(qualities[SETTLED:]),
            **{kind: statistics.mean(getattr(one, kind) for one in spent[SETTLED:]) for kind in Bytes._fields}}


def x264(clip: Clip, rate: float) -> Dict[str, float]:
    """PSNR of a clip without any refresh [dB], and the rate that is used [Mbit/s]; of all images but the first
    SETTLED."""
    def used(encoded: Encoded) -> float:
        return statistics.mean(sum(map(len, slices)) for slices in encoded.images[SETTLED:]) * 8 * RATE / 1e6
    low, high = 1e4, 2e6 * rate
    best = encode(clip, NO_REFRESH, low)
    for _ in range(TRIALS):
        middle = math.sqrt(low * high)
        tried = encode(clip, NO_REFRESH, middle)
        if used(tried) <= rate:
            low, best = middle, tried
        else:
            high = middle
    decoder = Decoder(best.parameter_sets, clip[0].shape)
    shown = ((pixels, decoder.decode(slices)) for pixels, slices in zip(clip, best.images))
    qualities = [psnr(pixels, screen) for pixels, screen in shown if screen is not None]
    return {'PSNR': statistics.mean(qualities[SETTLED:]), 'used': used(best)}


def run(log: Callable[[str], None], quick: bool = False) -> List[Dict[str, Any]]:
    """A row for each clip, rate, lag and way."""
    rows: List[Dict[str, Any]] = []
    for name, clip in clips(QUICK_IMAGES if quick else IMAGES).items():
        for rate in RATES:
            log('%s, %g Mbit/s' % (name, rate))
            at = {'clip': name, 'rate': rate}
            rows.append({**at, 'way': 'x264, no refresh', 'lag': 1, **x264(clip, rate)})
            rows += [{**at, 'way': way, 'lag': lag, **coded(clip, rate, lag, tools)}
                     for lag in LAGS for way, tools in WAYS.items() if tools.prediction or lag == LAGS[0]]
    return rows


def table(rows: Sequence[Dict[str, Any]]) -> str:
    """The results as text."""
    lines = ['%-10s %7s %4s  %-26s %9s %8s %8s %9s' % (
        'clip', 'Mbit/s', 'lag', 'way', 'PSNR [dB]', *('%s [B]' % kind for kind in Bytes._fields))]
    for row in rows:
        spent = ['%.0f' % row[kind] if kind in row else '' for kind in Bytes._fields]
        lines.append('%-10s %7g %4d  %-26s %9.2f %8s %8s %9s' % (
            row['clip'], row['rate'], row['lag'], row['way'], row['PSNR'], *spent))
    return '\n'.join(lines)
