# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from smokebot_udp.codecs.wire.pixels import ENCODINGS, as_items, as_pixels, item_type, reduce_by, row_length


@pytest.mark.parametrize('encoding, size', [('mono8', 1), ('8UC1', 1), ('mono16', 2), ('16UC1', 2), ('bgr8', 3),
                                            ('rgb8', 3), ('bgra8', 4), ('rgba8', 4), ('32FC1', 4)])
def test_size_of_a_pixel(encoding, size) -> None:
    assert item_type(encoding).itemsize == size


def test_padded_rows() -> None:
    data = bytes([1, 2, 0xee, 0xee, 3, 4, 0xee, 0xee])
    assert as_pixels(data, 2, 2, 4, 'mono8', 0).tolist() == [[1, 2], [3, 4]]
    assert as_items(data, 2, 1, 4, '16UC1').tobytes() == bytes([1, 2, 3, 4])


def test_byte_order() -> None:
    assert as_pixels(b'\x01\x02', 1, 1, 2, 'mono16', 1).tolist() == [[0x0102]]
    assert as_pixels(b'\x01\x02', 1, 1, 2, 'mono16', 0).tolist() == [[0x0201]]


def test_channels_and_no_copy() -> None:
    data = bytes(range(24))
    pixels = as_pixels(data, 2, 3, 12, 'bgr8', 0)
    assert pixels.shape == (2, 3, 3) and pixels[1, 2].tolist() == [18, 19, 20]
    assert np.shares_memory(pixels, np.frombuffer(data, np.uint8))


@pytest.mark.parametrize('encoding', sorted(ENCODINGS))
@pytest.mark.parametrize('pad', [0, 5])
def test_items_hold_the_sources_bytes(encoding, pad) -> None:
    size = item_type(encoding).itemsize
    step = 7 * size + pad
    data = np.random.RandomState(3).bytes(5 * step)
    rows = np.frombuffer(data, np.uint8).reshape(5, step)[:, :7 * size]
    assert as_items(data, 5, 7, step, encoding).tobytes() == rows.tobytes()


@pytest.mark.parametrize('change, message', [
    ({'encoding': 'nv21'}, "encoding is 'nv21'"),
    ({'data': b'123'}, 'data has 3 bytes, height x step is 2 x 2'),
    ({'data': b'123', 'step': 1}, 'data has 3 bytes, height x step is 2 x 1; a row of 2 pixels mono8 has 2 bytes'),
    ({'data': b'12345', 'step': 1}, 'data has 5 bytes'),
    ({'data': b'123456', 'step': 5}, 'data has 6 bytes'),
    ({'height': 0}, 'height is 0'),
    ({'width': 0}, 'width is 0'),
    ({'width': 5000, 'step': 5000}, 'width is 5000')])
def test_bad_images(change, message) -> None:
    image = dict({'data': b'1234', 'height': 2, 'width': 2, 'step': 2, 'encoding': 'mono8'}, **change)
    with pytest.raises(ValueError, match=message):
        as_items(**image)
    with pytest.raises(ValueError, match=message):
        as_pixels(is_bigendian=0, **image)


@pytest.mark.parametrize('step', [0, 1, 4, 2 ** 32 - 1])
def test_a_step_that_contradicts_the_data_is_not_used(step) -> None:
    assert row_length(b'1234', 2, 2, step, 'mono8') == 2
    assert as_pixels(b'1234', 2, 2, step, 'mono8', 0).tolist() == as_items(b'1234', 2, 2, step, 'mono8').tolist()
    assert as_pixels(b'1234', 2, 2, step, 'mono8', 0).tobytes() == b'1234'


def test_rows_may_be_padded_the_last_one_need_not() -> None:
    for data in b'12..34..', b'12..34', b'12..34..more':
        assert as_pixels(data, 2, 2, 4, 'mono8', 0).tobytes() == b'1234'


def test_reduced_to_the_mean_of_each_block() -> None:
    grey = np.array([[1, 3, 10], [5, 7, 20]], np.uint8)
    assert reduce_by(grey, 2).tolist() == [[4, 15]]      # the border repeats: (10 + 10 + 20 + 20) / 4
    colour = np.repeat(grey[:, :2, np.newaxis], 3, axis=2)
    assert reduce_by(colour, 2).tobytes() == bytes([4, 4, 4])


@pytest.mark.parametrize('order', ['<', '>'])
def test_reduced_in_its_own_byte_order(order) -> None:
    pixels = np.array([[1000, 3000], [5000, 7000]], order + 'u2')
    assert reduce_by(pixels, 2).tobytes() == np.array([4000], order + 'u2').tobytes()
