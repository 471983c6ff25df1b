# SPDX-License-Identifier: BSD-3-Clause
"""What is decoded of video of which slices and images are missing: by libavcodec itself, in this process."""
from typing import Any, List, Optional

import numpy as np
import pytest
from video_scene import ROOM, image, psnr, requests, video

from smokebot_udp.codecs.video import nal
from smokebot_udp.codecs.video.decoder import Decoder, Picture
from smokebot_udp.codecs.video.decoder_request import Request
from smokebot_udp.codecs.video.encoder import VideoEncoder

HEIGHT, WIDTH = 96, 176
STREAM = requests(video(60, HEIGHT, WIDTH), HEIGHT, WIDTH)


def luma(picture: Optional[Picture], height: int = HEIGHT, width: int = WIDTH) -> Any:
    """(height, width) uint8"""
    assert picture is not None
    return np.frombuffer(picture.planes[0], np.uint8).reshape(picture.height, -1)[:height, :width].copy()


def decode(wanted: List[Request]) -> List[Any]:
    decoder = Decoder()
    return [luma(decoder.decode(request)) for request in wanted]


def without(number: int, stream: Any = STREAM) -> List[Request]:
    """The stream without an image of which nothing arrived."""
    return [*stream[:number], *stream[number + 1:]]


def test_each_image_comes_at_once_and_resembles_the_scene() -> None:
    for number, shown in enumerate(decode(STREAM)):
        assert psnr(shown, image(number, HEIGHT, WIDTH)) > 38


@pytest.mark.parametrize('height, width', [(96, 176), (95, 175), (17, 33)])
def test_colour_has_three_planes_of_even_sides(height: int, width: int) -> None:
    asked, = requests(video(1, height, width, True), height, width, True)
    picture = Decoder().decode(asked)
    assert picture is not None and (picture.height, picture.width) == (height + height % 2, width + width % 2)
    assert [len(plane) for plane in picture.planes] == [
        line * rows for line, rows in zip(picture.lines, (picture.height, *2 * [picture.height // 2]))]


def test_a_lost_slice_is_taken_from_the_image_before_at_the_same_place() -> None:
    first, second = STREAM[0], STREAM[1]._replace(slices=STREAM[1].slices[1:])
    before, shown = decode([first, second])
    whole = decode(STREAM[:2])[1]
    # the second slice begins in the second column of the last macroblocks
    from_before, as_sent = ((shown == other)[:, 32:].all(axis=1) for other in (before, whole))
    assert from_before[:8].all() and as_sent[-8:].all()
    assert not from_before.all() and not as_sent.all()


def bottom_of_another_view(refresh: int, top: int) -> List[Any]:
    """What is shown of an image, and of the next one where only its bottom arrives, which is not predicted.

    :param top: from this line on it is a ramp: that is best predicted from its own image
    """
    height, width = 240, 320
    after = image(1, height, width)
    after[top:] = np.linspace(20, 230, width)
    encoder = VideoEncoder(height, width, 'mono8', 8000, ROOM, refresh)
    first, second = requests([encoder.encode(pixels, 8000) for pixels in (image(0, height, width), after)],
                             height, width)
    decoder = Decoder()
    return [luma(decoder.decode(asked), height, width)
            for asked in (first, second._replace(slices=second.slices[-1:]))]


def test_so_it_is_where_most_of_what_arrived_is_not_predicted() -> None:
    # libavcodec then thinks of another scene, and smears the border of what arrived over all that is missing
    before, shown = bottom_of_another_view(10, 128)
    assert np.array_equal(shown[:64], before[:64])


def test_that_is_right_where_no_image_is_predicted() -> None:
    before, shown = bottom_of_another_view(1, 128)
    assert not np.array_equal(shown[:64], before[:64])


def test_a_lost_beginning_of_predicted_images_keeps_the_one_before() -> None:
    encoders = [VideoEncoder(HEIGHT, WIDTH, 'mono8', 6000, ROOM, refresh) for refresh in (1, 10)]
    each, predicted = (requests([encoder.encode(image(number, HEIGHT, WIDTH), 6000) for number in range(20)],
                                HEIGHT, WIDTH) for encoder in encoders)
    shown = decode([*each[:2], *predicted[1:]])
    assert psnr(shown[2], shown[1]) > 20
    assert psnr(shown[-1], image(19, HEIGHT, WIDTH)) > 38


@pytest.mark.parametrize('number', range(12, 30))
def test_after_any_lost_image_the_next_ones_come_at_once(number: int) -> None:
    # frame_num wraps at 16: without a slice in place of the lost image libavcodec is silent for 14 images after it
    shown = decode(without(number))
    assert len(shown) == 59 and psnr(shown[-1], image(59, HEIGHT, WIDTH)) > 38


def test_the_image_before_stands_in_for_a_lost_one() -> None:
    # of three images the second is lost, and of the third all but its last slice
    first, shown = decode([STREAM[0], STREAM[2]._replace(slices=STREAM[2].slices[-1:])])
    assert (shown == first).all(axis=1)[:HEIGHT // 2].all() and (shown != first).any()


@pytest.mark.parametrize('count', [1, 14, 15, 17, 31, 40])
def test_after_any_number_of_lost_images_the_next_ones_are_predicted_from_the_last_one(count: int) -> None:
    shown = decode([*STREAM[:3], STREAM[3 + count]._replace(slices=STREAM[3 + count].slices[-1:]), *STREAM[4 + count:]])
    assert (shown[3] == shown[2]).all(axis=1)[:HEIGHT // 2].all()
    assert len(shown) == len(STREAM) - count and psnr(shown[-1], image(59, HEIGHT, WIDTH)) > 38


def test_a_lost_idr_image_keeps_the_old_one() -> None:
    """An encoder that is opened anew begins with an IDR image, and frame_num with 0."""
    anew = requests(video(40, HEIGHT, WIDTH), HEIGHT, WIDTH)
    shown = decode([*STREAM[:10], *anew[1:]])
    assert len(shown) == 49 and psnr(shown[-1], image(39, HEIGHT, WIDTH)) > 38


def test_a_decoder_that_begins_in_the_middle_recovers_within_two_refreshes() -> None:
    shown = decode(STREAM[5:])
    assert psnr(shown[0], image(5, HEIGHT, WIDTH)) < 30
    assert all(psnr(each, image(number, HEIGHT, WIDTH)) > 38 for number, each in enumerate(shown[20:], 25))


def test_another_session_begins_anew() -> None:
    decoder = Decoder()
    decoder.decode(STREAM[0])
    other = luma(decoder.decode(STREAM[1]._replace(session=8)))
    assert (other == luma(Decoder().decode(STREAM[1]))).all()


def test_parameter_sets_are_kept() -> None:
    shown = decode([STREAM[0], *(request._replace(parameter_sets=b'') for request in STREAM[1:10])])
    assert all((a == b).all() for a, b in zip(shown, decode(STREAM[:10])))


def test_nothing_comes_of_an_image_without_parameter_sets_or_slices() -> None:
    decoder, first = Decoder(), STREAM[0]
    sets = nal.split(first.parameter_sets)
    for request in (first._replace(parameter_sets=b''), first._replace(slices=[]), first._replace(slices=sets),
                    first._replace(slices=[b'\x65']), first._replace(slices=[b'\x65' + bytes(50)])):
        assert decoder.decode(request) is None
    assert psnr(luma(decoder.decode(first)), image(0, HEIGHT, WIDTH)) > 35


@pytest.mark.parametrize('change', [
    {'height': HEIGHT - 2}, {'height': HEIGHT + 1}, {'width': WIDTH + 16}, {'parameter_sets': b'?'},
    {'parameter_sets': STREAM[0].parameter_sets * 2}])
def test_another_size_than_announced_and_bad_parameter_sets_are_refused(change: Any) -> None:
    decoder = Decoder()
    with pytest.raises(ValueError):
        decoder.decode(STREAM[0]._replace(**change))
    assert psnr(luma(decoder.decode(STREAM[0])), image(0, HEIGHT, WIDTH)) > 35


def test_parameter_sets_among_the_slices_change_nothing() -> None:
    # as a forger would who cannot pass the check of the parameter sets
    other = nal.split(video(1, 48, 64)[0].parameter_sets)
    decoder = Decoder()
    decoder.decode(STREAM[0])
    shown = luma(decoder.decode(STREAM[1]._replace(slices=[*other, *STREAM[1].slices])))
    assert (shown == decode(STREAM[:2])[1]).all()


def test_the_self_test_passes() -> None:
    Decoder().test()
