# SPDX-License-Identifier: BSD-3-Clause
"""The simulated paths and TCP flows that congestion control is measured on are what they are said to be."""
from typing import Callable, List, Tuple

import pytest

from evaluation.simulated_air import FULL, Events
from evaluation.simulated_paths import TURN, AggregatingAir
from evaluation.simulated_tcp import Bbr, CongestionControl, Cubic, Tcp
from smokebot_udp.link_lab.channel import Channel, LinkConditions

RATE = 10e6
"""[bit/s]"""


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_aggregates_carry_the_rate_and_arrive_at_once(seed: int) -> None:
    path = AggregatingAir(RATE, 0.02, 0.1, seed)
    came: List[float] = []
    for k in range(20000):
        came.extend(path.fate(0.001 * k, FULL))     # 12 Mbit/s
    assert len(came) * FULL * 8 / 20 == pytest.approx(RATE, rel=0.06)
    assert came == sorted(came)
    ends = sorted(set(came))
    assert all(later - earlier >= TURN[0] for earlier, later in zip(ends, ends[1:]))
    assert len(ends) < len(came) / 5
    assert path.counts.dropped == 20000 - len(came) and path.waits(20.0) <= 0.1 + TURN[1]


def flows(queue: float, *kinds: Callable[[], CongestionControl]) -> Tuple[List[float], float]:
    """([part of the link that each gets from 15 to 60 s], part of the segments that the queue dropped)"""
    events, path = Events(), Channel(LinkConditions(rate=RATE, delay=0.02, queue=queue), 1)
    all_ = [Tcp(events, path, 0.02, kind(), 2.0 * number) for number, kind in enumerate(kinds)]
    events.run(60)
    return ([sum(size for when, size in one.came if when >= 15) * 8 / 45 / RATE for one in all_],
            path.counts.dropped / path.counts.offered)


@pytest.mark.parametrize('kind', [Cubic, Bbr])
@pytest.mark.parametrize('queue', [0.05, 0.2])
def test_tcp_alone_fills_the_link(kind: Callable[[], CongestionControl], queue: float) -> None:
    (part,), dropped = flows(queue, kind)
    assert part >= 0.95 and dropped <= 0.01


@pytest.mark.parametrize('kind', [Cubic, Bbr])
@pytest.mark.parametrize('queue', [0.05, 0.2])
def test_two_tcp_flows_share_the_link(kind: Callable[[], CongestionControl], queue: float) -> None:
    parts, dropped = flows(queue, kind, kind)
    assert sum(parts) >= 0.95 and min(parts) >= 0.35 and dropped <= 0.02


def test_cubic_fills_a_long_queue_and_bbr_does_not() -> None:
    def dropped(kind: Callable[[], CongestionControl]) -> float:
        return flows(0.2, kind)[1]
    assert dropped(Cubic) > 0 and dropped(Bbr) == 0


def test_a_flow_goes_on_after_an_outage() -> None:
    events, path = Events(), Channel(LinkConditions(rate=RATE, delay=0.02, queue=0.1), 1)
    tcp = Tcp(events, path, 0.02, Cubic())
    events.run(5)
    path.conditions = LinkConditions(rate=RATE, delay=0.02, queue=0.1, loss=1.0)
    events.run(8)
    path.conditions = LinkConditions(rate=RATE, delay=0.02, queue=0.1)
    events.run(20)
    assert sum(size for when, size in tcp.came if when >= 15) * 8 / 5 / RATE >= 0.9
