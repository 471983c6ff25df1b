# SPDX-License-Identifier: BSD-3-Clause
"""When images cross in layers, and when interleaved."""
from typing import Any, List

import cv2
import needs_numba  # noqa: F401
import numpy as np
import pytest
from genpy import Time
from layered_sender import (
    BAD,
    CASES,
    DATAGRAM,
    NO_LOSS,
    encoder,
    image,
    settings,
)

from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ImageSegment, LayeredSegment
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.streams.outlook import Outlook


class Loading:
    """A codec that is not there at first."""
    loaded = False

    def ready(self) -> bool:
        return self.loaded


def kind(made: ImageEncoder, of: Settings, second: int) -> Any:
    frames = made.encode(image(CASES['mono16'], 'mono16', second), of, DATAGRAM)
    kinds = {frame.message_class for frame in frames}
    assert len(kinds) == 1
    return kinds.pop()


@pytest.mark.parametrize('coding', ['layered', 'auto'])
def test_images_cross_interleaved_until_the_codec_is_loaded_and_every_operator_receives_layers(coding: str) -> None:
    of, codec = settings(coding=coding), Loading()
    made = encoder(of, NO_LOSS._replace(room=1e4), codec=codec)
    assert made.parts(of)[:2] == ['segments', 'layers'] and made.parts(settings(coding='interleaved')) == ['segments']
    assert kind(made, of, 1) is ImageSegment
    codec.loaded = True
    made.see(heard=lambda part: part == 'segments')
    assert kind(made, of, 2) is ImageSegment
    made.see(heard=lambda part: True)
    assert kind(made, of, 3) is LayeredSegment


def test_the_coding_changes_while_it_runs_and_so_do_the_operating_points() -> None:
    made = encoder(settings())
    assert made.operating_points(10.0, settings()) == []
    for second, coding in enumerate(['interleaved', 'layered', 'interleaved', 'layered'], 1):
        of = settings(coding=coding)
        used = kind(made, of, second)
        assert used is (LayeredSegment if coding == 'layered' else ImageSegment)
        point = made.operating_points(10.0, of)[0]
        assert set(point.settings) == {'rate'} if coding == 'layered' else {'max_subimages', 'rate'}
        assert made.refine(point.settings, 1e9) == {'rate': point.settings['rate']}


def test_auto_is_interleaved_where_raw_pixels_fit_and_layered_where_they_do_not_or_are_lost() -> None:
    of = settings(coding='auto', rate=10.0)
    for outlook, expected in ((NO_LOSS, ImageSegment), (NO_LOSS._replace(room=1e5), LayeredSegment),
                              (BAD, LayeredSegment), (Outlook(), LayeredSegment)):
        assert kind(encoder(of, outlook), of, 1) is expected


def test_auto_layers_colours_that_are_good_that_way_though_their_raw_pixels_would_fit() -> None:
    def passing(grain: float) -> List[Any]:
        texture = 255 * cv2.GaussianBlur(np.random.RandomState(0).rand(96, 128, 3), (0, 0), grain)
        return [np.roll(texture.astype(np.uint8), 2 * number, 1) for number in range(30)]

    # a fine texture that passes fast is sent coarse, as each image is outdated at once; of others it is good
    for scene, most, expected in ((30 * [CASES['bgr8']], 0.0, LayeredSegment), (passing(1.0), 0.0, ImageSegment),
                                  (passing(1.5), 0.0, LayeredSegment), (passing(2.0), 0.0, LayeredSegment),
                                  (passing(1.0), 10.0, LayeredSegment)):    # which is how good they are to be
        seconds, of = [0.0], settings(coding='auto', rate=10.0, max_quality=most)
        made = encoder(of, NO_LOSS._replace(room=3e6), clock=lambda now=seconds: now[0])    # type: ignore[misc]
        for number, pixels in enumerate(scene):
            seconds[0] = 0.1 * number
            message = image(pixels, 'bgr8')
            message.header.stamp = Time(1, 10 ** 7 * number)
            encoded = made.encoded(message, of, DATAGRAM)
        assert encoded.frames[0].message_class is expected
        assert bool(encoded.wished) is (expected is ImageSegment)


def test_auto_goes_by_the_images_that_the_source_has() -> None:
    of = settings(coding='auto', rate=30.0)
    made = encoder(of, NO_LOSS._replace(room=1.45e6))       # raw images take 27 kB, so 18 ms
    assert kind(made, of, 1) is LayeredSegment
    slow = encoder(of, NO_LOSS._replace(room=1.45e6))
    slow.see(source_rate=5.0)
    assert kind(slow, of, 1) is ImageSegment


def test_auto_gives_up_layers_on_a_processor_that_is_too_slow() -> None:
    now = iter(np.arange(0.0, 1e3, 0.01))       # at each look at the clock it is 10 ms later: an image takes 40 ms
    of = settings(coding='auto', rate=30.0)
    made = encoder(of, BAD, clock=lambda: float(next(now)))
    kinds = [kind(made, of, second) for second in range(1, 12)]
    assert kinds[0] is LayeredSegment and kinds[-1] is ImageSegment


def test_auto_goes_by_the_time_between_the_images_that_the_source_has() -> None:
    now = iter(np.arange(0.0, 1e3, 0.01))
    of = settings(coding='auto', rate=30.0)
    made = encoder(of, BAD, clock=lambda: float(next(now)))
    made.see(source_rate=10.0)      # 40 ms are not too slow
    assert [kind(made, of, second) for second in range(1, 12)] == 11 * [LayeredSegment]


def test_auto_interleaves_no_images_above_max_bytes() -> None:
    for most, expected in ((2000, LayeredSegment), (100000, ImageSegment)):     # raw images take 27 kB
        of = settings(coding='auto', rate=10.0, max_bytes=most)
        assert kind(encoder(of, NO_LOSS), of, 1) is expected
