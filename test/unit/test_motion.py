# SPDX-License-Identifier: BSD-3-Clause
"""Compensation bit for bit, the bytes of a motion, and what is found of scenes that move."""
import time
import zlib
from typing import List

import motion_model
import needs_numba  # noqa: F401
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from motion_model import psnr, view

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.layered import mesh_bits, motion, warp
from smokebot_udp.codecs.layered.motion import NODES, NONE, Motion

SHAPES = [((1, 1), np.uint8), ((3, 9), np.uint16), ((7, 13), np.uint8), ((10, 6, 3), np.uint8)]


def uniform(down: int, right: int) -> Array:
    """Nodes that all have this displacement [1/32 pixel]."""
    return np.tile(np.array([down, right], np.int16), (NODES, NODES, 1))


def images(shape=(120, 160), **moved: float) -> List[Array]:
    """Two views of the scene as 8 bits: where the camera was, and where it is."""
    return [np.clip(255 * view(*shape, **place), 0, 255).astype(np.uint8) for place in ({}, moved)]


def test_whole_pixels_by_hand() -> None:
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    # down by 1, and right by -2: the borders are repeated
    moved = motion.compensate(pixels, Motion(uniform(32, -64), False))
    assert moved.tolist() == [[4, 4, 4, 5], [8, 8, 8, 9], [8, 8, 8, 9]]


def test_half_a_pixel_by_hand() -> None:
    pixels = np.array([[0, 0, 0, 128, 0, 0, 0, 0]], np.uint8)
    assert warp.SHARP[32].tolist() == [-8, 72, 72, -8] and warp.SMOOTH[32].tolist() == [3, 61, 61, 3]
    # at 1.5: -8 * 128 / 128, below 0; at 2.5 and 3.5: 72
    assert motion.compensate(pixels, Motion(uniform(0, 16), False)).tolist() == [[0, 0, 72, 72, 0, 0, 0, 0]]


@pytest.mark.parametrize('shape, kind', SHAPES)
@given(seed=st.integers(0, 9999), smooth=st.booleans(), most=st.sampled_from([0, 20, 300, 16384, 32767]))
@settings(max_examples=20, deadline=None)
def test_compensation_is_what_the_document_says(shape, kind, seed: int, smooth: bool, most: int) -> None:
    random = np.random.RandomState(seed)
    pixels = random.choice([0, 1, np.iinfo(kind).max], shape).astype(kind)
    nodes = random.randint(-most, most + 1, (NODES, NODES, 2)).astype(np.int16)
    found = motion.compensate(pixels, Motion(nodes, smooth))
    assert found.dtype == kind and np.array_equal(found, motion_model.compensated(pixels, nodes, smooth))


def test_no_motion_is_the_reference_itself() -> None:
    pixels = np.zeros((5, 5), np.uint8)
    assert motion.compensate(pixels, NONE) is pixels and not NONE and motion.to_bytes(NONE) == b''
    assert motion.from_bytes(b'') is NONE


def test_bytes_of_a_motion() -> None:
    # smooth; down: corners 5, 0, 0, 0 as 10, 0, 0, 0 by Rice's parameter 1, nothing else; right: nothing
    data = motion.to_bytes(Motion(uniform(5, 0), True))
    bits = '0001' + '1111100' + '00' * 3 + '0000' + '0000' + 2 * ('0000' + '0' * 5) + 2 * ('0000' + '0' * 16)
    assert data == b'\x01' + int(bits + '0' * (-len(bits) % 8), 2).to_bytes(-(-len(bits) // 8), 'big')
    assert len(data) == 12


@given(seed=st.integers(0, 9999), smooth=st.booleans(), most=st.sampled_from([0, 1, 30, mesh_bits.LIMIT]))
@settings(deadline=None)
def test_bytes_give_the_motion_back(seed: int, smooth: bool, most: int) -> None:
    nodes = np.random.RandomState(seed).randint(-most, most + 1, (NODES, NODES, 2)).astype(np.int16)
    data = motion.to_bytes(Motion(nodes, smooth))
    if len(data) > motion.MAX_BYTES:
        with pytest.raises(ValueError):
            motion.from_bytes(data)
    else:
        again = motion.from_bytes(data)
        assert np.array_equal(again.nodes, nodes) and again.smooth == smooth


@given(st.binary(max_size=130))
@example(b'\x00')
@example(b'\x02' + bytes(11))
@example(b'\x00' + bytes(12))
@example(b'\x00' + b'\xff' * 100)
@settings(max_examples=500, deadline=None)
def test_bytes_from_the_air(data: bytes) -> None:
    try:
        found = motion.from_bytes(data)
    except ValueError:
        return
    assert motion.to_bytes(found) == data and abs(found.nodes.astype(int)).max(initial=0) <= mesh_bits.LIMIT


@pytest.mark.parametrize('moved', [
    {'down': 2.3, 'right': -3.6}, {'down': -14.0, 'right': 17.0}, {'zoom': 1.04}, {'turn': 0.04, 'right': 3.0}],
    ids=['shift', 'large shift', 'zoom', 'turn'])
@pytest.mark.parametrize('kind', ['mono8', 'mono16', 'bgr8'])
def test_a_motion_is_found(moved, kind: str) -> None:
    reference, image = images(**moved)
    if kind == 'mono16':
        reference, image = (10000 + 10 * pixels.astype(np.uint16) for pixels in (reference, image))
    elif kind == 'bgr8':
        reference, image = (np.stack([pixels, pixels, 255 - pixels], 2) for pixels in (reference, image))
    found = motion.estimate(reference, image)
    data = motion.to_bytes(found)
    assert 0 < len(data) <= 60
    peak = 2550.0 if kind == 'mono16' else 255.0
    inner = slice(24, -24)
    before, after = (psnr(pixels[inner, inner], image[inner, inner], peak)
                     for pixels in (reference, motion.compensate(reference, motion.from_bytes(data))))
    assert after > 40 and after > before + 10


def test_what_stands_has_no_motion() -> None:
    reference, image = images()
    random = np.random.RandomState(1)
    noisy = np.clip(image + random.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    assert not motion.estimate(reference, image) and not motion.estimate(reference, noisy)
    # brightness is no motion
    assert not motion.estimate(reference, np.minimum(image, 245) + np.uint8(10))


def test_something_that_moves_by_itself_does_not_bend_the_rest() -> None:
    reference, image = images()
    reference[40:70, 20:50] = image[40:70, 60:90] = 255
    assert not motion.estimate(reference, image)


def test_nothing_to_see_has_no_motion() -> None:
    image = images()[0]
    assert not motion.estimate(np.zeros_like(image), image)


def test_of_noise_the_smooth_filter_is_chosen() -> None:
    random = np.random.RandomState(1)
    noisy = [np.clip(pixels + random.normal(0, 12, pixels.shape), 0, 255).astype(np.uint8)
             for pixels in images(right=4.5)]
    assert motion.estimate(*noisy).smooth and not motion.estimate(*images(right=4.5)).smooth


@pytest.mark.parametrize('shape', [(1, 1), (15, 400), (16, 16), (17, 90), (41, 39)])
def test_images_of_any_size(shape) -> None:
    pixels = np.random.RandomState(1).randint(0, 255, shape).astype(np.uint8)
    moved = np.roll(pixels, 1, 1)
    assert motion.compensate(pixels, motion.estimate(pixels, moved)).shape == shape


def test_long_narrow_images_take_no_seconds() -> None:
    pixels = np.random.RandomState(1).randint(0, 255, (16, 4096)).astype(np.uint8)
    motion.estimate(pixels[:, :64], pixels[:, :64])     # compiles
    began = time.process_time()
    assert motion.estimate(pixels, np.roll(pixels, 3, 1))
    assert time.process_time() - began < 1.5    # 0.04 s; the tried shifts of a quarter of the width took 3.6 s


def test_golden_pixels() -> None:
    random = np.random.RandomState(7)
    nodes = random.randint(-400, 400, (NODES, NODES, 2)).astype(np.int16)
    sums = [zlib.crc32(motion.compensate(random.randint(0, top, shape).astype(kind), Motion(nodes, smooth)).tobytes())
            for shape, kind, top in (((61, 83), np.uint8, 256), ((61, 83), np.uint16, 65536),
                                     ((30, 41, 3), np.uint8, 256)) for smooth in (False, True)]
    assert sums == [1600772472, 118914426, 2393942342, 1370989335, 4201898706, 3752090631]
