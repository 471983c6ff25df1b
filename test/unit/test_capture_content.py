# SPDX-License-Identifier: BSD-3-Clause
"""Originals as bytes: exact, and checked before use."""
from typing import Any

import numpy as np
import pytest
from genpy import Time
from geometry_msgs.msg import TransformStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import Image, PointCloud2, PointField

from smokebot_udp.capture.content import MAX_DATA, WHOLE, Refused, cropped, pack, refusal, unpack
from smokebot_udp.codecs.wire.pixels import ENCODINGS
from smokebot_udp.serialised import serialised


def image(encoding: str = 'mono16', height: int = 5, width: int = 7, padding: int = 0, bigendian: bool = False) -> Any:
    kind, channels = ENCODINGS[encoding]
    step = width * channels * np.dtype(kind).itemsize + padding
    data = np.random.RandomState(1).bytes(height * step)
    message = Image(height=height, width=width, encoding=encoding, step=step, is_bigendian=bigendian, data=data)
    message.header.stamp, message.header.frame_id = Time(12, 34), 'thermal'
    return message


def cloud(points: int = 100, step: int = 22) -> Any:
    fields = [PointField(name, 4 * place, PointField.FLOAT32, 1) for place, name in enumerate('xyz')]
    data = np.random.RandomState(2).bytes(points * step)
    message = PointCloud2(height=1, width=points, point_step=step, row_step=points * step, fields=fields, data=data)
    message.header.stamp = Time(3, 4)
    return message


@pytest.mark.parametrize('bigendian', [False, True])
@pytest.mark.parametrize('encoding', sorted(ENCODINGS))
def test_images_of_all_encodings_cross_exactly(encoding: str, bigendian: bool) -> None:
    message = image(encoding, bigendian=bigendian)
    assert serialised(unpack(pack(message, None, False), Image).message) == serialised(message)


@pytest.mark.parametrize('encoding', ['mono8', 'mono16', 'bgr8', 'rgb8', 'bgra8', '32FC1'])
def test_layered_images_cross_exactly(encoding: str) -> None:
    pytest.importorskip('numba')
    message = image(encoding, 33, 41)
    assert serialised(unpack(pack(message, None, True), Image).message) == serialised(message)


def test_smooth_images_become_shorter() -> None:
    message = image('mono16', 100, 100)
    message.data = np.add.outer(np.arange(100), np.arange(100)).astype('<u2').tobytes()
    content = pack(message, None, False)
    assert len(content) < 1000
    assert unpack(content, Image).message.data == message.data


def test_clouds_cross_exactly_also_where_their_rows_are_odd() -> None:
    for message in (cloud(), cloud(0), cloud(3)):
        assert serialised(unpack(pack(message, None, True), PointCloud2).message) == serialised(message)
    odd = cloud(3)
    odd.row_step, odd.data = 67, odd.data + b'x'
    assert unpack(pack(odd, None, False), PointCloud2).message.data == odd.data


@pytest.mark.parametrize('step', [65535, 65536, 200000])
def test_clouds_of_long_points_cross_exactly(step: int) -> None:
    message = cloud(3, step)
    assert serialised(unpack(pack(message, None, False), PointCloud2).message) == serialised(message)


def test_a_cloud_that_contradicts_its_data_is_refused_by_the_robot() -> None:
    message = cloud(3)
    message.height = 2
    with pytest.raises(ValueError, match='its data have 66 bytes, height x row_step is 2 x 66'):
        pack(message, None, False)


def test_the_pose_crosses_with_it() -> None:
    pose = TransformStamped(child_frame_id='thermal')
    pose.transform.translation.x = 1.5
    assert unpack(pack(image(), pose, False), Image).pose == pose
    assert unpack(pack(image(), None, False), Image).pose is None


def test_a_region_has_its_pixels_without_padding() -> None:
    message = image('mono8', 4, 6, padding=2)
    pixels = np.frombuffer(message.data, np.uint8).reshape(4, 8)[:, :6]
    found = cropped(message, (1, 2, 3, 2))
    assert (found.width, found.height, found.step, found.header) == (3, 2, 3, message.header)
    assert found.data == pixels[2:4, 1:4].tobytes()
    assert cropped(message, (1, 2, 0, 0)).data == pixels[2:, 1:].tobytes()
    assert cropped(message, WHOLE).data == pixels.tobytes()
    assert message.width == 6       # the original is not changed


@pytest.mark.parametrize('region', [(0, 0, 8, 1), (7, 0, 1, 1), (7, 0, 0, 0), (0, 3, 1, 3), (0, 99, 0, 0)])
def test_a_region_outside_is_refused(region: Any) -> None:
    with pytest.raises(ValueError, match='is not in the image of 7 x 5'):
        cropped(image(), region)


def test_a_region_of_a_mosaic_keeps_its_pattern() -> None:
    mosaic = image('mono8', 4, 6)
    mosaic.encoding = 'bayer_rggb8'
    assert cropped(mosaic, (2, 2, 3, 1)).encoding == 'bayer_rggb8'
    for x, y in ((1, 2), (2, 1)):
        with pytest.raises(ValueError, match='must begin at even places'):
            cropped(mosaic, (x, y, 2, 2))


def test_rows_that_are_too_short_for_their_points_are_refused() -> None:
    """The robot's checksum proves nothing: who reads such a cloud would read beyond its data."""
    message = cloud(3)
    message.point_step = 23
    with pytest.raises(ValueError, match='3 points of 23 bytes do not fit'):
        unpack(pack(message, None, False), PointCloud2)


def test_a_cloud_of_too_many_fields_is_refused() -> None:
    message = cloud(3)
    message.fields = [PointField('field%d' % number, 0, PointField.UINT8, 1) for number in range(4000)]
    with pytest.raises(ValueError, match='at most 65535 can cross'):
        pack(message, None, False)


def test_a_cloud_has_no_regions() -> None:
    assert cropped(cloud(), WHOLE).width == 100
    with pytest.raises(ValueError, match='region is of an image'):
        cropped(cloud(), (0, 0, 1, 1))


def test_what_is_too_large_is_refused() -> None:
    message = cloud()
    message.data = bytes(MAX_DATA + 1)
    with pytest.raises(ValueError, match='at most'):
        pack(message, None, False)


def test_a_refusal_says_why() -> None:
    with pytest.raises(Refused, match='no such stream'):
        unpack(refusal('no such stream'), Image)
    assert len(refusal('x' * 5000)) < 1100


CONTENTS = [(pack(image(), None, False), Image), (pack(image('32FC1'), TransformStamped(), False), Image),
            (pack(cloud(), None, False), PointCloud2)]


@settings(deadline=None)
@given(st.sampled_from(CONTENTS), st.data())
def test_a_changed_content_is_never_taken(case: Any, data: Any) -> None:
    content, class_ = case
    place, bit = data.draw(st.integers(0, len(content) - 1)), data.draw(st.integers(0, 7))
    changed = bytearray(content)
    changed[place] ^= 1 << bit
    original = serialised(unpack(content, class_).message)
    try:
        found = unpack(bytes(changed), class_).message
    except (ValueError, Refused):
        return
    assert serialised(found) == original     # a bit that zlib does not use, or of the pose


@given(st.binary(max_size=200), st.sampled_from([Image, PointCloud2]))
def test_hostile_bytes_are_refused(content: bytes, class_: Any) -> None:
    with pytest.raises((ValueError, Refused)):
        unpack(content, class_)


def test_the_wrong_type_is_refused() -> None:
    with pytest.raises(ValueError):
        unpack(pack(cloud(), None, False), Image)


def test_a_bomb_is_not_decompressed() -> None:
    import zlib
    message = image('mono8', 2, 2)
    content = pack(message, None, False)
    end = len(content) - len(zlib.compress(bytes(4)))
    bomb = content[:end] + zlib.compress(bytes(1 << 26), 9)
    with pytest.raises(ValueError):
        unpack(bomb, Image)


def test_announced_sizes_are_checked_before_memory_is_taken() -> None:
    import hashlib
    import struct
    message = image('mono8', 1, 1)
    message.height, message.width, message.step, message.data = 1 << 20, 1 << 20, 1 << 20, b''
    head = serialised(message)
    content = struct.pack('<B32sBHH', 1, hashlib.sha256(b'').digest(), 0, len(head), 0) + head
    with pytest.raises(ValueError, match='at most'):
        unpack(content, Image)
