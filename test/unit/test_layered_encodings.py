# SPDX-License-Identifier: BSD-3-Clause
"""Which encodings can be layered, and how their pixels cross."""
from typing import Any

import needs_numba  # noqa: F401
import numpy as np
import pytest
from layered_sender import (
    BAD,
    CASES,
    DATAGRAM,
    NO_LOSS,
    encoder,
    image,
    photograph,
    received,
    rms,
    segments,
    settings,
)

from smokebot_udp.codecs.layered import depth, quality
from smokebot_udp.msg import ImageSegment, LayeredSegment


@pytest.mark.parametrize('encoding, sent', [
    ('bgr8', 'bgr8'), ('rgb8', 'rgb8'), ('8UC3', '8UC3'), ('bgra8', 'bgr8'), ('rgba8', 'rgb8')])
def test_colours_are_coded_as_blue_green_red(encoding: str, sent: str) -> None:
    pixels = CASES['bgr8']
    message = pixels[..., ::-1] if encoding.startswith('rgb') else pixels
    if encoding.endswith('a8'):
        message = np.dstack([message, np.full(pixels.shape[:2], 255, np.uint8)])
    of = settings()
    parts = segments(encoder(of).encode(image(message, encoding), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    assert parts[0].encoding == sent and rms(shown, pixels) < 1.0


@pytest.mark.parametrize('encoding', ['mono16', '16UC1'])
def test_the_byte_order_of_the_source_is_kept_in_the_message_and_not_in_the_pixels(encoding: str) -> None:
    pixels, of = CASES['mono16'], settings()
    parts = segments(encoder(of).encode(image(pixels.astype('>u2'), encoding, big=True), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    assert parts[0].is_bigendian == 1 and rms(shown, pixels) < 2.0


def test_depth_is_coded_in_counts_and_what_is_no_number_stays() -> None:
    metres = (1.0 + photograph(high=3.0)).astype(np.float32)
    metres[:10], metres[10:15, :20], metres[-1] = np.nan, np.inf, -np.inf
    of = settings(depth_unit=0.001)
    made = encoder(of)
    for second in (1, 2, 3):
        parts = segments(made.encode(image(metres, '32FC1', second), of, DATAGRAM))
        decoded, error = received(parts, range(len(parts)))
    assert parts[0].encoding == '32FC1' and parts[0].depth_unit == pytest.approx(0.001)
    shown = depth.from_counts(decoded, parts[0].depth_unit)
    finite = np.isfinite(metres)
    assert error == quality.EXACT and np.abs(shown[finite] - metres[finite]).max() <= 0.00051
    assert (np.isnan(shown) == np.isnan(metres)).all() and (shown == np.inf).sum() == 100
    assert (shown[-1] == -np.inf).all()


def test_depth_with_scattered_holes_is_shown_on_a_slow_link() -> None:
    random = np.random.RandomState(1)
    metres = (1.0 + photograph(480, 640, high=3.0)).astype(np.float32)
    metres[random.random_sample(metres.shape) < 0.05] = np.nan
    finite = np.isfinite(metres)
    of = settings(depth_unit=0.001, rate=10.0)
    made = encoder(of, BAD._replace(room=62500.0))
    for second in (1, 2):
        parts = segments(made.encode(image(metres, '32FC1', second), of, DATAGRAM))
        decoded, error = received(parts, range(len(parts)))
        assert decoded is not None and error != quality.EXACT
        difference = (depth.from_counts(decoded, 0.001) - metres)[finite & (decoded.classes == 0)] / 0.001
        assert len(difference) > 0.9 * finite.sum()
        assert quality.from_byte(error) == pytest.approx(float(np.sqrt((difference ** 2).mean())), rel=0.5)
    # where there is room for the whole map it comes, and stays
    made.see(outlook=NO_LOSS)
    for second in range(3, 8):
        parts = segments(made.encode(image(metres, '32FC1', second), of, DATAGRAM))
        decoded, error = received(parts, range(len(parts)))
        if second > 4:
            assert error == quality.EXACT and (np.isfinite(depth.from_counts(decoded, 0.001)) == finite).all()


def test_a_reduced_image_is_coded_reduced() -> None:
    pixels, of = CASES['bgr8'], settings(scale=2)
    parts = segments(encoder(of).encode(image(pixels, 'bgr8'), of, DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    mean = pixels.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3))
    assert (parts[0].height, parts[0].width) == (48, 64) and rms(shown, mean) < 1.0


def test_a_mosaic_is_coded_in_colours() -> None:
    mosaic = np.tile(np.uint8([[200, 100], [100, 10]]), (24, 32))
    parts = segments(encoder(settings()).encode(image(mosaic, 'bayer_rggb8'), settings(), DATAGRAM))
    shown, _ = received(parts, range(len(parts)))
    assert (parts[0].encoding, parts[0].height, parts[0].width) == ('bgr8', 48, 64)
    assert rms(shown, [10.0, 100.0, 200.0]) < 2


@pytest.mark.parametrize('encoding, item, fault', [
    ('8UC4', (4, np.uint8), r"coding is layered, but encoding is '8UC4', which cannot be layered; mono8, .*rgba8 can"),
    ('32FC1', (1, np.float32), "encoding is '32FC1', which can be layered only if depth_unit is set"),
    ('nv21', (1, np.uint8), "encoding is 'nv21'"),
])
def test_what_cannot_be_layered_is_refused_and_auto_interleaves_it(encoding: str, item: Any, fault: str) -> None:
    message = image(np.ones((8, 8) + (item[0],) * (item[0] > 1), item[1]), encoding)
    with pytest.raises(ValueError, match=fault):
        encoder(settings()).encode(message, settings(), DATAGRAM)
    auto = settings(coding='auto')
    if encoding == 'nv21':
        with pytest.raises(ValueError, match='encoding'):       # not interleaved either
            encoder(auto).encode(message, auto, DATAGRAM)
    else:
        frame, = encoder(auto).encode(message, auto, DATAGRAM)
        assert frame.message_class is ImageSegment


def test_an_image_above_the_limit_is_refused() -> None:
    with pytest.raises(ValueError, match='coding is layered, but 1500 x 1000 pixels bgr8 are 4500000 values'):
        encoder(settings()).encode(image(np.zeros((1500, 1000, 3), np.uint8), 'bgr8'), settings(), DATAGRAM)
    auto = settings(coding='auto')
    frames = encoder(auto, BAD).encode(image(np.zeros((1500, 1000, 3), np.uint8), 'bgr8'), auto, DATAGRAM)
    assert {frame.message_class for frame in frames} == {ImageSegment}
    halved = settings(scale=2)
    frame, = encoder(halved).encode(image(np.zeros((1500, 1000, 3), np.uint8), 'bgr8'), halved, DATAGRAM)
    assert frame.message_class is LayeredSegment


def test_a_wrong_message_is_named() -> None:
    message = image(CASES['mono8'], 'mono8')
    message.step, message.data = 5, message.data[:-1]
    with pytest.raises(ValueError, match='height x step is [0-9]+ x 5'):
        encoder(settings()).encode(message, settings(), DATAGRAM)
