# SPDX-License-Identifier: BSD-3-Clause
"""Compressed images as image_transport writes them, and what looks like one."""
import math
import struct
import zlib
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.compressed import DEPTH, announced_size, decode, encode


def smooth(channels: int = 3) -> Any:
    """(48, 64, 3) or (48, 64) uint8: blue, green and red differ clearly."""
    rows, columns = np.mgrid[:48, :64]
    colours = np.dstack([200 + 0 * rows, 2 * rows, 3 * columns // 2 + 10]).astype(np.uint8)
    return colours if channels == 3 else colours[..., 1].copy()


def jpeg(pixels: Any, *options: int) -> bytes:
    return bytes(cv2.imencode('.jpg', pixels, list(options))[1].tobytes())


def png(pixels: Any) -> bytes:
    return bytes(cv2.imencode('.png', pixels)[1].tobytes())


@pytest.mark.parametrize('description, encoding', [
    ('jpeg', 'bgr8'), ('jpg', 'bgr8'), ('rgb8; jpeg compressed bgr8', 'bgr8'), ('bgr8; jpeg compressed bgr8', 'bgr8'),
    ('yuv422; jpeg compressed bgr8', 'bgr8'), ('bgr8; jpeg compressed', 'bgr8'),
    # it was compressed in its own order: what OpenCV calls blue is red
    ('rgb8; jpeg compressed ', 'rgb8'), ('rgb8; jpeg compressed rgb8', 'rgb8')])
def test_colours_have_their_order(description: str, encoding: str) -> None:
    decoded = decode(jpeg(smooth()), description)
    assert decoded.encoding == encoding
    assert np.abs(decoded.pixels.astype(int) - smooth()).mean() < 4


@pytest.mark.parametrize('description, encoding', [
    ('jpeg', 'mono8'), ('mono8; jpeg compressed ', 'mono8'), ('8UC1; jpeg compressed ', '8UC1'),
    ('bayer_rggb8; jpeg compressed ', 'bayer_rggb8'), ('bayer_rggb16; jpeg compressed ', 'mono8')])
def test_grey_images(description: str, encoding: str) -> None:
    decoded = decode(jpeg(smooth(1)), description)
    assert decoded.encoding == encoding and decoded.pixels.shape == (48, 64)
    assert np.abs(decoded.pixels.astype(int) - smooth(1)).mean() < 4


@pytest.mark.parametrize('description, encoding', [
    ('png', 'mono16'), ('mono16; png compressed ', 'mono16'), ('16UC1; png compressed ', '16UC1'),
    ('bayer_grbg16; png compressed ', 'bayer_grbg16')])
def test_sixteen_bits_are_kept(description: str, encoding: str) -> None:
    pixels = np.random.RandomState(1).randint(0, 65536, (33, 17)).astype(np.uint16)
    decoded = decode(png(pixels), description)
    assert decoded.encoding == encoding and decoded.pixels.dtype == np.uint16 and (decoded.pixels == pixels).all()


def test_alpha_is_kept() -> None:
    pixels = np.random.RandomState(1).randint(0, 256, (5, 7, 4)).astype(np.uint8)
    decoded = decode(png(pixels), 'bgra8; png compressed bgra8')
    assert decoded.encoding == 'bgra8' and (decoded.pixels == pixels).all()


def test_compressed_depth() -> None:
    counts = np.uint16([[0, 1000, 65535]])
    head = DEPTH.pack(0, 0.0, 0.0)
    assert decode(head + png(counts), '16UC1; compressedDepth png').pixels.tolist() == counts.tolist()
    # metres = a / (count - b), by hand: 3000 / (1000 + 500) = 2
    depth = decode(DEPTH.pack(0, 3000.0, -500.0) + png(counts), '32FC1; compressedDepth png')
    assert depth.encoding == '32FC1' and depth.pixels.dtype == np.float32
    assert np.isnan(depth.pixels[0, 0]) and depth.pixels[0, 1] == 2.0


@pytest.mark.parametrize('description', ['32FC1 compressedDepth png', '32FC1;compressedDepth', '32FC1 compressedDepth',
                                         ' 32FC1 ;  compressedDepth png'])
def test_compressed_depth_without_a_semicolon_is_read(description: str) -> None:
    depth = decode(DEPTH.pack(0, 3000.0, -500.0) + png(np.uint16([[0, 1000]])), description)
    assert depth.encoding == '32FC1' and depth.pixels[0, 1] == 2.0


@pytest.mark.parametrize('parameters', [(0.0, 0.0), (3000.0, -500.0)])
def test_compressed_depth_without_any_depth_is_nan(parameters: Any) -> None:
    """A sensor that sees nothing has no range to quantise."""
    depth = decode(DEPTH.pack(0, *parameters) + png(np.zeros((3, 4), np.uint16)), '32FC1; compressedDepth png')
    assert np.isnan(depth.pixels).all() and not depth.problem


def test_compressed_depth_may_be_called_mono16() -> None:
    counts = np.uint16([[0, 1000, 65535]])
    decoded = decode(DEPTH.pack(0, 0.0, 0.0) + png(counts), 'mono16; compressedDepth png')
    assert decoded.encoding == 'mono16' and decoded.pixels.tolist() == counts.tolist()


@pytest.mark.parametrize('description, channels, encoding, words', [
    ('mono16; jpeg compressed ', 1, 'mono8', '1 channel of 8 bits, which count; what was above 255 is lost'),
    ('16UC1; jpeg compressed ', 1, 'mono8', 'have to be compressed as png'),
    ('bayer_rggb16; jpeg compressed ', 1, 'mono8', 'above 255 is lost'),
    ('mono8; jpeg compressed ', 3, 'bgr8', '3 channels of 8 bits'),
    ('bgr8; jpeg compressed bgr8', 1, 'mono8', '1 channel of 8 bits, which count')])
def test_a_format_that_contradicts_the_pixels_is_told(description: str, channels: int, encoding: str, words: str
                                                      ) -> None:
    decoded = decode(jpeg(smooth(channels)), description)
    assert decoded.encoding == encoding and decoded.problem.startswith('format is %r, but' % description)
    assert words in decoded.problem


@pytest.mark.parametrize('description, channels', [
    ('jpeg', 1), ('jpeg', 3), ('jpg', 3), ('', 3), ('mono8; jpeg compressed ', 1), ('rgb16; jpeg compressed bgr8', 3),
    ('bayer_rggb8; jpeg compressed bgr8', 3), ('bayer_rggb8; jpeg compressed ', 1),
    ('mono16; jpeg compressed mono8', 1), ('yuv422; jpeg compressed bgr8', 3), ('bgra8; jpeg compressed bgr8', 3),
    ('rgb8; jpeg compressed ', 3), ('camera; jpeg', 3)])
def test_other_formats_are_not(description: str, channels: int) -> None:
    assert decode(jpeg(smooth(channels)), description).problem == ''


def test_a_png_of_sixteen_bits_called_mono8_is_told() -> None:
    decoded = decode(png(np.full((4, 4), 5000, np.uint16)), 'mono8; png compressed ')
    assert decoded.encoding == 'mono16' and '1 channel of 16 bits, which count' in decoded.problem


def bomb_png(width: int, height: int) -> bytes:
    """A PNG of few bytes that announces a size."""
    head = struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0)
    data = zlib.compress(bytes(1000))

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack('>I', len(content)) + name + content + struct.pack('>I', zlib.crc32(name + content))
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', head) + chunk(b'IDAT', data) + chunk(b'IEND', b'')


def bomb_jpeg(width: int, height: int) -> bytes:
    data = bytearray(jpeg(smooth()))
    at = data.index(b'\xff\xc0')
    data[at + 5:at + 9] = struct.pack('>HH', height, width)
    return bytes(data)


@pytest.mark.parametrize('data', [bomb_png(50000, 50000), bomb_png(4097, 1), bomb_png(0, 9), bomb_png(2 ** 31, 1),
                                  bomb_jpeg(65000, 65000), bomb_jpeg(4097, 8)])
def test_large_images_are_refused_before_they_are_decoded(data: bytes, monkeypatch: Any) -> None:
    monkeypatch.setattr(cv2, 'imdecode', None)
    with pytest.raises(ValueError, match='it announces [0-9]+ x [0-9]+ pixels, must be from 1 x 1 to 4096 x 4096'):
        decode(data, 'jpeg')


@pytest.mark.parametrize('data', [jpeg(smooth())[:-200], jpeg(smooth())[:-2], jpeg(smooth())[:30], b'\xff\xd8',
                                  png(smooth())[:-200], png(smooth())[:20], png(smooth())[:8]])
def test_truncated_images_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match='it is truncated'):
        decode(data, 'jpeg')


def test_jpegs_of_cameras() -> None:
    """With a progressive scan, with restart markers, and with zeros at the end."""
    for data in (jpeg(smooth(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1), jpeg(smooth(), cv2.IMWRITE_JPEG_RST_INTERVAL, 2),
                 jpeg(smooth()) + bytes(70)):
        assert announced_size(data) == (48, 64)
        assert np.abs(decode(data, 'jpeg').pixels.astype(int) - smooth()).mean() < 4


SEVEN = png(np.uint16([[0, 7]]))


@pytest.mark.parametrize('data, description, problem', [
    (b'', 'jpeg', "format is 'jpeg', but there are no data"), (b'', '', "format is '', but there are no data"),
    (b'', '16UC1; compressedDepth png', 'but there are no data'), (b'GIF89a', 'gif', 'neither JPEG nor PNG'),
    (bytes(99), '16UC1; compressedDepth png', 'all 99 bytes of the data are 0'),
    (bytes(99), 'rgb8; jpeg compressed bgr8', 'all 99 bytes of the data are 0'),
    (DEPTH.pack(0, 0.0, 0.0) + SEVEN, '32FC1; compressedDepth png', 'quantisation is 0 and 0'),
    (DEPTH.pack(0, math.nan, 1.0) + SEVEN, '32FC1; compressedDepth png', 'quantisation is nan and 1'),
    (DEPTH.pack(0, 1.0, math.inf) + SEVEN, '32FC1; compressedDepth png', 'quantisation is 1 and inf'),
    (DEPTH.pack(0, 3.0, 1.0) + SEVEN, 'compressedDepth png',
     "format is 'compressedDepth png', must begin with mono16, 16UC1 or 32FC1"),
    (png(np.zeros((4, 4, 3), np.uint16)), 'bgr16; png compressed bgr16', "format is 'bgr16.* with 3 channels uint16"),
    (b'12 bytes....' + png(np.zeros((4, 4), np.uint8)), '16UC1; compressedDepth png', 'not of one channel of 16 bits'),
    (b'12 bytes....RVL', '16UC1; compressedDepth rvl', 'the data are no PNG: set'),
    (b'12 bytes....RVL', 'rgb8; compressedDepth rvl', 'must begin with mono16, 16UC1 or 32FC1')])
def test_what_cannot_be_decoded_is_named(data: bytes, description: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        decode(data, description)


@given(st.sampled_from([jpeg(smooth()), png(smooth(1))]), st.lists(st.tuples(st.integers(0), st.integers(0, 255)),
                                                                   max_size=8), st.text(max_size=20))
def test_damaged_images_are_refused_or_decoded(data: bytes, changes: Any, description: str) -> None:
    damaged = bytearray(data)
    for at, value in changes:
        damaged[at % len(damaged)] = value
    try:
        decoded = decode(bytes(damaged), description)
    except ValueError:
        return
    assert decoded.pixels.size <= 4 << 24


@pytest.mark.parametrize('encoding, shape, dtype', [
    ('mono8', (48, 64), 'u1'), ('bgr8', (48, 64, 3), 'u1'), ('rgb8', (48, 64, 3), 'u1'), ('rgba8', (48, 64, 4), 'u1'),
    ('mono16', (48, 64), '<u2'), ('16UC1', (48, 64), '>u2')])
def test_what_is_compressed_is_decoded(encoding: str, shape: Any, dtype: str) -> None:
    base = smooth()
    pixels = base[..., 1] if len(shape) == 2 else np.dstack([base, base[..., 0]])[..., :shape[2]]
    pixels = pixels.astype(dtype) * (200 if dtype != 'u1' else 1)
    description, data = encode(pixels, encoding)
    decoded = decode(data, description)
    kept = encoding if len(shape) == 2 else 'bgr8'
    want = pixels if encoding[0] != 'r' else pixels[..., 2::-1]
    assert decoded.encoding == kept
    assert np.abs(decoded.pixels.astype(int) - want).mean() < (4 if dtype == 'u1' else 1e-9)
    assert description.startswith(encoding + '; ' + ('jpeg' if dtype == 'u1' else 'png') + ' compressed ')


def test_depth_is_not_compressed() -> None:
    with pytest.raises(ValueError, match="encoding is '32FC1'"):
        encode(np.zeros((4, 4), np.float32), '32FC1')
