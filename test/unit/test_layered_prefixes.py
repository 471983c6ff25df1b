# SPDX-License-Identifier: BSD-3-Clause
"""What prefixes of a stream show: the same to who encoded it and to whoever decoded that much or more of it."""
from typing import Any, Optional

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered import prefixes
from smokebot_udp.codecs.layered.image import LayeredStream, decode, encode, read

ENOUGH = 1 << 24
KINDS = st.sampled_from([(np.uint8, 1), (np.uint16, 1), (np.uint8, 3)])


def images(height: int, width: int, kind: Any, seed: int, noise: int) -> Any:
    """Two that resemble each other."""
    random, (dtype, channels) = np.random.RandomState(seed), kind
    shape = (height, width, 3) if channels == 3 else (height, width)
    smooth = random.randint(0, 5, shape).cumsum(axis=1) + random.randint(0, 60)
    return [np.clip(smooth + random.randint(-noise, noise + 1, shape), 0, np.iinfo(dtype).max).astype(dtype)
            for _ in range(2)]


def shape_of(pixels: Array) -> Any:
    return (*pixels.shape[:2], 1 if pixels.ndim == 2 else 3, pixels.itemsize)


def of_operator(data: bytes, pixels: Array, reference: Optional[Array], end: int) -> Optional[Array]:
    found = read(data, *shape_of(pixels), reference)
    return None if found is None else found.prefixes.pixels(end)


def assert_alike(stream: LayeredStream, pixels: Array, reference: Optional[Array], end: int, known: int) -> None:
    """:param known: the operator has so many bytes, at least `end`"""
    ours, theirs = stream.prefixes.pixels(end), of_operator(stream.data[:known], pixels, reference, end)
    assert (ours is None) == (theirs is None)
    assert ours is None or theirs is None or np.array_equal(ours, theirs)


@settings(max_examples=120)
@given(st.integers(1, 60), st.integers(1, 60), KINDS, st.booleans(), st.booleans(), st.integers(0, 2 ** 32 - 1),
       st.sampled_from([0, 1, 9, 900]), st.integers(13, 3000), st.data())
def test_robot_and_operators_see_the_same_of_any_prefix(
        height: int, width: int, kind: Any, lossless: bool, predicted: bool, seed: int, noise: int, budget: int,
        data: Any) -> None:
    pixels, other = images(height, width, kind, seed, noise)
    stream = encode(pixels, lossless, budget, None, other if predicted else None)
    reference = other if stream.predicted else None
    cut = stream.cut(data.draw(st.integers(1, len(stream.ends))))
    for one in (stream, cut):
        for _ in range(3):
            end = data.draw(st.integers(0, len(one.data) + 5))
            assert_alike(one, pixels, reference, end, data.draw(st.integers(min(end, len(one.data)), len(one.data))))
        assert_alike(one._replace(data=one.data + bytes(9)), pixels, reference, len(one.data) + 9, len(one.data) + 9)


@pytest.mark.parametrize('predicted', [False, True])
@pytest.mark.parametrize('kind', [(np.uint8, 1), (np.uint16, 1), (np.uint8, 3)], ids=['grey', '16 bits', 'colour'])
def test_the_whole_exact_stream_shows_the_exact_image(kind: Any, predicted: bool) -> None:
    pixels, other = images(37, 50, kind, 1, 1)
    stream = encode(pixels, True, ENOUGH, None, other if predicted else None)
    assert stream.predicted == predicted
    for end in (len(stream.data), len(stream.data) + 100):
        assert np.array_equal(stream.prefixes.pixels(end), pixels)
    assert not np.array_equal(stream.prefixes.pixels(len(stream.data) - 30), pixels)


@pytest.mark.parametrize('lossless', [False, True], ids=['9/7', '5/3'])
def test_a_prefix_shows_all_but_what_its_last_bytes_say(lossless: bool) -> None:
    pixels, _ = images(60, 80, (np.uint8, 1), 1, 9)
    stream = encode(pixels, lossless, ENOUGH)

    def error(shown: Optional[Array]) -> float:
        assert shown is not None
        return float(((shown.astype(float) - pixels) ** 2).sum())

    for end in range(40, len(stream.data), 61):
        decoded = decode(stream.data[:end], *shape_of(pixels))
        less = decode(stream.data[:end - 8], *shape_of(pixels))
        assert decoded is not None and less is not None
        both = sorted((error(decoded.pixels), error(less.pixels)))
        assert 0.99 * both[0] <= error(stream.prefixes.pixels(end)) <= 1.01 * both[1] + 2


@pytest.mark.parametrize('lossless', [False, True], ids=['9/7', '5/3'])
def test_what_a_prefix_shows_does_not_depend_on_what_follows(lossless: bool) -> None:
    pixels, _ = images(60, 80, (np.uint8, 1), 1, 9)
    stream = encode(pixels, lossless, 3000)
    for end in range(20, len(stream.data), 7):
        for following in (b'\0', b'\xff'):
            data = stream.data[:end] + following * (len(stream.data) - end)
            other = of_operator(data, pixels, None, end)
            assert other is not None and np.array_equal(other, stream.prefixes.pixels(end)), (end, following)


def test_large_images_compute_the_canvas_of_their_reference_again(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels, other = images(50, 40, (np.uint8, 1), 3, 3)
    kept = encode(pixels, False, 900, None, other)
    monkeypatch.setattr(prefixes, 'KEPT', 100)
    stream = encode(pixels, False, 900, None, other)
    assert stream.predicted and stream.prefixes.predicted is not None and stream.prefixes.predicted.canvas is None
    assert np.array_equal(stream.prefixes.pixels(500), kept.prefixes.pixels(500))
