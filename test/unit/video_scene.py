# SPDX-License-Identifier: BSD-3-Clause
"""A moving scene as video, for tests; importing this module skips the tests of the importing one without PyAV."""
import functools
from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

pytest.importorskip('av', reason='video needs PyAV: sudo apt install python3-av')

from smokebot_udp.codecs.video.decoder_request import Request  # noqa: E402
from smokebot_udp.codecs.video.encoder import EncodedImage, VideoEncoder  # noqa: E402

ROOM = 750
"""For a slice [byte]."""


def image(number: int, height: int, width: int, colour: bool = False) -> Any:
    """(height, width[, 3]) uint8: a smooth texture that moves by 2 columns from one image to the next."""
    random = np.random.RandomState(1)
    cells = random.randint(30, 220, (30, 80, 3)).astype(np.uint8)
    texture = cv2.resize(cells, (640, 240), interpolation=cv2.INTER_CUBIC)
    shown = texture[:height, 2 * number:2 * number + width]
    return shown.copy() if colour else shown[..., 1].copy()


@functools.lru_cache(maxsize=None)
def video(count: int, height: int, width: int, colour: bool = False, size: int = 6000) -> Tuple[EncodedImage, ...]:
    """The coded images of the scene."""
    encoder = VideoEncoder(height, width, 'bgr8' if colour else 'mono8', size, ROOM, 10)
    return tuple(encoder.encode(image(number, height, width, colour), size) for number in range(count))


def requests(images: Any, height: int, width: int, colour: bool = False, session: int = 7) -> List[Request]:
    """What a decoder is asked for where nothing is lost."""
    return [Request(session, height, width, colour, coded.parameter_sets, coded.slices) for coded in images]


def psnr(shown: Any, wanted: Any) -> float:
    """[dB]"""
    error = np.mean((shown.astype(float) - wanted) ** 2)
    return float(10 * np.log10(255 ** 2 / max(error, 1e-3)))
