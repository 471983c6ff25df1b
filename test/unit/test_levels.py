# SPDX-License-Identifier: BSD-3-Clause
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.operating_points import STEP, cloud_levels, image_levels, map_levels, rate_levels

rates = st.floats(0.5, 30)


def check(levels, most):
    """The cheapest first, in steps of at most sqrt(2) and what whole datagrams make of it, up to all."""
    costs = [level.cost for level in levels]
    assert costs == sorted(set(costs)) and costs[0] > 0
    assert costs[-1] == pytest.approx(most)


def test_a_picture_gives_way_in_subimages_and_in_pictures():
    levels = image_levels(rate=10.0, subimages=64, per_datagram=1, datagram=1000, taste=0.5, least_rate=2.0)
    assert levels[-1] == ({'max_subimages': 0, 'rate': 10.0}, 640000.0)
    # a quarter of the bytes: half of the subimages, half of the pictures
    assert levels[-9].settings == {'max_subimages': 32, 'rate': pytest.approx(5.0)}
    assert levels[-9].cost == pytest.approx(160000)
    assert levels[0] == ({'max_subimages': 1, 'rate': pytest.approx(2.0)}, pytest.approx(2000.0))


def test_with_taste_1_all_pictures_come_as_long_as_they_can():
    levels = image_levels(rate=8.0, subimages=16, per_datagram=1, datagram=1000, taste=1.0, least_rate=2.0)
    assert all(level.settings['rate'] == pytest.approx(8.0, rel=0.5) for level in levels if level.cost >= 8000)
    assert levels[0] == ({'max_subimages': 1, 'rate': pytest.approx(2.0)}, pytest.approx(2000.0))


def test_with_taste_0_pictures_stay_whole_as_long_as_they_can():
    levels = image_levels(rate=8.0, subimages=16, per_datagram=1, datagram=1000, taste=0.0, least_rate=2.0)
    assert all(level.settings['max_subimages'] == 0 for level in levels if level.cost >= 32000)


def test_a_thermal_picture_on_the_slowest_link():
    # 320 x 240, 16 bits: 112 datagrams; half of 0.3 Mbit/s pays for two pictures a second and more
    levels = image_levels(rate=10.0, subimages=1024, per_datagram=9, datagram=1480)
    best = [level for level in levels if level.cost <= 0.15e6 / 8][-1]
    assert best.settings['rate'] >= 2 and best.settings['max_subimages'] >= 16


def test_a_cloud_gets_larger_boxes_and_comes_less_often():
    levels = cloud_levels(rate=10.0, leaf_size=0.1, size=40000)
    assert levels[-1] == ({'leaf_size': 0.1, 'rate': 10.0}, 400000.0)
    assert levels[-9].settings == {'leaf_size': pytest.approx(0.1414, abs=1e-4), 'rate': pytest.approx(5.0)}
    assert levels[-9].cost == pytest.approx(100000)
    assert levels[0] == ({'leaf_size': 1.0, 'rate': 1.0}, pytest.approx(400.0))


def test_a_map_leaves_out_rounds_first():
    levels = map_levels(repeat_rate=1.0, segments=100, size=1000, least_repeat=0.1, least_segments=10)
    assert all(level.settings['max_segments'] == 100 for level in levels if level.cost >= 10000)
    assert levels[0] == ({'repeat_rate': 0.1, 'max_segments': 10}, pytest.approx(1000.0))
    assert levels[-1] == ({'repeat_rate': 1.0, 'max_segments': 100}, 100000.0)


def test_a_scan_comes_less_often():
    assert [level.cost for level in rate_levels(rate=4.0, size=1000)] == pytest.approx(
        [1000 * STEP ** step for step in range(9)])


@given(rates, st.integers(1, 4096), st.integers(1, 40), st.integers(300, 1500), st.floats(0, 1), rates)
def test_image_levels(rate, subimages, per_datagram, datagram, taste, least):
    levels = image_levels(rate, subimages, per_datagram, datagram, taste, least)
    check(levels, rate * -(-subimages // per_datagram) * datagram)
    for level in levels:
        assert min(rate, least) * (1 - 1e-9) <= level.settings['rate'] <= rate * (1 + 1e-9)
        assert 0 <= level.settings['max_subimages'] < max(subimages, 2)


@given(rates, st.floats(0.01, 3), st.floats(100, 1e6))
def test_cloud_levels(rate, leaf, size):
    check(cloud_levels(rate, leaf, size), rate * size)


@given(rates, st.integers(1, 300), st.integers(300, 1500))
def test_map_levels(rate, segments, size):
    check(map_levels(rate, segments, size), rate * segments * size)
