# SPDX-License-Identifier: BSD-3-Clause
from typing import Any, List, Optional

import numpy as np
import pytest
from genpy import Time
from sensor_msgs.msg import Image

from evaluation.linked_encoder import LinkedEncoder
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import ImageSegment
from smokebot_udp.streams.image.encoder import ImageEncoder
from smokebot_udp.udpros.datagram import OVERHEAD
from smokebot_udp.udpros.endpoints import IP_UDP_HEADERS

DATAGRAM = 1472


def image(pixels: Any, seconds: int = 1, encoding: str = 'mono16') -> Any:
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding, step=pixels.strides[0],
                    data=pixels.tobytes())
    message.header.stamp, message.header.frame_id = Time(seconds, 7), 'lens'
    return message


def noise(seed: int = 0) -> Any:
    return np.random.RandomState(seed).randint(0, 65536, (120, 160)).astype(np.uint16)


def settings(granted: Optional[dict] = None, **changes: Any) -> Settings:
    return Settings(check({'robot_topic': '/in', 'coding': 'interleaved', **changes}, ImageEncoder.PARAMETERS),
                    granted or {})


def encoded(message: Any, of: Optional[Settings] = None, size: int = DATAGRAM) -> List[Any]:
    of = of or settings()
    return LinkedEncoder(ImageEncoder(of.requested)).encode(message, of, size)


def segments(frames: List[Any]) -> List[Any]:
    return [ImageSegment().deserialize(row[OVERHEAD:].tobytes()) for frame in frames for row in frame.rows]


@pytest.mark.parametrize('coding, asked', [('auto', 1), ('layered', 1), ('h264', 1), ('interleaved', 0)])
def test_the_codec_is_loaded_before_the_first_operator_comes(coding: str, asked: int) -> None:
    looks = []

    class Loading:
        def ready(self) -> bool:
            looks.append(coding)
            return False

    ImageEncoder(settings(coding=coding).requested, Loading())
    assert len(looks) == asked


def test_a_small_image_by_hand() -> None:
    """Depth 0: one subimage, which is the image."""
    segment, = segments(encoded(image(np.array([[1, 2], [3, 4]], np.uint8), encoding='mono8')))
    assert (segment.height, segment.width, segment.encoding, segment.is_bigendian) == (2, 2, 'mono8', 0)
    assert (segment.depth, segment.index, segment.count, segment.total) == (0, 0, 1, 1)
    assert segment.data == bytes([1, 2, 3, 4])
    assert (segment.header.frame_id, segment.header.stamp) == ('lens', Time(1, 7))


@pytest.mark.parametrize('size', [256, 576, DATAGRAM])
def test_all_subimages_are_sent_once_and_fit(size: int) -> None:
    frames = encoded(image(noise()), size=size)
    assert all(frame.datagram_size <= size for frame in frames)
    assert sum(segment.count for segment in segments(frames)) == segments(frames)[0].total


def test_an_image_that_is_leaving_is_not_touched_by_the_next_one() -> None:
    encoder = LinkedEncoder(ImageEncoder(settings().requested))
    leaving = encoder.encode(image(noise(1)), settings(), DATAGRAM)
    before = [frame.rows.copy() for frame in leaving]
    encoder.encode(image(noise(2), 2), settings(), DATAGRAM)
    assert all((frame.rows == rows).all() for frame, rows in zip(leaving, before))


def test_coarse_subimages_come_first_and_a_grant_leaves_some_out() -> None:
    whole = segments(encoded(image(noise())))
    few = segments(encoded(image(noise()), settings({'max_subimages': 5})))
    assert sum(segment.count for segment in few) == few[0].total == 5
    assert few[0].index == whole[0].index and few[0].data == whole[0].data[:len(few[0].data)]


def test_a_reduced_image() -> None:
    segment, = segments(encoded(image(np.array([[1, 3], [5, 7]], np.uint8), encoding='mono8'), settings(scale=2)))
    assert (segment.height, segment.width, segment.data) == (1, 1, bytes([4]))


def test_what_is_wrong_is_named() -> None:
    message = image(noise())
    message.encoding = 'rgb99'
    with pytest.raises(ValueError, match='rgb99'):
        encoded(message)


def test_operating_points_are_of_the_requested_image() -> None:
    of = settings({'max_subimages': 5, 'rate': 2.0}, rate=8.0)
    encoder = LinkedEncoder(ImageEncoder(of.requested))
    assert encoder.operating_points(8.0, of) == []
    encoder.encode(image(noise()), of, DATAGRAM)
    best = encoder.operating_points(8.0, of)[-1]
    frames = encoded(image(noise()))
    datagrams, largest = sum(map(len, frames)), frames[0].datagram_size + IP_UDP_HEADERS
    assert best.settings == {'max_subimages': 0, 'rate': 8.0}
    assert best.cost == pytest.approx(8.0 * datagrams * largest, rel=0.1)


def test_what_is_left_over_makes_more_subimages_up_to_all() -> None:
    encoder, point = LinkedEncoder(ImageEncoder(settings().requested)), {'max_subimages': 1, 'rate': 2.0}
    assert encoder.refine(point, 1e9) == point      # nothing is known yet
    frames = encoder.encode(image(noise()), settings(), 256)
    first = frames[0]
    size, per_segment = first.datagram_size + IP_UDP_HEADERS, segments(frames)[0].count
    assert encoder.refine(point, 2.0 * size * 2.5) == {'max_subimages': 1 + 2 * per_segment, 'rate': 2.0}
    assert encoder.refine(point, 1e9) == {'rate': 2.0}


def test_a_grant_of_fewer_images_does_not_lift_the_requested_number_of_subimages() -> None:
    of = settings(max_subimages=2, degradation_preference=0.0)
    encoder = LinkedEncoder(ImageEncoder(of.requested))
    encoder.encode(image(noise()), of, DATAGRAM)
    point = encoder.operating_points(10.0, of)[-2]
    assert point.settings['rate'] < 10.0
    granted = Settings(of.requested, encoder.refine(point.settings, 0.0))
    assert granted['max_subimages'] == 2
    assert segments(encoder.encode(image(noise(), 2), granted, DATAGRAM))[0].total == 2
