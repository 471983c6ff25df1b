# SPDX-License-Identifier: BSD-3-Clause
"""How the link controller divides the link among the streams."""
import pytest
from controlled_robot import SIZE, image, settled, taken

from smokebot_udp.congestion.controller import GRANT_TOLERANCE, PLANNING_SHARE, Controller, Demand
from smokebot_udp.congestion.estimator import Limits
from smokebot_udp.congestion.operating_points import OperatingPoint, rate_points


def test_a_link_with_room_limits_nothing() -> None:
    plan = settled(2 * 640 * SIZE, {'thermal': image()})
    assert plan.grants == {'thermal': {}} and plan.shares == {'thermal': pytest.approx(640 * SIZE)}


@pytest.mark.parametrize('datagrams', [500, 100, 20, 5])
def test_a_slow_link_is_used_and_not_exceeded(datagrams: int) -> None:
    grant = settled(datagrams * SIZE, {'thermal': image()}).grants['thermal']
    assert grant is not None and grant['rate'] >= 2 or grant['max_subimages'] == 1
    assert 0.8 * datagrams * SIZE <= taken(grant) <= datagrams * SIZE


def test_weights_and_min_bitrates_count() -> None:
    plan = settled(200 * SIZE, {'much': image(weight=3.0), 'little': image(),
                                'minimum': image(weight=0.0, min_bitrate=40 * SIZE)})
    takes = {name: taken(grant) for name, grant in plan.grants.items()}
    assert takes['much'] / takes['little'] == pytest.approx(3, rel=0.5)
    assert 0.5 * 40 * SIZE < takes['minimum'] <= 40 * SIZE and plan.shares['minimum'] == pytest.approx(40 * SIZE)
    assert sum(takes.values()) <= 200 * SIZE


def test_protected_streams_are_measured_and_served_first() -> None:
    controller = Controller(Limits(max_rate=100 * SIZE), False, 1472)
    plan = settled(100 * SIZE, {'thermal': image()}, controller, protected=30 * SIZE)
    assert 0.8 * 70 * SIZE < taken(plan.grants['thermal']) <= 70 * SIZE and set(plan.shares) == {'thermal'}
    assert controller.stats(5.0).wanted == pytest.approx(670 * SIZE, rel=0.001)
    assert plan.decimation == 1.0


def test_protected_streams_that_fill_a_slow_link_are_decimated() -> None:
    plan = settled(10000, {'thermal': image()}, protected=7500)
    assert plan.decimation == 0.5


def test_datagrams_are_short_on_a_slow_link() -> None:
    sizes = [Controller(Limits(max_rate=rate), False, 1472).tick(0.0, {}, 0).datagram_size for rate in (1e6, 40000)]
    assert sizes == [1472, 736]


def test_a_stream_that_cannot_even_have_its_cheapest_point_pauses() -> None:
    rate = 920 / PLANNING_SHARE
    controller, first = Controller(Limits(max_rate=rate), False, 1472), {'lidar': Demand(rate_points(10.0, 2000))}
    assert controller.tick(0.0, first, 0).grants == {'lidar': None}
    plan = settled(rate, {'lidar': Demand(rate_points(10.0, 500), rate=10.0)}, controller)
    assert plan.grants['lidar'] is not None and plan.grants['lidar']['rate'] == pytest.approx(1.49, abs=0.01)


def test_a_stream_without_a_demand_leaves_the_link_to_others() -> None:
    controller = Controller(Limits(max_rate=100 * SIZE), False, 1472)
    settled(100 * SIZE, {'thermal': image(), 'camera': image()}, controller)
    plan = settled(100 * SIZE, {'thermal': image()}, controller)
    assert set(plan.grants) == set(plan.shares) == {'thermal'} and taken(plan.grants['thermal']) > 80 * SIZE


def test_a_focus_switch_applies_at_once() -> None:
    controller = Controller(Limits(max_rate=100 * SIZE), False, 1472)
    before = settled(100 * SIZE, {'thermal': image(weight=9.0), 'camera': image(weight=1.0)}, controller)
    controller.forget()
    after = controller.tick(5.01, {'thermal': image(weight=1.0), 'camera': image(weight=9.0)}, 0)
    assert after.grants == {'thermal': before.grants['camera'], 'camera': before.grants['thermal']}


def test_a_rate_about_as_requested_is_no_limit() -> None:
    points = [OperatingPoint({'max_subimages': count, 'rate': 9.6}, 100.0 * count) for count in (1, 2, 3)]
    plan = settled(250.0, {'thermal': Demand(points, rate=10.0)})
    assert plan.grants == {'thermal': {'max_subimages': 2}}


def test_bandwidth_between_two_points_refines_by_weight() -> None:
    def demand(weight: float) -> Demand:
        return Demand([OperatingPoint({'leaf_size': 1.0}, 100.0), OperatingPoint({'leaf_size': 0.1}, 1000.0)], weight,
                      refine=lambda settings, spare: {'leaf_size': settings['leaf_size'] - spare / 1000})
    plan = settled(500 / PLANNING_SHARE, {'much': demand(2.0), 'little': demand(1.0)})
    assert plan.grants == {'much': {'leaf_size': pytest.approx(0.8)}, 'little': {'leaf_size': pytest.approx(0.9)}}


def test_a_source_rate_that_trembles_changes_no_granted_rate() -> None:
    controller, grants = Controller(Limits(max_rate=100 * SIZE), False, 1472), []
    for step in range(100):
        rate = 10.0 * (1 + 0.4 * GRANT_TOLERANCE * (-1) ** step)
        grants.append(controller.tick(0.1 * step, {'thermal': image(rate=rate)}, 0).grants['thermal'])
    assert len({grant['rate'] for grant in grants[50:]}) == 1
    slower = controller.tick(10.0, {'thermal': image(rate=8.0)}, 0).grants['thermal']
    assert slower['rate'] < 0.9 * grants[-1]['rate']
