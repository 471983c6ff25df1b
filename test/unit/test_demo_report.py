# SPDX-License-Identifier: BSD-3-Clause
import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from smokebot_udp.monitoring.link_board import NodeStatus
from smokebot_udp.nodes.demo_report import DatagramCounts, in_namespace, psnr, rates


@pytest.mark.parametrize('shape', [(40, 60), (40, 60, 3)])
def test_psnr_of_bytes(shape: tuple) -> None:
    random = np.random.RandomState(0)
    sent, received = (random.randint(0, 256, shape).astype(np.uint8) for _ in range(2))
    assert psnr(sent, received) == pytest.approx(peak_signal_noise_ratio(sent, received))
    assert psnr(sent, sent) == math.inf


def test_psnr_of_counts_is_over_the_range_of_the_sent_image() -> None:
    sent = np.array([[7000, 8000], [9000, 7500]], np.uint16)
    assert psnr(sent, sent + np.uint16(20)) == pytest.approx(20 * math.log10(2000 / 20))


def report(stream: str, datagrams: int, lost: int, side: str = 'operator') -> NodeStatus:
    return NodeStatus('receiver', 0, '', {'side': side, 'stream': stream, 'topic': '/x', 'datagrams': str(datagrams),
                                          'lost': str(lost)})


def test_the_report_says_how_many_datagrams_were_lost() -> None:
    counts = DatagramCounts()
    assert counts.line() == 'datagrams: none counted'
    counts.add([report('thermal', 500, 100), report('gas', 10, 0)])
    counts.reset()
    counts.add([report('thermal', 900, 200), report('gas', 10, 0), report('thermal', 9999, 0, 'robot'),
                NodeStatus('receiver', 0, '', {'side': 'operator', 'stream': 'map', 'topic': '/map'})])
    assert counts.line() == 'datagrams: 100 of 500 lost (20 %)'


def test_the_report_says_which_rate_is_expected() -> None:
    assert rates(46.04, {'rate': 10.0, 'latch': False}, 8.0) == (
        ' 46.0 Hz source, at most 10 Hz wanted,   8.0 received')
    assert rates(0.0, {'rate': 10.0, 'latch': True}, 0.0) == '  0.0 Hz source, latched,   0.0 received'


def test_the_names_of_an_operator() -> None:
    assert in_namespace('/operator/map', '') == in_namespace('operator/map', '') == '/operator/map'
    assert in_namespace('/operator/map', 'ugv1') == in_namespace('operator/map', '/ugv1/') == '/ugv1/operator/map'
