# SPDX-License-Identifier: BSD-3-Clause
"""Whether a flow beside us fills the queue: reports of a simulated bottleneck of 2.5 MB/s (20 Mbit/s)."""
from typing import List, Optional

import pytest

from smokebot_udp.congestion.competition import DUE_TIME, EMPTY_TIME, HOLDOFF, LIFETIME, SHARE, Competition
from smokebot_udp.congestion.feedback import Feedback, PacketSample, sending_rate
from smokebot_udp.congestion.loss import Loss
from smokebot_udp.congestion.path import Observation
from smokebot_udp.congestion.pause import CHECK
from smokebot_udp.congestion.trains import Train

LINK, TARGET, SIZE, REPORT = 2.5e6, 0.005, 1000, 0.1


class Bottleneck:
    """A fluid queue that we share with others, and a report each REPORT; trains leave when they are due."""

    def __init__(self, others: float = 0.0, queue: float = 0.0, path: float = 0.02, noise: float = 0.0) -> None:
        self.competition, self.loss = Competition(), Loss()
        self.noise = noise
        self.others, self.queue, self.path = others, queue, path
        self.now, self.total = 0.0, 0
        self.drain: Optional[float] = None
        self.evidence = 0
        self.trains: List[Train] = []
        self._train = (0.0, 0.0)        # (rate, bytes left)
        self._newest: List[PacketSample] = []

    def run(self, seconds: float, rate: float, lost: float = 0.0) -> None:
        """Send at a rate [byte/s] for this long [s]."""
        ends = self.now + seconds
        while self.now < ends - 1e-9:
            self._report(rate, lost)

    def follow(self, seconds: float) -> None:
        """Send as it says, while it takes others for a competitor."""
        ends = self.now + seconds
        while self.competition.active and self.now < ends - 1e-9:
            self._report(self.competition.rate * (CHECK.gain if self.drain is not None else 1.0), 0.0)

    def begin_drain(self) -> None:
        """Little is sent from now on."""
        self.drain = self.now

    def _report(self, rate: float, lost: float) -> None:
        samples, ends = [], self.now + REPORT
        while self.now < ends - 1e-9:
            at, left = self._train
            step = SIZE / (at if left > 0 else rate)
            self._train = at, left - SIZE
            self.queue = max(0.0, self.queue + (SIZE + self.others * step) / LINK - step)
            self.now += step
            self.total += SIZE
            samples.append(PacketSample(self.now, self.now + self.path + self.queue, SIZE, self.total))
        chain, self._newest = self._newest + samples, samples[-1:]
        queue = self.queue + self.path - 0.02
        counts = Feedback(samples, 0.04, 100, 100 - round(100 * lost), 0, False)
        seen = Observation(self.now, counts, chain, [], chain[-1], queue, self.noise, sending_rate(chain[0], chain[-1]),
                           0.0, 0.0, 0.0)
        self.evidence += self.competition.update(seen, TARGET, chain[0], self.drain, self.loss)
        if self.competition.check_due(self.now):
            self.drain = self.now
        elif self.competition.active and self.drain is not None and (
                self.competition.checked or self.now - self.drain > CHECK.duration):
            self.drain = None
        train = self.competition.train(seen, TARGET)
        if train is not None:
            self.trains.append(train)
            self._train = train


def at_a_drain(others: float, queue: float = 0.05, path: float = 0.02, noise: float = 0.0) -> Bottleneck:
    """The link was ours, then others came, or the path became longer; a drain begins."""
    link = Bottleneck(noise=noise)
    link.run(2, LINK)
    link.others, link.queue, link.path = others, queue, path
    link.run(1, LINK - others)
    link.begin_drain()
    return link


def after_a_drain(others: float, queue: float = 0.05, path: float = 0.02, noise: float = 0.0) -> Bottleneck:
    """As `at_a_drain`, and the drain has ended."""
    link = at_a_drain(others, queue, path, noise)
    link.others = 0.9 * LINK if others else 0.0     # a download takes what it gets
    link.run(0.6, 0.1 * LINK)
    link.drain, link.others = None, others
    return link


def test_a_download_that_keeps_the_queue_is_noticed_and_the_rate_is_a_part_of_the_bottleneck() -> None:
    link = after_a_drain(0.6 * LINK)
    assert link.competition.active
    assert link.competition.rate == pytest.approx(SHARE * LINK, rel=0.15)


def test_a_test_is_no_longer_than_what_streams_have_to_send() -> None:
    link = at_a_drain(0.85 * LINK)
    link.others = 0.9 * LINK
    link.run(0.4, 0.1 * LINK)
    assert 0.8 * DUE_TIME * 0.15 * LINK <= link.trains[0].size <= DUE_TIME * 0.15 * LINK


def test_a_path_that_became_longer_is_no_competitor() -> None:
    link = after_a_drain(0.0, 0.0, 0.08)
    assert not link.competition.active
    assert not link.evidence


def test_a_queue_that_gets_shorter_in_the_drain_is_no_competitor() -> None:
    link = after_a_drain(0.0, 0.15)
    assert not link.competition.active


def test_others_that_send_less_in_the_drain_too_are_no_competitor() -> None:
    link = at_a_drain(0.75 * LINK)
    link.others = 0.2 * LINK
    link.run(0.6, 0.1 * LINK)
    assert not link.competition.active


def test_the_mode_ends_where_the_queue_is_empty() -> None:
    link = after_a_drain(0.6 * LINK)
    link.others, link.queue = 0.0, 0.0
    link.run(EMPTY_TIME + 0.3, 0.4 * LINK)
    assert not link.competition.active


def test_the_mode_ends_where_the_path_is_only_longer_and_does_not_begin_again_at_once() -> None:
    link = after_a_drain(0.6 * LINK)
    link.others, link.queue, link.path = 0.0, 0.0, 0.08
    while link.competition.active and link.now < 13:
        link.run(REPORT, 0.4 * LINK)
    assert not link.competition.active
    found = link.evidence
    link.begin_drain()
    link.others, link.queue = 0.9 * LINK, 0.05
    link.run(min(0.6, HOLDOFF / 2), 0.1 * LINK)
    assert not link.competition.active
    assert link.evidence == found


def test_evidence_has_to_be_renewed() -> None:
    link = after_a_drain(0.6 * LINK)
    link.run(LIFETIME[-1] + 1, 0.4 * LINK, lost=1.0)     # all trains are cut off
    assert not link.competition.active


def test_a_download_is_seen_again_and_again_although_delays_are_noisy() -> None:
    link = after_a_drain(0.57 * LINK, noise=0.006)
    link.follow(60)
    assert link.competition.active


def test_the_drain_ends_where_the_mode_begins_as_another_test_would_only_show_what_the_first_one_left() -> None:
    link = at_a_drain(0.6 * LINK, 0.15)
    link.others = 0.9 * LINK
    while not link.competition.active and link.now < 4:
        link.run(REPORT, 0.1 * LINK)
    link.others = 0.0       # for a moment, as beside a queue that was too long
    link.run(0.4, 0.1 * LINK)
    assert link.competition.active


def test_much_loss_beyond_the_air_ends_the_mode() -> None:
    link = after_a_drain(0.6 * LINK)

    class Congested(Loss):
        excess = 0.4
    link.loss = Congested()
    link.run(1.5, 0.4 * LINK)
    assert not link.competition.active


def test_the_rate_is_never_beyond_the_share_of_what_was_carried() -> None:
    link = after_a_drain(0.6 * LINK)
    for _ in range(20):
        link.run(0.5, 0.4 * LINK)
        assert not link.competition.active or link.competition.rate <= SHARE * 1.02 * LINK


def test_evidence_that_comes_as_the_mode_ends_does_not_leave_a_rate_of_nothing() -> None:
    link = after_a_drain(0.6 * LINK)
    link.others = 0.0
    for _ in range(100):
        link.run(REPORT, 0.4 * LINK)
        link.others = 0.6 * LINK if link.competition.checked else 0.0
        assert link.competition.rate > 0
