# SPDX-License-Identifier: BSD-3-Clause
"""What the black box records of images."""
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image

from smokebot_udp.codecs.wire.pixels import as_pixels
from smokebot_udp.streams.image.source import raw_image
from smokebot_udp.streams.recorded_images import HURRY, Backlog, RawRate, Thinning, recorded


def image(encoding: str, channels: int = 1, big: bool = False) -> Any:
    """Noise, whose rows are padded."""
    kind = '>u2' if big else '<u2' if encoding.endswith('16') or '16' in encoding else 'u1'
    pixels = np.random.RandomState(1).randint(0, 60000, (12, 17 * channels)).astype(kind)
    padded = np.pad(pixels, ((0, 0), (0, 2)))
    return Image(height=12, width=17, encoding=encoding, step=padded.strides[0], data=padded.tobytes(),
                 is_bigendian=big)


def pixels_of(message: Any) -> Any:
    return as_pixels(message.data, message.height, message.width, message.step, message.encoding,
                     message.is_bigendian)


@pytest.mark.parametrize('encoding, channels, big', [
    ('mono8', 1, False), ('8UC1', 1, False), ('mono16', 1, False), ('16UC1', 1, True), ('bgr8', 3, False),
    ('rgb8', 3, False)])
def test_raw_images_are_compressed_without_loss(encoding: str, channels: int, big: bool) -> None:
    message = image(encoding, channels, big)
    message.header.stamp.secs, message.header.frame_id = 5, 'lens'
    found = recorded(message)
    assert found._type == CompressedImage._type and found.header == message.header
    shown = raw_image(found)
    original = pixels_of(message)
    assert shown.encoding == ('bgr8' if channels == 3 else encoding)
    assert np.array_equal(pixels_of(shown), original[..., ::-1] if encoding == 'rgb8' else original)


@pytest.mark.parametrize('message', [
    CompressedImage(format='jpeg', data=b'anything'), image('bayer_rggb8'), image('bgra8', 4),
    Image(height=4, width=4, encoding='mono8', step=4, data=b'short'), Image(encoding='mono8')])
def test_all_else_is_recorded_as_it_is(message: Any) -> None:
    assert recorded(message) is message


def kept(rate: float, stamps: Any) -> Any:
    thinning = Thinning(rate)
    return [stamp for stamp in stamps if thinning.takes(stamp)]


def test_both_sides_record_the_same_images_of_each_period() -> None:
    stamps = [1.6e9 + 0.03 + step / 10 for step in range(100)]
    robot, operator = kept(5.0, stamps), kept(5.0, stamps[1:])      # which came a little later
    assert robot == stamps[::2] and operator == [stamps[1], *robot[1:]]


def test_a_source_of_the_highest_rate_is_recorded_as_a_whole_though_its_stamps_jitter() -> None:
    random = np.random.RandomState(1)
    stamps = [1.6e9 + step / 5 + random.uniform(-0.015, 0.015) for step in range(100)]
    assert kept(5.0, stamps) == stamps


def test_stamps_that_go_back_are_recorded_and_zero_limits_nothing() -> None:
    assert kept(5.0, [100.0, 10.0, 10.05]) == [100.0, 10.0]
    assert kept(0.0, [1.0, 1.0, 1.01]) == [1.0, 1.0, 1.01]


def test_where_too_much_waits_some_are_recorded_raw() -> None:
    backlog, rate = Backlog(), RawRate()
    assert not backlog.hurries
    backlog.add('front', None, HURRY + 1)
    assert backlog.hurries
    taken = [rate.take(10 ** 6, 5.0 + step / 100) for step in range(100)]      # of 1 MB, for a second
    assert sum(taken) == 10 and taken[0]


def test_the_oldest_is_left_out_where_too_much_waits() -> None:
    backlog = Backlog(100)
    for number in range(5):
        backlog.add('front', number, 40)
    assert backlog.left_out == {'front': 3}
    assert [backlog.take(), backlog.take(), backlog.take()] == [('front', 3), ('front', 4), None]
    backlog.add('rear', 'large', 1000)      # a single one is recorded, however large
    assert backlog.take() == ('rear', 'large') and backlog.left_out == {'front': 3}
