# SPDX-License-Identifier: BSD-3-Clause
"""The images from which others are predicted: what is kept, and what exactly their layers restore."""
import zlib
from typing import Any

import needs_numba  # noqa: F401
import numpy as np
import pytest
from layered_operator import scene

from smokebot_udp.codecs.layered.image import encode
from smokebot_udp.codecs.layered.pieces import GROUP, Layer
from smokebot_udp.streams.image.pixel_layers import CodedShape, shape_of
from smokebot_udp.streams.image.references import (
    LEAST_PICTURES,
    MAX_BYTES,
    MAX_PICTURES,
    CodedImage,
    References,
    checksum_of,
    ends_of,
    split_motion,
    with_motion,
)

SHAPE = CodedShape(48, 64, 1, 2)
PIXELS = scene()
STREAM = encode(PIXELS, True, 1 << 20)
DATA = STREAM.data


def coded(shape: CodedShape = SHAPE) -> CodedImage:
    return CodedImage(shape, STREAM.prefixes, (60, 360, len(DATA)))


@pytest.mark.parametrize('layers, end', [(1, 60), (2, 360), (3, len(DATA))])
def test_a_reference_is_what_exactly_its_layers_restore(layers: int, end: int) -> None:
    image = coded()
    for again in (1, layers, 2, layers):
        reference = image.reference(again)
    expected: Any = STREAM.prefixes.pixels(end)
    assert reference is not None and (reference.pixels == expected).all()
    assert reference.checksum == zlib.crc32(expected.astype('<u2').tobytes())
    assert (reference.pixels == PIXELS).all() == (layers == 3)


def test_layers_that_are_not_known_or_restore_nothing_are_no_reference() -> None:
    assert coded().reference(0) is None and coded().reference(4) is None
    motion_only = CodedImage(SHAPE, STREAM.prefixes, (-5, 0, 7, 60))
    assert [motion_only.reference(layers) is None for layers in (1, 2, 3, 4)] == [True, True, True, False]


def test_the_checksum_is_that_of_little_endian_rows() -> None:
    pixels = np.array([[1, 2], [3, 0x405]])
    expected = zlib.crc32(b'\1\0\2\0\3\0\5\4')
    for dtype in ('<u2', '>u2'):
        assert checksum_of(pixels.astype(dtype)) == expected == checksum_of(np.asfortranarray(pixels.astype(dtype)))
    assert checksum_of(pixels.astype(np.uint8)) == zlib.crc32(b'\1\2\3\5')


def test_the_newest_images_are_kept_fewer_of_large_ones() -> None:
    references = References()
    for number in range(MAX_PICTURES + 3):
        references.add((7, number), coded())
    references.add((7, 4), coded())     # again: it is the newest
    assert references.layers(7) == dict.fromkeys(range(3, MAX_PICTURES + 3), 3)
    assert references.layers(8) == {} and 4 in references.layers(7) and 2 not in references.layers(7)
    references.add((8, 0), coded(CodedShape(2048, 2048, 1, 2)))
    assert len(references.layers(7)) + 1 == MAX_BYTES // (2048 * 2048 * 2)
    references.add((8, 1), coded(CodedShape(1 << 20, 1 << 10, 1, 2)))
    assert len(references.layers(7)) + len(references.layers(8)) == LEAST_PICTURES
    references.forget_before((8, 1))
    assert references.layers(8) == {1: 3} and references.layers(7)
    references.clear()
    assert references.layers(8) == {}


def test_an_image_of_another_shape_is_no_reference() -> None:
    references = References()
    references.add((7, 1), coded())
    assert references.get((7, 1), 3, SHAPE) is not None and shape_of(PIXELS) == SHAPE
    for key, layers, shape in (((7, 2), 3, SHAPE), ((8, 1), 3, SHAPE), ((7, 1), 3, CodedShape(48, 64, 1, 1))):
        assert references.get(key, layers, shape) is None


def test_the_motion_is_in_front_of_the_stream() -> None:
    assert with_motion(b'', b'abc') == b'\0abc' and with_motion(b'xy', b'abc') == b'\2xyabc'
    for motion in (b'', b'xy', bytes(255)):
        whole = with_motion(motion, b'abc')
        assert split_motion(whole) == (motion, b'abc')
        assert [split_motion(whole[:end]) for end in range(1 + len(motion))] == [None] * (1 + len(motion))


def test_layers_end_where_their_parts_do() -> None:
    assert ends_of([Layer(1, 60), Layer(4, 75), Layer(9, 10)], 12) == (60, 360, 450)
    assert ends_of([Layer(1, 60), Layer(200, 3)], 2 * GROUP) == (60, 60 + 2 * 600)
