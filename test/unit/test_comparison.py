# SPDX-License-Identifier: BSD-3-Clause
"""The demo's report."""
import math
from typing import Any, Sequence

import pytest

from smokebot_udp.demo.comparison import Compared, Images, table

RELAY, SCAN = {'type': 'relay', 'rate': 10.0, 'latch': False}, {'type': 'scan', 'rate': 10.0}
EXACT = (math.inf,)


def compared(settings: Any = SCAN, source: float = 40.0, received: float = 10.0, images: Any = None) -> Compared:
    return Compared('front', settings, source, received, True, images)


@pytest.mark.parametrize('stream, loss, expected', [
    (compared(), 0.2, 10.0),                            # the rest is less complete instead
    (compared(source=4.0), 0.2, 4.0),
    (compared(RELAY), 0.2, 8.0),
    (compared(RELAY, source=4.0), 0.5, 2.0),
])
def test_the_expected_rate(stream: Compared, loss: float, expected: float) -> None:
    assert stream.expected(loss) == pytest.approx(expected)


@pytest.mark.parametrize('stream, verdict', [
    (compared(received=8.0), 'good'),
    (compared(received=7.9), 'poor'),
    (compared(RELAY, received=6.4), 'good'),
    (compared(images=Images(EXACT, (0.1, 0.2, 2.0))), 'good'),
    (compared(images=Images((29.0, 31.5, math.inf), (0.1,))), 'good'),
    (compared(images=Images((29.0, 30.5), (0.1,))), 'poor'),
    (compared(images=Images(EXACT, (0.1, 0.4, 0.4))), 'poor'),
    (compared(images=Images((), ())), 'poor'),          # none arrived
    (compared(images=Images((), (0.1,))), 'unknown'),   # none was compared
    (compared(images=Images((), (0.4,))), 'poor'), (compared(received=7.9, images=Images((), (0.1,))), 'poor'),
    (Compared('tf_static', {**RELAY, 'latch': True}, 0.0, 0.0, True), 'good'),
    (Compared('tf_static', {**RELAY, 'latch': True}, 0.0, 0.0, False), 'poor'),
])
def test_the_verdict(stream: Compared, verdict: str) -> None:
    assert stream.row(0.2)[5] == verdict


@pytest.mark.parametrize('psnr, ages, text', [
    ((math.inf, 40.0, 42.0), (0.1, 0.1, 0.1), 'PSNR 41.0 dB, age p50 100 ms, p99 100 ms'),
    (EXACT, (0.25,), 'all exact, age p50 250 ms, p99 250 ms'),
    ((), (), ''),
])
def test_images_in_words(psnr: Sequence[float], ages: Sequence[float], text: str) -> None:
    assert str(Images(psnr, ages)) == text


def test_nothing_is_called_exact_that_was_not_compared() -> None:
    unlike = '640 x 480 mono16 is sent, 320 x 240 mono16 comes'
    assert str(Images((), (0.25,))) == 'not compared: no original has their stamps, age p50 250 ms, p99 250 ms'
    assert str(Images((), (0.25,), 1, unlike)) == 'not compared: %s, age p50 250 ms, p99 250 ms' % unlike
    assert str(Images(EXACT, (0.25, 0.25), 1, unlike)) == (
        'all exact of 1 compared, 1 not compared: %s, age p50 250 ms, p99 250 ms' % unlike)
    assert str(Images(2 * EXACT, 5 * (0.25,), 3)) == (
        'all exact of 2 compared, 3 not compared: no original has their stamps, age p50 250 ms, p99 250 ms')


def test_the_columns_are_aligned() -> None:
    assert table([compared(RELAY, 41.25, 7.5), Compared('a_long_name', {**RELAY, 'latch': True}, 0.0, 0.0, True),
                  compared(images=Images(EXACT, (0.05,)))], 0.2) == [
        'stream        source   wanted  expected  received',
        'front        41.2 Hz  10.0 Hz    8.0 Hz    7.5 Hz  good',
        'a_long_name           latched                 yes  good',
        'front        40.0 Hz  10.0 Hz   10.0 Hz   10.0 Hz  good  all exact, age p50 50 ms, p99 50 ms']
