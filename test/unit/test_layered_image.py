# SPDX-License-Identifier: BSD-3-Clause
import hashlib
from typing import Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('numba')

from smokebot_udp.arrays import Array  # noqa: E402
from smokebot_udp.codecs.layered.image import Decoded, LayeredStream, decode, encode  # noqa: E402
from smokebot_udp.codecs.layered.layout import most_bytes  # noqa: E402

ENOUGH = 1 << 24


def scene(height: int, width: int, dtype: type = np.uint8, channels: int = 1) -> Array:
    """Smooth areas, edges and noise."""
    y, x = np.mgrid[:height, :width]
    top = float(np.iinfo(dtype).max)
    parts = []
    for i in range(channels):
        part = 0.4 + 0.2 * np.sin(x / (9.0 + i)) * np.cos(y / 13.0) + 0.2 * (x + 2 * y > width + 10 * i)
        parts.append(part + np.random.RandomState(i).normal(0, 0.01, part.shape))
    pixels = np.clip(np.stack(parts, -1) * top, 0, top).astype(dtype)
    return pixels if channels > 1 else pixels[..., 0]


def shape_of(pixels: Array) -> Tuple[int, int, int, int]:
    return (*pixels.shape[:2], 1 if pixels.ndim == 2 else pixels.shape[2], pixels.itemsize)


def decoded(stream: bytes, pixels: Array) -> Decoded:
    result = decode(stream, *shape_of(pixels))
    assert result is not None
    return result


def squared_error(stream: bytes, pixels: Array) -> float:
    return float(((decoded(stream, pixels).pixels.astype(float) - pixels) ** 2).sum())


SCENES = [scene(96, 128), scene(61, 83, np.uint16), scene(64, 50, np.uint8, 3)]
KINDS = pytest.mark.parametrize('pixels', SCENES, ids=['grey', '16 bits', 'colour'])
BOTH = pytest.mark.parametrize('lossless', [False, True], ids=['9/7', '5/3'])


@settings(max_examples=60)
@given(st.integers(1, 70), st.integers(1, 70), st.sampled_from(['u1', 'u2', 'colour']), st.integers(0, 2 ** 32 - 1),
       st.sampled_from([0, 3, 30, 100000]))
def test_lossless_is_exact_for_every_shape(height: int, width: int, kind: str, seed: int, spread: int) -> None:
    random = np.random.RandomState(seed)
    shape = (height, width, 3) if kind == 'colour' else (height, width)
    dtype = np.uint16 if kind == 'u2' else np.uint8
    pixels = np.clip(random.randint(-spread, spread + 1, shape) + random.randint(65536), 0, np.iinfo(dtype).max)
    pixels = pixels.astype(dtype)
    assert (decoded(encode(pixels, True, ENOUGH).data, pixels).pixels == pixels).all()


@pytest.mark.parametrize('value', [0, 255])
def test_one_value_takes_a_few_bytes(value: int) -> None:
    pixels = np.full((100, 100), value, np.uint8)
    stream = encode(pixels, True, ENOUGH)
    assert len(stream.data) < 28
    assert (decoded(stream.data, pixels).pixels == pixels).all()


@KINDS
@BOTH
def test_ends_ascend_and_errors_fall(pixels: Array, lossless: bool) -> None:
    stream = encode(pixels, lossless, ENOUGH)
    assert (np.diff(stream.ends) > 0).all()
    assert (np.diff(stream.errors) <= 0).all()
    assert stream.ends[-1] == len(stream.data)
    assert stream.cells == pixels.size


@KINDS
@BOTH
def test_errors_are_what_truncated_streams_show(pixels: Array, lossless: bool) -> None:
    stream = encode(pixels, lossless, ENOUGH)
    for i in range(1, len(stream.ends)):
        if stream.errors[i] > 0.5 * stream.cells:     # below, what one of few coefficients brings counts
            shown = stream.prefixes.pixels(int(stream.ends[i]))
            assert shown is not None
            found = float(((shown.astype(float) - pixels) ** 2).sum())
            assert 0.64 * found < stream.errors[i] < 1.4 * found, i


@KINDS
@BOTH
def test_every_prefix_decodes_and_the_image_gets_better(pixels: Array, lossless: bool) -> None:
    stream = encode(pixels, lossless, ENOUGH)
    ends = sorted({*range(int(stream.ends[0]), 200), *range(200, len(stream.data), 997), len(stream.data)})
    errors = [squared_error(stream.data[:end], pixels) for end in ends]
    assert all(later < 1.1 * earlier + pixels.size / 50 for earlier, later in zip(errors, errors[1:]))
    assert errors[-1] < 0.1 * stream.cells


@KINDS
@BOTH
@pytest.mark.parametrize('budget, with_classes', [(12, False), (700, False), (700, True), (ENOUGH, False),
                                                  (ENOUGH, True)])
def test_bytes_behind_a_stream_are_ignored(pixels: Array, lossless: bool, budget: int, with_classes: bool) -> None:
    classes = np.zeros(pixels.shape[:2], np.uint8) if with_classes else None
    whole = encode(pixels, lossless, budget, classes)
    for stream in (whole, whole.cut(max(1, len(whole.ends) // 2)), whole.cut(1)):
        expected = decoded(stream.data, pixels)
        for behind in (bytes(1), bytes(300), b'\xff' * 9):
            assert (decoded(stream.data + behind, pixels).pixels == expected.pixels).all()


@KINDS
def test_a_cut_stream_is_its_beginning(pixels: Array) -> None:
    whole = encode(pixels, False, ENOUGH)
    cut = whole.cut(3)
    assert (cut.ends.tolist(), cut.errors.tolist(), cut.cells) == (
        whole.ends[:3].tolist(), whole.errors[:3].tolist(), whole.cells)
    assert len(cut.data) == cut.ends[-1]
    assert (decoded(cut.data, pixels).pixels == decoded(whole.data[:cut.ends[-1]], pixels).pixels).all()
    assert whole.cut(len(whole.ends)).data == whole.data


@KINDS
def test_the_last_error_of_an_exact_stream_is_0(pixels: Array) -> None:
    stream = encode(pixels, True, ENOUGH)
    assert stream.errors[-1] == 0.0 < stream.errors[-2]


def test_less_than_the_head_is_no_image() -> None:
    pixels = SCENES[0]
    stream = encode(pixels, False, ENOUGH)
    assert [decode(stream.data[:i], *shape_of(pixels)) for i in range(stream.ends[0])] == [None] * stream.ends[0]


@BOTH
@pytest.mark.parametrize('budget', [1, 100, 1000, 3000])
def test_a_budget_ends_the_stream(lossless: bool, budget: int) -> None:
    pixels = SCENES[0]
    whole, short = encode(pixels, lossless, ENOUGH), encode(pixels, lossless, budget)
    assert len(short.data) <= max(budget, whole.ends[0])
    assert len(short.data) >= budget - 2
    if budget > 1:
        assert short.data[12:budget - 8] == whole.data[12:budget - 8]
        assert squared_error(short.data, pixels) == pytest.approx(short.errors[-1], rel=0.3)


def test_classes_are_exact_from_the_first_truncation_point_on() -> None:
    pixels = SCENES[1]
    random = np.random.RandomState(5)
    classes = np.zeros(pixels.shape, np.uint8)
    classes[5:20, 3:30] = 1
    classes[40:, 60:] = random.randint(0, 4, classes[40:, 60:].shape)
    stream = encode(pixels, True, ENOUGH, classes)
    for end in (stream.ends[0], stream.ends[3], len(stream.data)):
        result = decoded(stream.data[:end], pixels)
        assert result.classes is not None
        assert (result.classes == classes).all()
    assert (result.pixels == pixels).all()
    assert decode(stream.data[:stream.ends[0] // 2], *shape_of(pixels)) is None


def test_the_format_is_stable() -> None:
    y, x = np.mgrid[:21, :34]
    pixels = ((x * x + 3 * x * y + 7 * y) % 200 + x).astype(np.uint8)
    data = encode(pixels, True, ENOUGH).data
    assert data[:28].hex() == '0115002200660008a40200005fc06c37cd30781540a9349b50f115ed'
    assert hashlib.sha256(data).hexdigest().startswith('5c70ff9a819e955c')


@pytest.mark.parametrize('bits_per_pixel, least', [(0.25, 30.0), (1.0, 37.0), (3.0, 47.0)])
def test_quality_of_a_photograph(bits_per_pixel: float, least: float) -> None:
    data = pytest.importorskip('skimage.data')
    pixels = data.camera()
    stream = encode(pixels, False, int(bits_per_pixel * pixels.size / 8))
    error = squared_error(stream.data, pixels) / pixels.size
    assert 10 * np.log10(255 ** 2 / error) > least


def test_another_shape_than_the_head_says_is_refused() -> None:
    pixels = SCENES[0]
    data = encode(pixels, False, 500).data
    height, width = pixels.shape
    for other in ((height + 1, width, 1, 1), (height, width - 1, 1, 1), (height, width, 3, 1), (height, width, 1, 2),
                  (0, 0, 1, 1), (-1, 5, 1, 1), (1 << 20, 1 << 20, 1, 1), (height, width, 2, 1)):
        assert decode(data, *other) is None


def mutated(stream: LayeredStream, random: np.random.RandomState) -> bytes:
    data = np.frombuffer(stream.data, np.uint8).copy()
    kind = random.randint(4)
    if kind == 0:
        data[random.randint(len(data), size=random.randint(1, 9))] = random.randint(0, 256)
    elif kind == 1:
        data[random.randint(12, len(data)):] = random.choice([0, 255])
    elif kind == 2:
        first = random.randint(5, len(data))
        data[first:] = random.randint(0, 256, len(data) - first)
    else:
        data[random.randint(16)] ^= 1 << random.randint(8)
    return data.tobytes()[:random.randint(len(data) + 1)]


@KINDS
def test_mutated_streams_decode_to_some_image_or_none(pixels: Array) -> None:
    random = np.random.RandomState(7)
    streams = [encode(pixels, lossless, budget, classes) for lossless in (False, True) for budget in (300, ENOUGH)
               for classes in (None, random.randint(0, 4, pixels.shape[:2]).astype(np.uint8))]
    for i in range(250):
        result = decode(mutated(streams[i % len(streams)], random), *shape_of(pixels))
        assert result is None or (result.pixels.shape, result.pixels.dtype) == (pixels.shape, pixels.dtype)


@settings(max_examples=100)
@given(st.binary(max_size=300), st.integers(1, 40), st.integers(1, 40), st.booleans())
def test_any_bytes_after_a_head_decode(body: bytes, height: int, width: int, lossless: bool) -> None:
    pixels = np.zeros((height, width), np.uint8)
    head = encode(pixels, lossless, 12).data[:8]
    result = decode(head + bytes([18, 255, 255, 0, 0]) + body, height, width, 1, 1)
    assert result is not None
    assert result.pixels.shape == (height, width)


@BOTH
def test_a_stream_is_read_as_far_as_its_image_can_need(lossless: bool) -> None:
    pixels = SCENES[0]
    most = most_bytes(pixels.size, 1)
    head = encode(pixels, lossless, 12).data[:8] + b'\xff\xff\xff\x7f'
    body = np.random.RandomState(1).bytes(2 * most)
    assert (decoded(head + body, pixels).pixels == decoded((head + body)[:most], pixels).pixels).all()


@settings(max_examples=30)
@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from([(1, np.uint8), (3, np.uint8), (1, np.uint16)]),
       st.integers(0, 2 ** 32 - 1))
def test_no_exact_stream_is_longer_than_its_bound(height: int, width: int, kind: Tuple[int, type], seed: int) -> None:
    channels, dtype = kind
    shape = (height, width, 3) if channels == 3 else (height, width)
    pixels = (np.random.RandomState(seed).randint(0, 2, shape) * np.iinfo(dtype).max).astype(dtype)
    stream = encode(pixels, True, ENOUGH)
    assert len(stream.data) <= most_bytes(pixels.size, pixels.itemsize)
    assert (decoded(stream.data, pixels).pixels == pixels).all()
