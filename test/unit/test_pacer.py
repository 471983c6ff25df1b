# SPDX-License-Identifier: BSD-3-Clause
import math
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.udpros.pacer import Pacer


def test_by_hand():
    pacer = Pacer(rate=1000, burst=300)
    assert [pacer.reserve(100, 5.0) for _ in range(5)] == pytest.approx([5, 5, 5, 5.1, 5.2])
    assert pacer.reserve(100, 5.25) == pytest.approx(5.3)      # it has not caught up
    assert pacer.reserve(100, 5.55) == 5.55                    # 0.15 s later than it had to
    assert [pacer.reserve(100, 9.0) for _ in range(4)] == pytest.approx([9, 9, 9, 9.1])   # and full again


def test_unlimited():
    pacer = Pacer()
    assert [pacer.reserve(10 ** 9, now) for now in (1.0, 1.0, 3.0)] == [1, 1, 3]


def test_more_than_the_burst_waits_for_the_rest():
    pacer = Pacer(rate=1000, burst=300)
    assert pacer.reserve(500, 0.0) == pytest.approx(0.2)
    assert pacer.reserve(100, 0.0) == pytest.approx(0.3)


def test_no_drift():
    """Ten thousand packets at a rate that no binary number meets take exactly as long as they should."""
    pacer = Pacer(rate=30000, burst=100)
    now = 0.0
    for _ in range(10001):
        now = pacer.reserve(100, now + 1e-5)    # asked a bit late each time
    assert now == pytest.approx(10000 * 100 / 30000 + 1e-5, abs=1e-3)


@given(st.floats(1, 1e9), st.integers(100, 10 ** 6), st.floats(0, 1e6), st.data())
def test_never_more_than_burst_and_rate_in_any_window(rate, burst, begin, data):
    pacer = Pacer(rate, burst)
    sent, now = [], begin
    for size, pause in data.draw(st.lists(st.tuples(st.integers(1, burst), st.floats(0, 3)), max_size=30)):
        leave = pacer.reserve(size, now)
        assert leave >= now
        sent.append((leave, size))
        now = leave + pause * burst / rate
    for first in range(len(sent)):
        for last in range(first, len(sent)):
            size = sum(size for _, size in sent[first:last + 1])
            time = sent[last][0] - sent[first][0]
            assert size <= burst + rate * time + 1e-6 * (burst + rate * begin)


def test_publishers_share_its_rate():
    pacer, leaves = Pacer(rate=1000, burst=10), []

    def publish():
        leaves.extend(pacer.reserve(10, 0.0) for _ in range(1000))

    threads = [threading.Thread(target=publish) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(leaves) == pytest.approx([0.01 * i for i in range(4000)])


@pytest.mark.parametrize(('rate', 'burst'), [(0, 10), (-1, 10), (math.nan, 10), (math.inf, 10), (10, 0), (10, -5),
                                             (10, math.nan), (10, math.inf), (None, 0)])
def test_impossible_rates(rate, burst):
    with pytest.raises(ValueError, match='positive'):
        Pacer(rate, burst)
