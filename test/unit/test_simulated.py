# SPDX-License-Identifier: BSD-3-Clause
"""The supervisor over a bad link, simulated: what it has to reach (see estimate.py), over many links."""
import random
from dataclasses import replace

import numpy as np
import pytest

from smokebot_udp.congestion.estimator import MBIT, Limits
from smokebot_udp.congestion.feedback import CONFIRMED
from smokebot_udp.link_lab.channel import Channel, Quality
from smokebot_udp.link_lab.simulated import Events, Robot, greedy
from smokebot_udp.link_lab.simulated_streams import Streams, cloud, grid, navigation, picture, scan

STEPS = 20, 5, 1, 0.3, 20
"""[Mbit/s]"""

EACH, SETTLED = 8.0, 2.0
"""A step lasts so long, and is judged from then on [s]."""


def link(rate, loss=0.0, seed=0, load=greedy, **options):
    """(Events, Channel there, Robot) over a link of so many Mbit/s."""
    events = Events()
    there = Channel(Quality(rate=rate * 1e6, loss=loss, delay=0.02, queue=0.2), seed)
    return events, there, Robot(events, there, Channel(Quality(loss=loss, delay=0.02), seed + 1), load, seed, **options)


def sent(robot, since, until=np.inf):
    """(n, 3): when, bytes, and how long it waited for the air."""
    rows = np.array(robot.sent)
    return rows[(rows[:, 0] >= since) & (rows[:, 0] < until)]


def used(robot, rate, since, until):
    """The share of the link that was used."""
    return sent(robot, since, until)[:, 1].sum() * 8e-6 / (until - since) / rate


def run_steps(events, there):
    """Yield (rate, since, until, datagrams dropped by the queue after the first second) of each step."""
    for number, rate in enumerate(STEPS):
        there.quality = replace(there.quality, rate=rate * 1e6)
        events.run(number * EACH + 1)
        dropped = there.counts.dropped
        events.run((number + 1) * EACH)
        yield rate, number * EACH + SETTLED, (number + 1) * EACH, there.counts.dropped - dropped


@pytest.mark.parametrize('loss', [0.0, 0.05, 0.2])
@pytest.mark.parametrize('seed', [1, 2])
def test_the_rate_follows_the_link_whatever_the_air_loses(loss, seed):
    events, there, robot = link(STEPS[0], loss, seed)
    for rate, since, until, dropped in run_steps(events, there):
        assert used(robot, rate, since, until) >= 0.85
        assert np.percentile(sent(robot, since, until)[:, 2], 95) <= 0.06
        assert dropped == 0


@pytest.mark.parametrize('loss', [0.0, 0.05, 0.2])
def test_what_is_protected_comes_on_every_link(loss):
    streams = navigation()
    events, there, robot = link(STEPS[0], loss, 3, streams)
    came = 0
    for _, since, until, _ in run_steps(events, there):
        ages = [when - left for when, name, _, _, left in robot.came
                if name in streams.protected and since <= left < until]
        came += len(ages)
        assert np.percentile(ages, 99) <= 0.02 + 0.1
        pictures = {frame for when, name, frame, _, _ in robot.came if name == 'thermal' and since <= when < until}
        assert len(pictures) / (until - since) >= 2
    all_ = sum(rate for rate, _ in streams.protected.values()) * len(STEPS) * (EACH - SETTLED)
    assert 1 - came / all_ == pytest.approx(loss, abs=0.03)


def test_on_a_good_link_pictures_come_whole_with_all_else_beside_them():
    streams = Streams({'thermal': picture(320 * 240 * 2), 'lidar': cloud(60000, rate=5.0, leaf_size=0.2),
                       'scan': scan(1600), 'map': grid(60)}, {'tf': (20.0, 220)})
    events, _, robot = link(20, load=streams)
    events.run(10)
    parts = {}
    for when, name, frame, _, _ in robot.came:
        if name == 'thermal' and when >= 3:
            parts[frame] = parts.get(frame, 0) + 1
    assert sum(came == count for (_, count), came in parts.items()) >= 0.9 * 70
    assert all(grant.level == len(streams.streams[name].demand.levels) - 1 for name, grant in streams.grants.items())


def test_a_focus_switch_moves_the_shares_at_once():
    streams = navigation()
    events, _, robot = link(2, load=streams)
    events.run(10)
    before = {name: grant.share for name, grant in streams.grants.items()}
    streams.change_focus(thermal=0.5, lidar=8.0)
    events.run(10.5)
    after = {name: grant.share for name, grant in streams.grants.items()}
    assert after['lidar'] > 2 * before['lidar'] and after['thermal'] < before['thermal'] / 2
    assert any(10 < when <= 10.5 for when, _ in streams.granted)


def test_levels_do_not_flicker():
    streams = navigation()
    events, _, robot = link(5, 0.05, load=streams)
    events.run(30)
    assert sum(when > 5 for when, _ in streams.granted) <= 10


def test_hundreds_of_links():
    """Random links, seeded: every one is used, and none has its queue filled for long."""
    draw, shares, queues = random.Random(7), [], []
    for seed in range(200):
        rate = 10 ** draw.uniform(-0.5, 0.8)
        quality = Quality(rate=rate * 1e6, loss=draw.choice([0, 0.05, 0.2]), delay=draw.uniform(0, 0.08),
                          jitter=draw.choice([0, 0, 0.002]), queue=draw.uniform(0.15, 0.5))
        events, channel = Events(), Channel(quality, seed)
        robot = Robot(events, channel, Channel(Quality(loss=quality.loss, delay=quality.delay), seed + 1), greedy, seed)
        events.run(6)
        shares.append(used(robot, rate, 3, 6))
        queues.append(np.percentile(sent(robot, 3)[:, 2], 95))
    assert np.percentile(shares, 5) >= 0.85 and min(shares) >= 0.5
    assert np.percentile(queues, 95) <= 0.06


@pytest.mark.parametrize('jump', [3600.0, -3600.0])
def test_a_receiver_whose_clock_jumps_neither_stalls_nor_bursts(jump):
    """Its steady clock, that is: no other clock is read."""
    events, there, robot = link(2)
    events.run(5)
    robot.operators_clock += jump
    dropped = there.counts.dropped
    events.run(5 + 0.1 * CONFIRMED + 2)
    assert used(robot, 2, 5, 7.3) <= 1.3
    events.run(10)
    assert used(robot, 2, 7.3, 10) >= 0.8
    assert there.counts.dropped - dropped < 20


@pytest.mark.parametrize('change, settled', [({'delay': 0.07}, 10), ({'loss': 0.2}, 7)])
def test_a_way_that_becomes_longer_and_loss_that_sets_in_are_no_queue(change, settled):
    events, there, robot = link(5)
    events.run(5)
    there.quality = replace(there.quality, **change)
    events.run(15)
    assert used(robot, 5, settled, 15) >= 0.85


def test_reports_that_stay_away_and_come_again():
    events, _, robot = link(5, limits=Limits(floor=0.2 * MBIT))
    events.run(5)
    robot.back.quality = replace(robot.back.quality, loss=1.0)
    events.run(10)
    assert robot.estimator.rate <= 0.25 * MBIT
    assert robot.estimator.missing
    robot.back.quality = replace(robot.back.quality, loss=0.0)
    events.run(15)
    assert used(robot, 5, 12, 15) >= 0.85
    assert not robot.estimator.missing


def test_robots_that_share_the_air():
    events, there = Events(), Channel(Quality(rate=20e6, delay=0.02, queue=0.2), 1)
    back, draw = Channel(Quality(delay=0.02), 2), random.Random(3)
    robots = [Robot(events, there, back, lambda robot: events.at(draw.uniform(0, 5), greedy, robot), seed)
              for seed in range(10)]
    events.run(30)
    shares = np.array([sent(robot, 15)[:, 1].sum() for robot in robots])
    assert shares.sum() * 8e-6 / 15 / 20 >= 0.85
    assert shares.sum() ** 2 / (len(shares) * (shares ** 2).sum()) >= 0.7     # Jain's index
