# SPDX-License-Identifier: BSD-3-Clause
"""What prefixes of a stream show: the same to who encoded it and to whoever decoded that much or more of it."""
import hashlib
from typing import Any, Optional

import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered import prefixes
from smokebot_udp.codecs.layered.image import LayeredStream, decode, encode, read
from smokebot_udp.codecs.layered.layout import FAR, NEAR, REFINEMENT
from smokebot_udp.codecs.layered.passes import FOUND, OLD, PLANE, REFINED

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


@pytest.mark.parametrize('seed', range(12))
def test_there_is_an_image_from_where_what_comes_before_the_passes_is_known(seed: int) -> None:
    pixels, other = images(32, 32, (np.uint8, 3), seed, 9)
    classes = (np.random.RandomState(seed).random_sample((32, 32)) < 0.1).astype(np.uint8)
    streams = [(encode(pixels, True, budget, its_classes, reference), reference)
               for budget in (134, 600) for its_classes in (None, classes) for reference in (None, other)]
    assert any(stream.predicted for stream, _ in streams)
    for stream, reference in streams:
        begun = stream.prefixes.begun
        assert stream.prefixes.pixels(begun) is not None and stream.prefixes.pixels(begun - 1) is None
        for known in (begun, begun + 1, len(stream.data)):     # the first passes may be zeros only
            for end in (begun - 1, begun, known):
                assert_alike(stream, pixels, reference, end, known)


def test_counts_are_those_when_the_first_pair_beyond_the_end_is_needed() -> None:
    log = np.array([[18, 1, 3, NEAR, 5], [22, 1, 3, REFINEMENT, 5], [30, 1, 3, FAR, 9], [40, 1, 2, NEAR, 11],
                    [40, 1, 2, REFINEMENT, 11]], np.int32)
    # of the bytes up to 20, 22, ..., how much was found or refined before they were needed; -1: between passes
    marks = np.array([-1] * 10 + [2, -1, 0, 0, 0, -1, 6, 6, 7, 9, 10, 2, 3], np.int32)

    def counted(end: int) -> Any:
        counts = np.zeros((2, 9), np.int64)
        prefixes.count_until(log, marks, end, counts)
        assert not counts[0].any()
        return counts[1, [OLD, REFINED, FOUND, PLANE]].tolist()

    assert counted(17) == [0, 0, 0, 0]
    assert counted(18) == counted(19) == [0, 0, 2, 3]
    assert counted(20) == counted(21) == [0, 0, 5, 3]
    assert counted(22) == [0, 0, 5, 3]
    assert counted(30) == counted(31) == [0, 0, 6, 3]
    assert counted(34) == [0, 0, 7, 3]
    assert counted(40) == [9, 2, 11, 2]
    assert counted(43) == [9, 3, 11, 2]
    assert counted(44) == [9, 9, 11, 2]


SHOWN = {(False, False): '90a93bec8743', (False, True): 'bdfd8c31a063', (True, False): '8da6fdbe3955',
         (True, True): '02a540bd5aa7'}
"""First digits of the SHA-256 of what prefixes show, by whether the stream is exact and predicted."""


@pytest.mark.parametrize('lossless, predicted', sorted(SHOWN))
def test_prefixes_show_the_same_in_all_versions(lossless: bool, predicted: bool) -> None:
    y, x = np.mgrid[:45, :58]
    pixels = ((x * x + 3 * x * y + 7 * y) % 150 + x).astype(np.uint8)
    stream = encode(pixels, lossless, 900, None, np.where(x < 20, pixels, 7).astype(np.uint8) if predicted else None)
    assert stream.predicted == predicted
    digest = hashlib.sha256()
    for end in range(stream.prefixes.begun, len(stream.data), 11):
        shown = stream.prefixes.pixels(end)
        assert shown is not None
        digest.update(shown.tobytes())
    assert digest.hexdigest()[:12] == SHOWN[lossless, predicted]


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


def test_large_images_compute_the_canvas_of_their_reference_again(monkeypatch: Any) -> None:
    pixels, other = images(50, 40, (np.uint8, 1), 3, 3)
    kept = encode(pixels, False, 900, None, other)
    monkeypatch.setattr(prefixes, 'KEPT', 100)
    stream = encode(pixels, False, 900, None, other)
    assert stream.predicted and stream.prefixes.predicted is not None and stream.prefixes.predicted.canvas is None
    assert np.array_equal(stream.prefixes.pixels(500), kept.prefixes.pixels(500))
