# SPDX-License-Identifier: BSD-3-Clause
"""The depth of a token bucket on the path, learnt from what passes a real one (evaluation's TokenBucket)."""
from typing import List, Tuple

import pytest

from evaluation.simulated_paths import TokenBucket
from smokebot_udp.congestion.feedback import PacketSample
from smokebot_udp.congestion.shaper import MAX_DURATION, SAME_RATE, SURE, Shaper

RATE, SIZE = 125000.0, 1000

QUEUES = 3


class Sent:
    """Datagrams over a token bucket of 1 Mbit/s, and what a shaper learns of them."""

    def __init__(self, depth: float) -> None:
        self.path, self.shaper = TokenBucket(8 * RATE, depth, 0.01, 1.0), Shaper()
        self.now, self.total = 0.0, 0
        self._newest: List[PacketSample] = []

    def report(self, *bursts: Tuple[float, int], measured: bool = True) -> None:
        """Bursts, each a pause [s] and a number of datagrams.

        :param measured: whether the rate is, beside a queue
        """
        chain = list(self._newest)
        for pause, count in bursts:
            self.now += pause
            for _ in range(count):
                self.now += 0.0005
                self.total += SIZE
                arrived, = self.path.fate(self.now, SIZE)
                chain.append(PacketSample(self.now, arrived, SIZE, self.total))
        self._newest = chain[-1:]
        waits = [sample.delay - 0.01 for sample in chain]
        passed = self.shaper.follow(chain, waits, RATE, 0.002)
        assert all(0 <= one.tokens <= self.shaper.depth for one in passed)
        if measured and waits[-1] > 0.002:
            self.shaper.learn(RATE, 0.0)


@pytest.mark.parametrize('depth', [3000.0, 6000.0, 12000.0, 32000.0])
def test_the_depth_is_what_passed_before_a_queue(depth: float) -> None:
    sent = Sent(depth)
    assert sent.shaper.depth == 0
    for _ in range(QUEUES):
        sent.report((0.8, int(depth / SIZE) + 20))
    assert sent.shaper.depth == pytest.approx(depth, abs=SIZE)


def test_where_one_datagram_passes_at_once_there_is_no_bucket() -> None:
    sent = Sent(SIZE)
    for _ in range(QUEUES):
        sent.report((0.5, 20))
    assert sent.shaper.depth == 0


def test_the_first_queue_shows_a_bucket() -> None:
    """Otherwise trains that it lets pass would show any rate until there is another queue."""
    sent = Sent(32000.0)
    sent.report((0.8, 50))
    assert sent.shaper.depth == pytest.approx(32000.0, abs=SIZE)


def test_a_rate_that_has_fallen_is_no_bucket() -> None:
    sent = Sent(SIZE)
    sent.path.rate = 20 * RATE
    for _ in range(50):
        sent.report((0.1, 100))
    sent.path.rate = RATE
    for _ in range(4):
        sent.report((0.1, 30))
    assert sent.shaper.depth == 0


def test_tokens_come_back_with_time() -> None:
    sent = Sent(6000.0)
    for _ in range(QUEUES):
        sent.report((1.0, 30))
    assert sent.shaper.tokens(RATE, sent.total, sent.now) == (0.0, 0.0)     # nearly all datagrams were queued
    sent.report((1.0, 4))
    now, (depth, missing) = sent.now, sent.shaper.tokens(RATE, sent.total, sent.now)
    assert depth == pytest.approx(6000.0, abs=SIZE)
    assert missing == pytest.approx(4 * SIZE - 3 * 0.0005 * RATE, abs=SIZE)
    assert sent.shaper.tokens(RATE, sent.total + 1000, now)[1] == pytest.approx(missing + 1000)
    assert sent.shaper.tokens(RATE, sent.total, now + 0.1)[1] == 0
    sent.shaper.restart()
    assert sent.shaper.tokens(RATE, sent.total, now) == (0.0, 0.0)


def test_no_more_is_spent_at_once_than_passes_within_a_moment() -> None:
    sent = Sent(32000.0)
    for _ in range(QUEUES):
        sent.report((1.0, 60))
    sent.report((1.0, 4))
    assert sent.shaper.tokens(RATE, sent.total, sent.now)[0] == pytest.approx(MAX_DURATION * RATE)


def test_a_queue_that_began_while_the_bucket_was_not_full_leaves_its_depth() -> None:
    sent = Sent(6000.0)
    for _ in range(QUEUES):
        sent.report((0.5, 30))
    sent.report((0.5, 30), (0.001, 1))
    sent.report((0.13, 30))
    assert sent.shaper.depth == pytest.approx(6000.0, abs=SIZE)


def test_a_path_with_another_rate_has_another_bucket() -> None:
    sent = Sent(6000.0)
    for _ in range(QUEUES):
        sent.report((0.5, 30))
    sent.shaper.learn((1 + SAME_RATE / 2) * RATE, 0.0)      # one measurement may be wrong
    sent.shaper.learn(2 * RATE, 0.0)
    assert sent.shaper.depth > 0
    sent.shaper.learn(2 * RATE, 0.0)
    assert sent.shaper.depth == 0


def test_a_depth_that_is_sure_outlives_a_change_of_the_rate() -> None:
    """As that of tbf, whose rate is changed. What queues showed beside it is forgotten."""
    sent = Sent(6000.0)
    for _ in range(SURE + 1):
        sent.report((0.5, 30))
    known = sent.shaper.depth
    assert known == pytest.approx(6000.0, abs=SIZE)
    sent.path.rate = 4 * RATE
    sent.report((0.5, 30), (0.5, 40), measured=False)
    for _ in range(2):
        sent.shaper.learn(4 * RATE, 0.0)
    assert sent.shaper.depth == known


def test_what_was_sent_together_has_spent_its_tokens_together() -> None:
    """Five datagrams left at once after a pause; only the last one has a sample."""
    shaper = Shaper()
    shaper.depth = 6000.0
    first, last = PacketSample(1.0, 1.01, SIZE, 1000), PacketSample(1.2, 1.21, SIZE, 6000, 5 * SIZE)
    assert shaper.follow([first, last], [0.0, 0.0], RATE, 0.002)[-1].tokens == 6000.0 - 5 * SIZE


def test_what_no_sample_tells_of_was_sent_evenly() -> None:
    """An image of 20 kB was paced between two samples: the bucket is as full as before."""
    shaper = Shaper()
    shaper.depth = 6000.0
    first, last = (PacketSample(now, now + 0.01, SIZE, total) for now, total in ((1.0, 1000), (1.2, 22000)))
    assert shaper.follow([first, last], [0.0, 0.0], RATE, 0.002)[-1].tokens == 6000.0 - SIZE


def test_two_short_queues_show_a_deeper_bucket_than_was_known() -> None:
    """No rate is measured beside them. One alone may be an accident of a link without a bucket."""
    sent = Sent(6000.0)
    sent.report((0.8, 26), measured=False)
    for _ in range(QUEUES):
        sent.report((0.18, 26))
    assert 0 < sent.shaper.depth < 5000.0
    sent.report((2.0, 8), measured=False)
    assert 0 < sent.shaper.depth < 5000.0
    sent.report((2.0, 8), measured=False)
    assert sent.shaper.depth == pytest.approx(6000.0, abs=SIZE)
