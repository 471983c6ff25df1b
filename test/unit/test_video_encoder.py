# SPDX-License-Identifier: BSD-3-Clause
"""H.264 of a moving scene: sizes, slices, refresh, and what libavcodec makes of it after losses."""
from typing import Iterable, List

import cv2
import needs_pyav  # noqa: F401
import numpy as np
import pytest

from smokebot_udp.arrays import UInt8Array
from smokebot_udp.codecs.video import nal, parameter_sets, slice_header
from smokebot_udp.codecs.video.encoder import LEAST_ROOM, EncodedImage, VideoEncoder
from smokebot_udp.codecs.video.planes import from_planes

av = pytest.importorskip('av')

HEIGHT, WIDTH, ROOM = 240, 320, 750


def scene(count: int, height: int = HEIGHT, width: int = WIDTH) -> List[UInt8Array]:
    """A camera that moves over a smooth pattern by two pixels an image."""
    noise = np.random.RandomState(1).randint(0, 256, (height, width + 2 * count)).astype(np.uint8)
    wide = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    return [np.ascontiguousarray(wide[:, 2 * number:2 * number + width]) for number in range(count)]


class Receiver:
    """A decoder of libavcodec in this process, set up as the decoder's own process does."""

    def __init__(self, encoding: str = 'mono8', height: int = HEIGHT, width: int = WIDTH) -> None:
        self._size = height, width, encoding
        self._codec = av.CodecContext.create('h264', 'r')
        self._codec.thread_count = 1
        self._codec.options = {'err_detect': 'ignore_err', 'ec': 'deblock', 'flags': '+low_delay+output_corrupt',
                               'flags2': '+showall'}

    def show(self, image: EncodedImage, slices: Iterable[bytes]) -> UInt8Array:
        """What is shown of some slices."""
        frames = self._codec.decode(av.Packet(image.parameter_sets + nal.byte_stream(slices)))
        assert len(frames) == 1
        return from_planes(frames[0].to_ndarray(), *self._size)


def psnr(one: UInt8Array, other: UInt8Array) -> float:
    return float(10 * np.log10(255 ** 2 / np.square(one.astype(float) - other).mean()))


@pytest.mark.parametrize('encoding, height, width', [('mono8', 240, 320), ('bgr8', 121, 161), ('rgb8', 64, 95)])
def test_images_of_any_encoding_and_size_are_shown_at_once(encoding, height, width) -> None:
    encoder, receiver = VideoEncoder(height, width, encoding, 6000, ROOM, 10), Receiver(encoding, height, width)
    for image in scene(12, height, width):
        pixels = image if encoding == 'mono8' else np.dstack([image, 255 - image, image // 2])
        coded = encoder.encode(pixels, 6000)
        assert max(map(len, coded.slices)) <= ROOM and coded.size <= 1.1 * 6000
        shown = receiver.show(coded, coded.slices)
        assert shown.shape == pixels.shape
    assert psnr(shown, pixels) > (35 if encoding == 'mono8' else 28)


def test_slices_and_parameter_sets_are_what_a_receiver_accepts() -> None:
    encoder = VideoEncoder(HEIGHT, WIDTH, 'mono8', 8000, ROOM, 10)
    for number, pixels in enumerate(scene(20)):
        coded = encoder.encode(pixels, 8000, intra=number == 17)
        sets = parameter_sets.parse(coded.parameter_sets)
        headers = [slice_header.parse(unit, sets) for unit in coded.slices]
        assert (sets.height, sets.width, sets.is_grey) == (HEIGHT, WIDTH, True)
        assert len(coded.slices) > 5 and {header.frame_num for header in headers} == {(number % 17) % 16}
        assert coded.intra == (number in (0, 17)) == headers[0].is_idr
        assert [header.first for header in headers] == sorted({header.first for header in headers})
        assert coded.qp == pytest.approx(np.mean([header.qp for header in headers]))


def test_the_size_follows_down_to_a_third_and_back() -> None:
    encoder, sizes = VideoEncoder(HEIGHT, WIDTH, 'mono8', 9000, ROOM, 10), []
    for number, pixels in enumerate(scene(90)):
        sizes.append(encoder.encode(pixels, 3000 if 30 <= number < 60 else 9000).size)
    assert max(sizes) <= 1.1 * 9000
    high, low, again = (float(np.mean(sizes[end - 20:end])) for end in (30, 60, 90))
    assert 0.75 * 9000 < high < 9000 and 0.75 * 9000 < again < 9000
    assert 0.5 * 3000 < low < 1.1 * 3000


def test_the_size_follows_from_the_first_image_on() -> None:
    encoder = VideoEncoder(HEIGHT, WIDTH, 'mono8', 9000, ROOM, 10)
    sizes = [encoder.encode(pixels, 4000 if number < 10 else 9000).size for number, pixels in enumerate(scene(40))]
    assert np.mean(sizes[5:10]) < 4500 and np.mean(sizes[20:]) > 0.75 * 9000


def test_parameter_sets_are_the_same_for_all_sizes_and_refresh_cycles() -> None:
    pixels = scene(1)[0]
    assert len({VideoEncoder(HEIGHT, WIDTH, 'mono8', size, ROOM, refresh).encode(pixels, size).parameter_sets
                for size in (500, 5000, 200000) for refresh in (5, 10)}) == 1


def test_noise_fits_in_the_room() -> None:
    encoder = VideoEncoder(48, 64, 'bgr8', 100000, LEAST_ROOM, 10)
    random = np.random.RandomState(2)
    for number in range(6):
        noise = random.randint(0, 256, (48, 64, 3))
        coded = encoder.encode(((noise > 127) * 255 if number % 2 else noise).astype(np.uint8), 100000)
        assert max(map(len, coded.slices)) <= LEAST_ROOM


def test_what_was_lost_is_mended_by_the_refresh() -> None:
    encoder, receiver, quality = VideoEncoder(HEIGHT, WIDTH, 'mono8', 6000, ROOM, 5), Receiver(), []
    for number, pixels in enumerate(scene(30)):
        coded = encoder.encode(pixels, 6000)
        slices = coded.slices[::2] if number == 15 else coded.slices
        quality.append(psnr(receiver.show(coded, slices), pixels))
    assert quality[15] < quality[14] - 3
    assert quality[25] > quality[14] - 1


@pytest.mark.parametrize('lost', [(16,), (15, 16, 17), (20,), (20, 21), tuple(range(10, 28))])
def test_images_that_are_lost_are_replaced_and_none_is_missed_after(lost) -> None:
    """The one at which frame_num wraps is 16; 20 is an intra image, after which it begins anew."""
    encoder, receiver, last = VideoEncoder(HEIGHT, WIDTH, 'mono8', 6000, ROOM, 10), Receiver(), -1
    shown = None
    for number, pixels in enumerate(scene(40)):
        coded = encoder.encode(pixels, 6000, intra=number == 20)
        if number in lost:
            continue
        sets = parameter_sets.parse(coded.parameter_sets)
        header = slice_header.parse(coded.slices[0], sets)
        while not header.is_idr and (last + 1) % 16 != header.frame_num:
            last = (last + 1) % 16
            repeated = receiver.show(coded, [slice_header.lost_slice(sets, last)])
            assert np.array_equal(repeated, shown)
        last, shown = header.frame_num, receiver.show(coded, coded.slices)
    assert psnr(shown, pixels) > 30


@pytest.mark.parametrize('size, room, refresh', [(6000, LEAST_ROOM - 1, 10), (99, ROOM, 10), (6000, ROOM, 0)])
def test_an_encoder_that_cannot_be(size, room, refresh) -> None:
    with pytest.raises(ValueError, match='out of range'):
        VideoEncoder(HEIGHT, WIDTH, 'mono8', size, room, refresh)


def test_images_without_planes() -> None:
    with pytest.raises(ValueError, match="'16UC1' has no planes"):
        VideoEncoder(HEIGHT, WIDTH, '16UC1', 6000, ROOM, 10)
