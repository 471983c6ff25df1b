# SPDX-License-Identifier: BSD-3-Clause
"""Video: encoding, decoding, and what it costs that libavcodec runs in a process of its own. Without ROS in between.

The scene is a photograph that the camera pans over, with the noise of a sensor.
"""
import itertools
import os
import signal
import statistics
import time
from typing import Any, Callable, Dict, List, NamedTuple

import cv2
import numpy as np
import skimage.data

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.codecs.video.decoder import Decoder
from smokebot_udp.codecs.video.decoder_request import Request
from smokebot_udp.codecs.video.encoder import VideoEncoder
from smokebot_udp.nodes.video_decoder import VideoDecoder

from .codecs import Case, measure
from .codecs import table as times_table

IMAGES = 40
ROUNDS, QUICK_ROUNDS = 200, 40
PAN, NOISE = 3, 2.0
"""Columns from one image to the next, and the noise's standard deviation."""

RATE = 10.0
"""[Hz]"""

ROOM, REFRESH = 1300, 10
HOP = '752 x 480 mono8, 1 Mbit/s'
GOALS = {'encode': 10.0, 'decode': 6.0}
"""At 640 x 480 [ms]"""

HOP_GOAL, REPLACED_GOAL = 1.0, 500.0
"""[ms]"""

ENCODE, HERE, THERE = ': encode', ': decode, in this process', ': decode'
KILLS, QUICK_KILLS = 9, 3


class Scene(NamedTuple):
    """What is coded."""
    name: str
    height: int
    width: int
    encoding: str
    bit_rate: float
    """[bit/s]"""

    @property
    def size(self) -> int:
        """The size of a coded image [byte]."""
        return int(self.bit_rate / 8 / RATE)

    def images(self) -> List[UInt8Array]:
        """[(height, width[, 3]) uint8, ...], forth and back."""
        random = np.random.RandomState(6)
        photograph = cv2.resize(skimage.data.astronaut(), (self.width + PAN * IMAGES, self.height))
        if self.encoding == 'mono8':
            photograph = cv2.cvtColor(photograph, cv2.COLOR_RGB2GRAY)
        shown = [photograph[:, PAN * number:PAN * number + self.width] for number in range(IMAGES)]
        noisy = [np.clip(image + random.normal(0, NOISE, image.shape), 0, 255).astype(np.uint8) for image in shown]
        return noisy + noisy[::-1]

    def encoder(self) -> VideoEncoder:
        return VideoEncoder(self.height, self.width, self.encoding, self.size, ROOM, REFRESH)

    def requests(self) -> List[Request]:
        """The requests to the decoder of an operator who receives all slices."""
        encoder = self.encoder()
        coded = [encoder.encode(image, self.size) for image in self.images()]
        return [Request(1, self.height, self.width, self.encoding != 'mono8', image.parameter_sets, image.slices)
                for image in coded]


SCENES = [Scene(HOP, 480, 752, 'mono8', 1e6), *(
    Scene('640 x 480 %s, %g Mbit/s' % (encoding, rate), 480, 640, encoding, 1e6 * rate)
    for encoding in ('mono8', 'bgr8') for rate in (0.3, 1, 3))]


def cases(scene: Scene, decoder: VideoDecoder) -> Dict[str, Case]:
    """Encoding and decoding, image after image.

    :param decoder: decodes in a process of its own
    """
    encoder, images, here = scene.encoder(), itertools.cycle(scene.images()), Decoder()
    asked_here, asked_there = itertools.cycle(scene.requests()), itertools.cycle(scene.requests())
    goals = GOALS if scene.width == 640 else {}
    return {scene.name + ENCODE: Case(lambda: encoder.encode(next(images), scene.size), goals.get('encode')),
            scene.name + HERE: Case(lambda: here.decode(next(asked_here))),
            scene.name + THERE: Case(lambda: decoder.decode(next(asked_there)), goals.get('decode'))}


def replaced(kills: int) -> List[float]:
    """Times from the death of a process, while it is idle, until the first image is decoded by the next one [s].

    The image after its death is lost, and the next one waits.
    """
    request, times = SCENES[0].requests()[0], []
    for _ in range(kills):      # a decoder each: restarts of one are bounded
        decoder = VideoDecoder('bench')
        decoder.decode(request)
        assert decoder.pid is not None
        begun = time.perf_counter()
        os.kill(decoder.pid, signal.SIGKILL)
        while decoder.decode(request) is None:
            pass
        times.append(time.perf_counter() - begun)
        decoder.close()
    return times


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """{'times': see codecs.measure, 'replaced': {'median': [s], 'worst': [s], 'limit': [s]}}"""
    times: Dict[str, Any] = {}
    for scene in SCENES:
        log(scene.name)
        decoder = VideoDecoder(scene.name)
        times.update(measure(cases(scene, decoder), QUICK_ROUNDS if quick else ROUNDS, lambda _: None))
        if decoder.dropped:
            raise RuntimeError('%s: %s' % (scene.name, dict(decoder.dropped)))
        decoder.close()
    log('processes that are killed')
    found = replaced(QUICK_KILLS if quick else KILLS)
    return {'times': times, 'replaced': {'median': statistics.median(found), 'worst': max(found),
                                         'limit': REPLACED_GOAL / 1e3}}


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    times = results['times']
    lines = [times_table({**times, 'a killed process is replaced': results['replaced']},
                         'video: one image, without ROS in between'),
             '', 'more for the process of its own, the copy and the conversion of pixels included [ms]']
    for scene in SCENES:
        more = times[scene.name + THERE]['median'] - times[scene.name + HERE]['median']
        goal = '%g' % HOP_GOAL if scene.name == HOP else '-'
        lines.append('%-56s %12.2f %12s %12s' % (scene.name, 1e3 * more, '', goal))
    return '\n'.join(lines)
