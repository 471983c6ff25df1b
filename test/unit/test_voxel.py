# SPDX-License-Identifier: BSD-3-Clause
import collections
from typing import Any, Callable, Optional, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp import optional
from smokebot_udp.arrays import Float32Array
from smokebot_udp.codecs.perception import voxel
from smokebot_udp.codecs.perception.voxel import Filtered, voxel_filter
from smokebot_udp.simulation.lidar import Lidar
from smokebot_udp.simulation.world import building

needs_numba = pytest.mark.skipif(optional.attempt('numba').module is None, reason='python3-numba is not installed')
pytestmark = pytest.mark.filterwarnings('error')
needs_pcl = pytest.mark.skipif(voxel.pcl is None, reason='python3-pcl is not installed')
WAYS = [pytest.param(voxel.filter_by_numpy, id='numpy'), pytest.param(voxel.filter_by_pcl, id='pcl', marks=needs_pcl),
        pytest.param(voxel.filter_by_loops, id='loops', marks=needs_numba),
        pytest.param(lambda points, leaf, intensity: voxel_filter(points, leaf, intensity), id='either')]
ULP = 2e-6
"""float32's at the far side of a scene of 20 m, rounded up [m]."""


def array(*rows: Any) -> Float32Array:
    return np.array(rows, np.float32)


def filtered(way: Callable[..., Filtered], points: Float32Array, leaf: float,
             intensity: Optional[Float32Array] = None) -> Filtered:
    centroids, mean = way(points, leaf, intensity)
    assert centroids.dtype == np.float32 and centroids.shape[1:] == (3,)
    assert (mean is None) == (intensity is None) and (mean is None or mean.dtype == np.float32)
    return centroids, mean


@pytest.mark.parametrize('way', WAYS)
def test_by_hand(way) -> None:
    points = array((0.25, 0.25, 1.5),                               # box 0 0 1
                   (0.5, 0.75, 0.25), (0, 0.25, 0.75),              # box 0 0 0
                   (0.5, 1.5, 0.5), (1.5, 0.5, 0.5), (-0.5, 0.5, 0.5),     # boxes 0 1 0, 1 0 0, -1 0 0
                   (-0.25, 0, 0))                                   # box -1 0 0 again
    intensity = array(7, 1, 2, 4, 5, 10, 20)
    centroids, mean = filtered(way, points, 1.0, intensity)
    assert centroids.tolist() == [[-0.375, 0.25, 0.25], [0.25, 0.5, 0.5], [1.5, 0.5, 0.5], [0.5, 1.5, 0.5],
                                  [0.25, 0.25, 1.5]]
    assert mean.tolist() == [15, 1.5, 5, 4, 7]
    assert filtered(way, points, 1.0)[0].tolist() == centroids.tolist()


@pytest.mark.parametrize('way', WAYS)
def test_a_border_belongs_to_the_box_beyond_it(way) -> None:
    points = array((-1, 0, 0), (-0.5, 0, 0), (0, 0, 0), (0.5, 0, 0), (1, 0, 0))
    assert filtered(way, points, 1.0)[0][:, 0].tolist() == [-0.75, 0.25, 1]


@pytest.mark.parametrize('way', WAYS)
def test_one_point_and_one_box(way) -> None:
    assert filtered(way, array((1, -2, 3)), 0.1)[0].tolist() == [[1, -2, 3]]
    assert filtered(way, array(*[(0.25, 0.5, 0.75)] * 9), 100.0, array(*range(9)))[1].tolist() == [4]


@pytest.mark.parametrize('way', WAYS)
@settings(deadline=None)
@given(points=st.lists(st.tuples(*[st.integers(-40, 40)] * 3), min_size=1, max_size=60),
       per_box=st.sampled_from([1, 4, 16]))
def test_each_box_has_its_points_mean_in_order(way, points, per_box) -> None:
    """On a grid of 1/64 m sums are exact, and a quarter of the points lies on borders."""
    boxes = collections.defaultdict(list)
    for number, point in enumerate(points):
        boxes[tuple(k // per_box for k in reversed(point))].append((*point, number))
    expected = [np.mean(boxes[box], axis=0) / (64, 64, 64, 1) for box in sorted(boxes)]
    numbers = np.arange(len(points), dtype=np.float32)
    centroids, mean = filtered(way, np.float32(points) / np.float32(64), per_box / 64, numbers)
    np.testing.assert_allclose(np.column_stack([centroids, mean]), expected, rtol=1e-6)


def simulated() -> Tuple[Float32Array, Float32Array]:
    """The finite points of a simulated revolution, and their intensities."""
    scan = Lidar(building(1), 0.9, 1).scan((1.5, 7, 0.3), 1.0)
    scan = scan[np.isfinite(scan['x'])]
    return np.stack([scan[name] for name in 'xyz'], axis=1), scan['intensity'].copy()


def random_cloud(scale: float) -> Tuple[Float32Array, Float32Array]:
    random = np.random.RandomState(5)
    return ((random.rand(20000, 3) - 0.5) * scale).astype(np.float32), (random.rand(20000) * 255).astype(np.float32)


def on_borders(leaf: float) -> Tuple[Float32Array, Float32Array]:
    """Points on the borders of voxels, and as near to them as float32 allows, on both sides."""
    random = np.random.RandomState(6)
    corners = (random.randint(-100, 100, (20000, 3)) * leaf).astype(np.float32)
    return np.nextafter(corners, corners + random.randint(-1, 2, corners.shape).astype(np.float32)), corners[:, 0]


@needs_pcl
@pytest.mark.parametrize('scene, leaf', [
    *[(simulated, leaf) for leaf in (0.02, 0.05, 0.1, 0.2, 1.0)],
    *[(lambda: random_cloud(20), leaf) for leaf in (0.1, 0.3, 1.0)], (lambda: random_cloud(1), 0.1),
    *[(lambda leaf=leaf: on_borders(leaf), leaf) for leaf in (0.1, 0.05, 0.15)]])
@pytest.mark.parametrize('way', [voxel.filter_by_numpy, pytest.param(voxel.filter_by_loops, marks=needs_numba)])
def test_all_ways_give_pcls_answer(way, scene, leaf) -> None:
    points, intensity = scene()
    for values in (None, intensity):
        by_pcl, ours = (filtered(one, points, leaf, values) for one in (voxel.filter_by_pcl, way))
        assert 1 < len(by_pcl[0]) < len(points)
        np.testing.assert_allclose(ours[0], by_pcl[0], rtol=0, atol=ULP)
        if values is not None:
            np.testing.assert_allclose(ours[1], by_pcl[1], rtol=2e-6)


SCENES = [simulated, lambda: on_borders(0.1),
          *[lambda scale=scale: random_cloud(scale) for scale in (1e-3, 1, 1e3, 1e8)]]


@needs_numba
@pytest.mark.parametrize('scene', SCENES)
@pytest.mark.parametrize('leaf', [0.03, 0.1, 5.0])
def test_the_loops_are_numpys_to_the_last_digit_but_one(scene, leaf) -> None:
    points, intensity = scene()
    for cloud in (points, points[::3], np.asfortranarray(points), points[:1]):
        by_loops, by_numpy = (way(cloud, leaf, intensity[:len(cloud)])
                              for way in (voxel.filter_by_loops, voxel.filter_by_numpy))
        assert len(by_loops[0]) == len(by_numpy[0])
        np.testing.assert_allclose(by_loops[0], by_numpy[0], rtol=2e-7)     # float64 sums in another order
        np.testing.assert_allclose(by_loops[1], by_numpy[1], rtol=2e-7)


@needs_numba
def test_loops_leave_the_cloud_as_it_is() -> None:
    points, intensity = random_cloud(5)
    points.setflags(write=False)
    intensity.setflags(write=False)
    before = points.copy(), intensity.copy()
    voxel.filter_by_loops(points, 0.1, intensity)
    assert (points == before[0]).all() and (intensity == before[1]).all()


def test_what_is_left_of_the_simulated_scene() -> None:
    points, intensity = simulated()
    centroids, mean = voxel_filter(points, 0.1, intensity)
    boxes = voxel.voxels_of(points, 0.1)
    assert len(centroids) == len(np.unique(boxes, axis=0)) < len(points) / 4
    assert (np.lexsort(voxel.voxels_of(centroids, 0.1).T) == np.arange(len(centroids))).all()
    assert points.min() <= centroids.min() and centroids.max() <= points.max()
    assert intensity.min() <= mean.min() and mean.max() <= intensity.max()


@pytest.mark.parametrize('loaded', [False, pytest.param(True, marks=needs_numba)])
@pytest.mark.parametrize('far', [
    pytest.param(1e5, id='beyond 2^31 boxes'), pytest.param(1e6, id='beyond 2^63 boxes'),
    pytest.param(1e30, id='beyond 2^63 boxes a side'), pytest.param(3e38, id='at the end of float32')])
def test_clouds_that_span_too_much_for_pcl(far, loaded) -> None:
    near = array((0.05, 0.05, 0.05), (0.06, 0.05, 0.05), (0.25, 0.05, 0.05), (0.05, 0.25, 0.05))
    corners = array((-far, -far, -far), (far, far, far))
    points = np.concatenate([corners[1:], near, corners[:1]])
    centroids, mean = voxel_filter(points, 0.1, np.arange(6, dtype=np.float32), loaded)
    expected = [corners[0], (0.055, 0.05, 0.05), near[2], near[3], corners[1]]
    np.testing.assert_allclose(centroids, expected, rtol=1e-6)
    assert mean.tolist() == [5, 1.5, 3, 4, 0]


def test_both_ways_to_order_boxes_agree() -> None:
    points, intensity = simulated()
    inside = voxel.filter_by_numpy(points, 0.1, intensity)
    far = np.array([(-1e9, -1e9, -1e9), (1e9, 1e9, 1e9)], np.float32)
    beyond = voxel.filter_by_numpy(np.concatenate([points, far]), 0.1, np.append(intensity, (0, 0)).astype(np.float32))
    np.testing.assert_array_equal(beyond[0][1:-1], inside[0])
    np.testing.assert_array_equal(beyond[1][1:-1], inside[1])


def test_a_small_cloud_far_away() -> None:
    """PCL counts from the origin too, in 32 bits."""
    points = array((1e9, 0, 0), (1e9, 0, 0), (1e9 + 1024, 0, 0), (1e9 + 2048, 0, 0))
    assert voxel_filter(points, 0.1)[0].tolist() == points[1:].tolist()


def test_a_side_that_pcl_rounds_up() -> None:
    """2^15 boxes by 2^16 - 1: PCL finds one more in x, by which they are too many for it."""
    points = array((-16384, 0, 0), (-16384, 0, 0), (16384 - 2 ** -10, 65534, 0))
    assert voxel_filter(points, 1.0)[0].tolist() == points[1:].tolist()


@needs_pcl
def test_pcl_is_used_where_it_can(monkeypatch) -> None:
    monkeypatch.setattr(voxel, 'filter_by_numpy', None)
    assert len(voxel_filter(*[simulated()[0], 0.1])[0]) > 1000


@pytest.mark.parametrize('loaded, unused', [(False, 'filter_by_loops'), (True, 'filter_by_numpy')])
def test_without_pcl(monkeypatch, loaded, unused) -> None:
    if loaded:
        pytest.importorskip('numba', reason='compiled loops need numba')
    for name in ('pcl', 'filter_by_pcl', unused):
        monkeypatch.setattr(voxel, name, None)
    assert len(voxel_filter(simulated()[0], 0.1, loaded=loaded)[0]) > 1000
