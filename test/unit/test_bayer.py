# SPDX-License-Identifier: BSD-3-Clause
"""Bayer mosaics and YUV 4:2:2."""
import numpy as np
import pytest

from smokebot_udp.codecs.wire.bayer import BAYER, debayered, from_cells, from_yuv422, to_cells

PLACES = {'rggb': [[2, 1], [1, 0]], 'bggr': [[0, 1], [1, 2]], 'gbrg': [[1, 0], [2, 1]], 'grbg': [[1, 2], [0, 1]]}
"""{pattern: channel of each place, of blue, green, red}"""


def test_cells_by_hand() -> None:
    mosaic = np.uint16([[1, 2, 5, 6], [3, 4, 7, 8], [11, 12, 15, 16], [13, 14, 17, 18]])
    cells = to_cells(mosaic)
    assert cells.tolist() == [[[1, 2, 3, 4], [5, 6, 7, 8]], [[11, 12, 13, 14], [15, 16, 17, 18]]]
    assert (from_cells(cells) == mosaic).all() and from_cells(cells).dtype == mosaic.dtype


@pytest.mark.parametrize('encoding', sorted(BAYER))
@pytest.mark.parametrize('order', '<>')
def test_each_pattern_has_its_colours(encoding: str, order: str) -> None:
    colour = np.array([40, 120, 220])
    mosaic = np.tile(colour[np.array(PLACES[encoding[6:10]])], (8, 8))
    mosaic = mosaic.astype('u1') if encoding.endswith('8') else (mosaic * 256 + 99).astype(order + 'u2')
    shown = debayered(mosaic, encoding)
    assert shown.shape == (16, 16, 3) and (shown[2:-2, 2:-2] == colour).all()


@pytest.mark.parametrize('shape', [(2, 2), (2, 8), (8, 2), (4, 4)])
def test_small_mosaics(shape: tuple) -> None:
    assert debayered(np.full(shape, 7, np.uint8), 'bayer_rggb8').shape == (*shape, 3)


@pytest.mark.parametrize('encoding, order', [('yuv422', [1, 0, 3, 2]), ('yuv422_yuy2', [0, 1, 2, 3])])
def test_yuv_by_hand(encoding: str, order: list) -> None:
    # a dark and a bright grey pixel, then two red ones: Y 81, U 90, V 240 of BT.601
    pairs = np.uint8([[16, 128, 235, 128], [81, 90, 81, 240]])[:, order].reshape(2, 2, 2)
    shown = from_yuv422(pairs, encoding).astype(int)
    want = [[[0, 0, 0], [255, 255, 255]], [[0, 0, 255], [0, 0, 255]]]
    assert np.abs(shown - want).max() <= 2
