# SPDX-License-Identifier: BSD-3-Clause
from typing import List

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.congestion.operating_points import (
    LATE_RATE,
    STEP,
    OperatingPoint,
    cloud_points,
    image_points,
    layered_points,
    map_points,
    rate_points,
    with_late,
)

rates = st.floats(0.5, 30)


def check(points: List[OperatingPoint], most: float) -> None:
    """The cheapest first, in steps of at most sqrt(2) and what whole datagrams make of it, up to all."""
    costs = [point.cost for point in points]
    assert costs == sorted(set(costs)) and costs[0] > 0
    assert costs[-1] == pytest.approx(most)


def test_images_lose_subimages_and_rate() -> None:
    points = image_points(rate=10.0, subimages=64, per_datagram=1, datagram=1000,
                          degradation_preference=0.5, least_rate=2.0)
    assert points[-1] == ({'max_subimages': 0, 'rate': 10.0}, 640000.0)
    # a quarter of the bytes: half of the subimages, half of the images
    assert points[-9].settings == {'max_subimages': 32, 'rate': pytest.approx(5.0)}
    assert points[-9].cost == pytest.approx(160000)
    assert points[0] == ({'max_subimages': 1, 'rate': pytest.approx(2.0)}, pytest.approx(2000.0))


def test_preference_1_maintains_the_frame_rate() -> None:
    points = image_points(rate=8.0, subimages=16, per_datagram=1, datagram=1000,
                          degradation_preference=1.0, least_rate=2.0)
    assert all(point.settings['rate'] == pytest.approx(8.0, rel=0.5) for point in points if point.cost >= 8000)
    assert points[0] == ({'max_subimages': 1, 'rate': pytest.approx(2.0)}, pytest.approx(2000.0))


def test_preference_0_maintains_quality() -> None:
    points = image_points(rate=8.0, subimages=16, per_datagram=1, datagram=1000,
                          degradation_preference=0.0, least_rate=2.0)
    assert all(point.settings['max_subimages'] == 0 for point in points if point.cost >= 32000)


def test_a_thermal_image_on_the_slowest_link() -> None:
    # 320 x 240, 16 bits: 112 datagrams; half of 0.3 Mbit/s pays for two images a second and more
    points = image_points(rate=10.0, subimages=1024, per_datagram=9, datagram=1480)
    best = [point for point in points if point.cost <= 0.15e6 / 8][-1]
    assert best.settings['rate'] >= 2 and best.settings['max_subimages'] >= 16


def test_clouds_lose_resolution_and_rate() -> None:
    points = cloud_points(rate=10.0, leaf_size=0.1, size=40000)
    assert points[-1] == ({'leaf_size': 0.1, 'rate': 10.0}, 400000.0)
    assert points[-9].settings == {'leaf_size': pytest.approx(0.1414, abs=1e-4), 'rate': pytest.approx(5.0)}
    assert points[-9].cost == pytest.approx(100000)
    assert points[0] == ({'leaf_size': 1.0, 'rate': 1.0}, pytest.approx(400.0))


def test_maps_lose_refresh_cycles_first() -> None:
    points = map_points(repeat_rate=1.0, segments=100, size=1000, least_repeat=0.1, least_segments=10)
    assert all(point.settings['max_segments'] == 100 for point in points if point.cost >= 10000)
    assert points[0] == ({'repeat_rate': 0.1, 'max_segments': 10}, pytest.approx(1000.0))
    assert points[-1] == ({'repeat_rate': 1.0, 'max_segments': 100}, 100000.0)


def test_scans_lose_rate() -> None:
    assert [point.cost for point in rate_points(rate=4.0, size=1000)] == pytest.approx(
        [1000 * STEP ** step for step in range(9)])


@given(rates, st.integers(1, 4096), st.integers(1, 40), st.integers(300, 1500), st.floats(0, 1), rates)
def test_image_points(rate: float, subimages: int, per_datagram: int, datagram: int, preference: float,
                      least: float) -> None:
    points = image_points(rate, subimages, per_datagram, datagram, preference, least)
    check(points, rate * -(-subimages // per_datagram) * datagram)
    for point in points:
        assert min(rate, least) * (1 - 1e-9) <= point.settings['rate'] <= rate * (1 + 1e-9)
        assert 0 <= point.settings['max_subimages'] < max(subimages, 2)


@given(rates, st.floats(0.01, 3), st.floats(100, 1e6))
def test_cloud_points(rate: float, leaf: float, size: float) -> None:
    check(cloud_points(rate, leaf, size), rate * size)


@given(rates, st.integers(1, 300), st.integers(300, 1500))
def test_map_points(rate: float, segments: int, size: int) -> None:
    check(map_points(rate, segments, size), rate * segments * size)


def test_layered_images_lose_bytes_and_rate() -> None:
    points = layered_points(rate=16.0, size=64000, degradation_preference=0.5, fair_size=64000, least_size=1000,
                            least_rate=4.0)
    assert points[-1] == ({'rate': 16.0}, 1024000.0)
    # a quarter of the bytes: half of each image, half of the images
    assert points[-9] == ({'rate': pytest.approx(8.0)}, pytest.approx(256000))
    assert points[0] == ({'rate': pytest.approx(4.0)}, pytest.approx(4000.0))


def test_layered_images_lose_only_bytes_as_long_as_they_are_fair() -> None:
    points = layered_points(rate=16.0, size=64000, fair_size=4000, least_size=500, least_rate=4.0)
    assert all(point.settings['rate'] == pytest.approx(16.0) for point in points if point.cost >= 16 * 4000)
    poor = next(point for point in reversed(points) if point.cost <= 16 * 4000 / 16 * (1 + 1e-9))
    assert poor.settings == {'rate': pytest.approx(8.0)}       # three octaves of bytes, and one of images
    complete = layered_points(rate=16.0, size=64000, degradation_preference=0.0, fair_size=4000, least_rate=4.0)
    assert all(point.cost == pytest.approx(64000 * point.settings['rate']) for point in complete
               if point.cost >= 4 * 64000)


def test_rare_layered_images_leave_in_time() -> None:
    """One a second: its share of the link is what sends it within a quarter of a second."""
    points = layered_points(rate=1.0, size=40000, least_rate=4.0)
    assert points[-1] == ({'rate': 1.0}, 160000.0)
    assert all(point.settings['rate'] == 1.0 for point in points)


@given(rates, st.floats(500, 1e6), st.floats(0, 1), st.floats(100, 1e6), rates)
def test_layered_points(rate: float, size: float, preference: float, fair: float, least: float) -> None:
    points = layered_points(rate, size, preference, fair, 1000.0, least)
    check(points, int(max(size, 1000.0)) * max(rate, least))
    for point in points:
        assert min(rate, least) * (1 - 1e-9) <= point.settings['rate'] <= rate * (1 + 1e-9)


@pytest.mark.parametrize('rate', [10.0, 4.0, 1.5, 0.5])
def test_the_least_images_come_late_where_the_link_is_too_slow(rate: float) -> None:
    in_time = layered_points(rate, size=40000, least_size=600, least_rate=16.0)
    points = with_late(in_time, 16.0)
    assert points[8:] == in_time and points[8].cost == pytest.approx(600 * 16.0)
    check(points, points[-1].cost)
    for point in points[:8]:
        assert point.cost / 600 == pytest.approx(max(LATE_RATE, point.cost / 600))
        assert point.settings == {'rate': pytest.approx(min(rate, point.cost / 600))}
    assert points[0].cost == pytest.approx(600 * LATE_RATE)


def test_what_comes_rarely_anyway_comes_no_later() -> None:
    slow = layered_points(rate=1.0, size=600, least_size=600, least_rate=1.0)
    assert with_late(slow, 1.0) == with_late(slow, 0.5) == slow
