# SPDX-License-Identifier: BSD-3-Clause
"""What streams make of a link that is too slow for all they are asked for."""
from types import SimpleNamespace

import pytest

from smokebot_udp.mission.parameters import check
from smokebot_udp.nodes.allocation import Allocation
from smokebot_udp.streams.base import Link
from smokebot_udp.streams.cloud import CloudSender
from smokebot_udp.streams.grid import GridSender
from smokebot_udp.streams.image import ImageSender
from smokebot_udp.streams.relay import RelaySender

SIZE = 1500     # of a datagram on the air


def heard(kind, name, **settings):
    """A stream that is not started, and has an operator."""
    stream = kind(name, check({'robot_topic': '/in', 'weight': 1.0, **settings}, kind.PARAMETERS), Link(1472))
    stream._publisher = SimpleNamespace(get_num_connections=lambda: 1)
    return stream


def images(name, **settings):
    """A stream of pictures of 64 datagrams, ten a second."""
    stream = heard(ImageSender, name, **settings)
    stream._whole = 64, 1, SIZE
    return stream


class Outbox:
    def __init__(self):
        self.protected, self.shares = 0, {}

    def change(self, change):
        change(SimpleNamespace(set_share=self.shares.__setitem__))


def allocation(*streams):
    return Allocation({stream.name: stream for stream in streams}, Link(1472, Outbox()))


def taken(stream):
    """What an image stream takes of the link as it is granted [byte/s]."""
    return stream.settings['rate'] * (stream.settings['max_subimages'] or 64) * SIZE


def settled(made, budget, begin=0.0):
    """Divide until levels have gone up."""
    for step in range(50):
        made.divide(budget, begin + 0.1 * step)


def test_where_there_is_room_nothing_is_limited():
    stream = images('thermal')
    made = allocation(stream)
    for budget in (None, 2 * 640 * SIZE):
        settled(made, budget)
        assert stream.granted == {} and made.wanted == pytest.approx(640 * SIZE)


def test_a_slow_link_is_used_and_not_more():
    stream = images('thermal')
    made = allocation(stream)
    for budget in (500 * SIZE, 100 * SIZE, 20 * SIZE, 5 * SIZE):
        settled(made, budget)
        assert 0.8 * budget <= taken(stream) <= budget
        assert stream.settings['rate'] >= 2 or stream.settings['max_subimages'] == 1


def test_weights_and_floors_count():
    much, little, floor = images('much', weight=3.0), images('little'), images('floor', weight=0.0, floor=1.5 * 8 * 40)
    made = allocation(much, little, floor)
    settled(made, 200 * SIZE)
    assert taken(much) / taken(little) == pytest.approx(3, rel=0.5)
    assert 0.5 * 40 * SIZE < taken(floor) <= 40 * SIZE and made.shares['floor'] == pytest.approx(40 * SIZE)
    assert taken(much) + taken(little) + taken(floor) <= 200 * SIZE
    assert made._outbox.shares == made.shares


def test_what_is_protected_is_served_first():
    stream, relay = images('thermal'), heard(RelaySender, 'odom', message_type='nav_msgs/Odometry')
    made = allocation(stream, relay)
    for step in range(50):
        made._outbox.protected += 3 * SIZE      # thirty datagrams a second
        made.divide(100 * SIZE, 0.1 * step)
    assert 'odom' not in made.shares and 0.8 * 70 * SIZE < taken(stream) <= 70 * SIZE


def test_on_a_tiny_link_what_is_protected_comes_more_rarely_and_the_picture_goes_on():
    stream = images('thermal')
    odom = heard(RelaySender, 'odom', message_type='nav_msgs/Odometry', rate=10.0)
    slow = heard(RelaySender, 'gas', message_type='std_msgs/Float32', rate=0.5)
    made, now = allocation(stream, odom, slow), 0.0

    def hold(budget, seconds):
        nonlocal now
        for _ in range(round(10 * seconds)):
            now += 0.1
            made._outbox.protected += odom.settings['rate'] / 10 * 750
            made.divide(budget, now)
    hold(75000, 10)
    assert odom.settings['rate'] == 10 and odom.granted == {}
    hold(1000, 0.5)     # a dip
    hold(75000, 5)
    assert odom.granted == {}
    hold(10000, 10)
    assert odom.settings['rate'] == 5 and slow.settings['rate'] == 0.5 and stream.wanted
    hold(1000, 10)
    assert odom.settings['rate'] == 2.5
    hold(75000, 10)
    assert odom.settings['rate'] == 10 and odom.granted == {}


def test_datagrams_are_short_where_the_link_is_slow():
    stream = images('thermal')
    made = allocation(stream)
    for budget, size in ((None, 1472), (1e6, 1472), (40000, 736), (70000, 736), (130000, 1472), (70000, 1472)):
        made.divide(budget, 0.0)
        assert made._link.datagram_size == size


def test_who_cannot_even_have_the_least_waits_and_comes_back():
    stream = images('thermal')
    made = allocation(stream)
    settled(made, 1.0)
    assert stream.paused and not stream.wanted
    settled(made, 100 * SIZE, 10.0)
    assert not stream.paused and stream.wanted


def test_who_is_not_heard_off_or_unknown_leaves_the_link_to_others():
    stream, alone, off, unknown = images('thermal'), images('alone'), images('off', enabled=False), heard(
        ImageSender, 'unknown')
    alone._publisher = SimpleNamespace(get_num_connections=lambda: 0)
    made = allocation(stream, alone, off, unknown)
    settled(made, 100 * SIZE)
    assert set(made.shares) == {'thermal'} and taken(stream) > 80 * SIZE
    assert not unknown.paused and unknown.granted == {}


def test_what_is_set_by_hand_counts_at_once():
    stream = images('thermal')
    settled(allocation(stream), 100 * SIZE)
    assert 'max_subimages' in stream.granted
    stream.configure({'max_subimages': 5})
    assert stream.settings['max_subimages'] == 5 and stream.asked['max_subimages'] == 5


def test_a_cloud_gets_coarser_and_a_map_rarer():
    cloud, chart = heard(CloudSender, 'lidar', leaf_size=0.1), heard(GridSender, 'map')
    cloud._finest, chart._whole = 20 * SIZE, (40, SIZE)
    made = allocation(cloud, chart)
    settled(made, 60 * SIZE)
    assert cloud.settings['leaf_size'] > 0.1 and cloud.asked['leaf_size'] == 0.1
    settled(made, 3 * SIZE, 10.0)
    assert chart.settings['repeat_rate'] < chart.asked['repeat_rate']


def test_a_source_slower_than_asked_for_is_no_limit():
    stream = images('thermal', rate=50.0)
    made = allocation(stream)
    for step in range(50):
        stream.received = step      # ten a second
        made.divide(500 * SIZE, 0.1 * step)
    assert stream.settings['rate'] == 50 or stream.settings['rate'] < 9.5
    assert made.wanted == pytest.approx(640 * SIZE, rel=0.05)
