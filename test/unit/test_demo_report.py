# SPDX-License-Identifier: BSD-3-Clause
import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from smokebot_udp.demo.images import psnr, stacked
from smokebot_udp.demo.report import DatagramCounts, in_namespace, loss_text
from smokebot_udp.monitoring.status import Kind, Status


@pytest.mark.parametrize('shape', [(40, 60), (40, 60, 3)])
def test_psnr_of_bytes(shape: tuple) -> None:
    random = np.random.RandomState(0)
    sent, received = (random.randint(0, 256, shape).astype(np.uint8) for _ in range(2))
    assert psnr(sent, received) == pytest.approx(peak_signal_noise_ratio(sent, received))
    assert psnr(sent, sent) == math.inf


def test_psnr_of_counts_is_over_the_range_of_the_sent_image() -> None:
    sent = np.array([[7000, 8000], [9000, 7500]], np.uint16)
    assert psnr(sent, sent + np.uint16(20)) == pytest.approx(20 * math.log10(2000 / 20))


def report(stream: str, datagrams: int, lost: int, side: str = 'operator') -> Status:
    return Status(Kind.STREAM, stream, 0, '', {'datagrams': str(datagrams), 'lost': str(lost)}, side, '/receiver')


def test_the_report_counts_how_many_datagrams_were_lost() -> None:
    counts = DatagramCounts()
    assert counts.counted() == (0, 0)
    counts.add([report('thermal', 500, 100), report('gas', 10, 0)])
    counts.reset()
    counts.add([report('thermal', 900, 200), report('gas', 10, 0), report('thermal', 9999, 0, 'robot'),
                Status(Kind.STREAM, 'map', 0, '', {}, 'operator', '/receiver')])
    assert counts.counted() == (400, 100)


@pytest.mark.parametrize('emulated, counts, text', [
    (0.2, (400, 100), '20 % of the datagrams dropped on purpose, 100 of 500 lost (20 %)'),
    (0.0, (500, 0), '0 of 500 lost (0 %)'),
    (0.0, (0, 0), 'no datagrams counted'),
])
def test_the_loss_in_words(emulated: float, counts: tuple, text: str) -> None:
    assert loss_text(emulated, counts) == text


def test_pictures_of_different_widths_are_below_each_other() -> None:
    picture = stacked([np.full((2, 3, 3), 7, np.uint8), np.full((1, 5, 3), 9, np.uint8)])
    assert picture.shape == (3, 5, 3)
    assert (picture[:2, :3] == 7).all() and (picture[:2, 3:] == 0).all() and (picture[2] == 9).all()


def test_the_names_of_an_operator() -> None:
    assert in_namespace('/operator/map', '') == in_namespace('operator/map', '') == '/operator/map'
    assert in_namespace('/operator/map', 'ugv1') == in_namespace('operator/map', '/ugv1/') == '/ugv1/operator/map'
