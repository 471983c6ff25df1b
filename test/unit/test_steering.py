# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from smokebot_udp.arrays import Float32Array
from smokebot_udp.codecs.concealment.kriging import kriging_clamped, kriging_steered
from smokebot_udp.codecs.concealment.steering import DIRECTIONS, STRETCH, along, blended, edges
from smokebot_udp.codecs.wire.interleave import Interleave

ROWS, COLUMNS = np.mgrid[:96, :128]
STRIPES = {0: ROWS, 1: COLUMNS - ROWS, 2: COLUMNS, 3: COLUMNS + ROWS}
"""{direction: what is constant along it}: level, falling to the right, upright, rising"""


def stripes(direction: int) -> Float32Array:
    return (100 + 80 * np.sign(np.sin(STRIPES[direction] / 4 + 0.3))).astype(np.float32)


@pytest.mark.parametrize('direction, offset', enumerate([(0, 1), (1, 1), (1, 0), (-1, 1)]))
def test_along_an_edge_is_near_and_across_it_is_far(direction, offset) -> None:
    size = np.hypot(*offset)
    for sign in (-1, 1):
        sizes = [np.hypot(*one) for one in along(sign * np.array(offset))]
        assert sizes[direction] == pytest.approx(size / STRETCH, rel=1e-6)
        assert sizes[(direction + 2) % DIRECTIONS] == pytest.approx(size * STRETCH, rel=1e-6)


@pytest.mark.parametrize('direction', range(DIRECTIONS))
@pytest.mark.parametrize('spacing', [1.0, 1.5, 2.2])
def test_edges_run_as_the_stripes_do(direction, spacing) -> None:
    found = edges(stripes(direction), spacing)[16:-16, 16:-16]
    number, sign = direction % 2, 1 if direction < 2 else -1
    assert (sign * found[..., number]).min() > 0.8
    assert np.abs(found[..., 1 - number]).max() < 0.1


def test_between_two_directions_each_counts_half() -> None:
    angle = np.pi / 8      # falls to the right, less than by 45 degrees
    image = np.sin((ROWS * np.cos(angle) - COLUMNS * np.sin(angle)) / 3).astype(np.float32)
    assert edges(image, 1.0)[48, 64] == pytest.approx([0.5, 0.5], abs=0.05)


@pytest.mark.parametrize('image', [np.zeros((9, 7)), np.full((1, 1), 3.0), np.random.RandomState(1).randn(40, 40)])
@pytest.mark.parametrize('spacing', [1.0, 3.0, 64.0])
def test_vectors_are_never_too_long(image, spacing) -> None:
    found = edges(image.astype(np.float32), spacing)
    assert found.shape == image.shape + (2,)
    assert np.abs(found).sum(axis=-1).max() <= 1 + 1e-5


def test_blended_by_hand() -> None:
    steered = np.array([10, 20, 30, 40], np.float32)[:, np.newaxis]
    for vector, result in (((0, 0), 0), ((1, 0), 10), ((-1, 0), 30), ((0, 0.5), 10), ((-0.5, -0.5), 35)):
        assert blended(np.zeros(1, np.float32), steered, np.array([vector], np.float32)) == [result]


@pytest.mark.parametrize('direction', range(DIRECTIONS))
@pytest.mark.parametrize('share', [0.2, 0.5, 0.8])
def test_stripes_are_better_when_steered(direction, share) -> None:
    image = stripes(direction).astype(np.uint8)
    cut = Interleave(*image.shape, 3)
    have = np.random.RandomState(2).random_sample(len(cut)) < share
    plain, steered = (np.std(cut.merge(fill(cut.split(image), have, cut)) - image.astype(float))
                      for fill in (kriging_clamped, kriging_steered))
    assert steered < 0.9 * plain


def test_channels_are_steered_together_in_any_byte_order() -> None:
    cut = Interleave(48, 64, 3)
    image = stripes(1)[:48, :64].astype('<u2')[..., np.newaxis] * np.array([1, 2, 5], '<u2')
    have = np.random.RandomState(1).random_sample(len(cut)) < 0.4
    result = cut.merge(kriging_steered(cut.split(image), have, cut))
    assert (cut.merge(kriging_steered(cut.split(image.astype('>u2')), have, cut)) == result).all()
    alone = cut.merge(kriging_steered(cut.split(image[..., 0]), have, cut))
    np.testing.assert_allclose(result, alone[..., np.newaxis] * np.array([1, 2, 5]), atol=6)
