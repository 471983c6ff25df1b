# SPDX-License-Identifier: BSD-3-Clause
"""Streams that are predicted from a reference."""
import hashlib
import math
from typing import Any, Tuple

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered.image import LayeredStream, decode, encode

ENOUGH = 1 << 24
PREDICTED = 128
"""The flag of the head."""


def scene(height: int, width: int, dtype: Any, channels: int, seed: int, shift: float = 0.0, noise: float = 0.01
          ) -> Array:
    """Areas and edges, which move by `shift` [pixel], and noise of another seed."""
    y, x = np.mgrid[:height, :width] + shift
    top = float(np.iinfo(dtype).max)
    parts = [0.4 + 0.2 * np.sin(x / (5.0 + i)) * np.cos(y / 7.0) + 0.2 * (x + 2 * y > width + 10 * i)
             for i in range(channels)]
    pixels = np.stack(parts, -1) + np.random.RandomState(seed).normal(0, noise, (height, width, channels))
    pixels = np.clip(pixels * top, 0, top).astype(dtype)
    return pixels if channels > 1 else pixels[..., 0]


def shape_of(pixels: Array) -> Tuple[int, int, int, int]:
    return (*pixels.shape[:2], 1 if pixels.ndim == 2 else pixels.shape[2], pixels.itemsize)


def shown(stream: bytes, reference: Array) -> Array:
    result = decode(stream, *shape_of(reference), reference)
    assert result is not None
    return result.pixels


def error(stream: LayeredStream, pixels: Array, reference: Array) -> float:
    return float(((shown(stream.data, reference).astype(float) - pixels) ** 2).sum())


SHAPES = [(96, 128, np.uint8, 1), (61, 83, np.uint16, 1), (64, 50, np.uint8, 3)]
KINDS = pytest.mark.parametrize('shape', SHAPES, ids=['grey', '16 bits', 'colour'])
BOTH = pytest.mark.parametrize('lossless', [False, True], ids=['9/7', '5/3'])


@KINDS
@BOTH
@pytest.mark.parametrize('budget', [120, 600, ENOUGH])
def test_a_reference_of_the_same_scene_halves_the_error_or_the_bytes(shape: Any, lossless: bool, budget: int) -> None:
    pixels, reference = scene(*shape, 1, noise=0.002), scene(*shape, 2, noise=0.002)
    alone, predicted = encode(pixels, lossless, budget), encode(pixels, lossless, budget, None, reference)
    assert not alone.data[0] & PREDICTED and predicted.data[0] & PREDICTED
    assert len(predicted.data) <= budget
    if budget == ENOUGH:
        assert len(predicted.data) < 0.96 * len(alone.data)
    else:
        assert error(predicted, pixels, reference) < 0.5 * error(alone, pixels, reference)


@settings(max_examples=60)
@given(st.integers(1, 70), st.integers(1, 70), st.sampled_from([(np.uint8, 1), (np.uint16, 1), (np.uint8, 3)]),
       st.integers(0, 2 ** 32 - 1), st.sampled_from([0, 3, 30, 100000]), st.sampled_from([0, 1, 40, 100000]))
def test_5_3_is_exact_with_any_reference(height: int, width: int, kind: Any, seed: int, spread: int, change: int
                                         ) -> None:
    random = np.random.RandomState(seed)
    dtype, channels = kind
    shape = (height, width, 3) if channels == 3 else (height, width)
    middle = random.randint(65536)

    def valid(values: Array) -> Array:
        return np.clip(values, 0, np.iinfo(dtype).max).astype(dtype)

    reference = valid(random.randint(-spread, spread + 1, shape) + middle)
    pixels = valid(reference.astype(int) + random.randint(-change, change + 1, shape))
    assert (shown(encode(pixels, True, ENOUGH, None, reference).data, reference) == pixels).all()


@KINDS
def test_a_standing_scene_is_exact_in_a_few_bytes(shape: Any) -> None:
    pixels = scene(*shape, 1)
    stream = encode(pixels, True, 200, None, pixels)
    assert len(stream.data) < 60 and stream.errors[-1] == 0.0
    assert (shown(stream.data, pixels) == pixels).all()


@KINDS
def test_a_standing_scene_is_refined_until_it_is_exact(shape: Any) -> None:
    pixels = scene(*shape, 1)
    reference, errors = np.zeros_like(pixels), [math.inf]
    while errors[-1] > 0 and len(errors) < 60:
        stream = encode(pixels, True, pixels.nbytes // 12, None, reference)
        reference = shown(stream.data, reference)
        errors.append(float(((reference.astype(float) - pixels) ** 2).sum()))
    assert (reference == pixels).all()
    assert len(errors) < 28
    assert all(later < 1.05 * earlier + pixels.size / 50 for earlier, later in zip(errors, errors[1:]))


@KINDS
@BOTH
@pytest.mark.parametrize('budget', [60, 300, 2500])
def test_another_scene_as_reference_costs_nothing(shape: Any, lossless: bool, budget: int) -> None:
    pixels = scene(*shape, 1)
    random = np.random.RandomState(5)
    for reference in (random.randint(0, np.iinfo(pixels.dtype).max + 1, pixels.shape).astype(pixels.dtype),
                      scene(*shape, 2, shift=31.0), np.iinfo(pixels.dtype).max - pixels, np.zeros_like(pixels)):
        alone, predicted = encode(pixels, lossless, budget), encode(pixels, lossless, budget, None, reference)
        assert error(predicted, pixels, reference) < 1.023 * error(alone, pixels, reference)     # 0.1 dB


@KINDS
@BOTH
def test_errors_are_what_truncated_streams_show(shape: Any, lossless: bool) -> None:
    pixels, reference = scene(*shape, 1), scene(*shape, 2, shift=0.4)
    stream = encode(pixels, lossless, ENOUGH, None, reference)
    assert stream.data[0] & PREDICTED
    assert (np.diff(stream.ends) > 0).all() and (np.diff(stream.errors) <= 0).all()
    for i in range(len(stream.ends)):
        if stream.errors[i] > 0.5 * stream.cells:     # below, what one of few coefficients brings counts
            found = error(stream._replace(data=stream.data[:stream.ends[i]]), pixels, reference)
            assert 0.6 * found < stream.errors[i] < 1.6 * found, i
    assert (stream.errors[-1] == 0.0) == lossless


@KINDS
def test_a_cut_stream_is_its_beginning(shape: Any) -> None:
    pixels, reference = scene(*shape, 1), scene(*shape, 2)
    whole = encode(pixels, False, ENOUGH, None, reference)
    for points in (1, 3, len(whole.ends)):
        cut = whole.cut(points)
        assert (shown(cut.data + bytes(50), reference) == shown(whole.data[:cut.ends[-1]], reference)).all()


def test_a_part_of_the_image_that_differs_is_not_predicted() -> None:
    pixels = scene(96, 128, np.uint8, 1, 1)
    reference = pixels.copy()
    reference[:, 64:] = np.random.RandomState(1).randint(0, 256, (96, 64))
    alone, predicted = encode(pixels, False, 1500), encode(pixels, False, 1500, None, reference)
    found = shown(predicted.data, reference).astype(float) - pixels
    without = shown(alone.data, reference).astype(float) - pixels
    assert (found[:, :56] ** 2).mean() < 0.3 * (without[:, :56] ** 2).mean()
    assert (found[:, 72:] ** 2).mean() < (without[:, 72:] ** 2).mean()


def test_a_stream_that_needs_a_reference_shows_nothing_without_it() -> None:
    pixels, reference = scene(61, 83, np.uint16, 1, 1), scene(61, 83, np.uint16, 1, 2)
    stream = encode(pixels, False, 2000, None, reference).data
    for other in (None, reference[:, 1:], reference[..., np.newaxis], reference.astype(np.uint8),
                  reference.astype(np.float32)):
        assert decode(stream, *shape_of(pixels), other) is None
    assert [decode(stream[:i], *shape_of(pixels), reference) for i in range(16)] == [None] * 16


def test_a_stream_that_needs_none_ignores_it() -> None:
    pixels = scene(61, 83, np.uint16, 1, 1)
    stream = encode(pixels, False, 2000).data
    assert (shown(stream, np.zeros_like(pixels)) == decode(stream, *shape_of(pixels)).pixels).all()


@pytest.mark.parametrize('reference', [np.zeros((61, 82), np.uint16), np.zeros((61, 83), np.uint8),
                                       np.zeros((61, 83, 1), np.uint16)])
def test_a_reference_of_another_kind_is_refused(reference: Array) -> None:
    with pytest.raises(ValueError, match='a reference of'):
        encode(scene(61, 83, np.uint16, 1, 1), False, 2000, None, reference)


def test_classes_are_exact_beside_a_reference() -> None:
    pixels, reference = scene(61, 83, np.uint16, 1, 1), scene(61, 83, np.uint16, 1, 2)
    classes = np.zeros(pixels.shape, np.uint8)
    classes[5:20, 3:30] = 1
    classes[40:, 60:] = 2
    alone, stream = (encode(pixels, True, ENOUGH, classes, given) for given in (None, reference))
    assert len(stream.data) < len(alone.data) and stream.missing == 0
    for end in (stream.ends[0], stream.ends[3], len(stream.data)):
        result = decode(stream.data[:end], *shape_of(pixels), reference)
        assert result is not None and (result.classes == classes).all()
    assert (result.pixels == pixels).all()


GOLDEN = {
    ('grey', False): ('d85f8b3839e7', '296ed90a3a92'),
    ('grey', True): ('c1fb846c00b0', '29fb30cf53eb'),
    ('16 bits', False): ('b3c9ab48305d', 'd7f587a9a413'),
    ('16 bits', True): ('57147d82e7fa', '8b78f7038cd0'),
    ('colour', False): ('d174423f2fbe', 'aafcf2d0f73c'),
    ('colour', True): ('be58d7d54f8d', '63076907ad92')}
"""First digits of the SHA-256 of what is shown of an image of 600 bytes, and of one that is predicted from it."""


@BOTH
@pytest.mark.parametrize('kind', ['grey', '16 bits', 'colour'])
def test_pixels_are_the_same_on_every_machine(kind: str, lossless: bool) -> None:
    y, x = np.mgrid[:45, :58]
    pixels: Array = ((x * x + 3 * x * y + 7 * y) % 150 + x).astype(np.uint8)
    pixels = {'grey': pixels, '16 bits': pixels.astype(np.uint16) * 251,
              'colour': np.stack([pixels, pixels[::-1], 255 - pixels], -1)}[kind]
    nothing = np.zeros_like(pixels)
    first = shown(encode(pixels, lossless, 600).data, nothing)
    moved = np.roll(pixels, 1, axis=1)
    second = shown(encode(moved, lossless, 600, None, np.roll(first, 1, axis=1)).data, np.roll(first, 1, axis=1))
    found = tuple(hashlib.sha256(image.tobytes()).hexdigest()[:12] for image in (first, second))
    assert found == GOLDEN[kind, lossless]


def test_the_format_is_stable() -> None:
    y, x = np.mgrid[:45, :58]
    pixels = ((x * x + 3 * x * y + 7 * y) % 200 + x).astype(np.uint8)
    reference = pixels.copy()
    reference[20:, 30:] = 5
    data = encode(pixels, True, ENOUGH, None, reference).data
    assert data[:28].hex() == '812d003a007b0008e403000012a9a19ec0560aad25d078ada2551609'
    assert hashlib.sha256(data).hexdigest()[:16] == '8142b604f5761cc4'


def mutated(data: bytes, random: np.random.RandomState) -> bytes:
    changed = np.frombuffer(data, np.uint8).copy()
    kind = random.randint(3)
    if kind == 0:
        changed[random.randint(len(changed), size=random.randint(1, 9))] = random.randint(0, 256)
    elif kind == 1:
        first = random.randint(5, 60)
        changed[first:] = random.randint(0, 256, len(changed) - first)
    else:
        changed[random.randint(40)] ^= 1 << random.randint(8)
    return changed.tobytes()[:random.randint(len(changed) + 1)]


@KINDS
def test_mutated_streams_decode_to_some_image_or_none(shape: Any) -> None:
    random = np.random.RandomState(7)
    pixels, reference = scene(*shape, 1), scene(*shape, 2, shift=0.5)
    streams = [encode(pixels, lossless, budget, classes, reference) for lossless in (False, True)
               for budget in (300, ENOUGH) for classes in (None, random.randint(0, 4, pixels.shape[:2], np.uint8))]
    results = [decode(mutated(streams[i % len(streams)].data, random), *shape_of(pixels), reference)
               for i in range(300)]
    good = [result for result in results if result is not None]
    assert len(good) > 100
    assert {(result.pixels.shape, result.pixels.dtype) for result in good} == {(pixels.shape, pixels.dtype)}


@settings(max_examples=100)
@given(st.binary(max_size=300), st.integers(1, 80), st.integers(1, 80), st.booleans(), st.integers(0, 3))
def test_any_bytes_after_a_head_decode(body: bytes, height: int, width: int, lossless: bool, value: int) -> None:
    reference = np.full((height, width), 85 * value, np.uint8)
    head = bytearray(encode(reference, lossless, 12).data[:8])
    head[0] |= PREDICTED
    result = decode(bytes(head) + bytes([18, 255, 255, 0, 0]) + body, height, width, 1, 1, reference)
    assert result is None or result.pixels.shape == (height, width)
    assert result is not None or len(body) < 80
