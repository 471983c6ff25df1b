# SPDX-License-Identifier: BSD-3-Clause
import math
import struct
from types import SimpleNamespace
from typing import Any, Callable, List, Optional, Sequence, Tuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.codecs.wire.points import DATUM_STEP, FAR, as_points, read_cloud

pytestmark = pytest.mark.filterwarnings('error')

CODES = {1: 'b', 2: 'B', 3: 'h', 4: 'H', 5: 'i', 6: 'I', 7: 'f', 8: 'd'}
"""{PointField datatype: as struct writes it}"""
RANGES = {1: (-128, 127), 2: (0, 255), 3: (-2 ** 15, 2 ** 15 - 1), 4: (0, 2 ** 16 - 1), 5: (-2 ** 31, 2 ** 31 - 1),
          6: (0, 2 ** 32 - 1)}


def field(name: str, offset: int, datatype: int = 7, count: int = 1) -> SimpleNamespace:
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


def message(data: bytes, fields: Sequence[SimpleNamespace], height: int, width: int, point_step: int, row_step: int,
            is_bigendian: bool = False) -> SimpleNamespace:
    """Like a PointCloud2."""
    return SimpleNamespace(data=data, fields=fields, height=height, width=width, point_step=point_step,
                           row_step=row_step, is_bigendian=is_bigendian)


XYZ = [field('x', 0), field('y', 4), field('z', 8)]
XYZI = [*XYZ, field('intensity', 12)]


def read(data: bytes, fields: Sequence[SimpleNamespace] = XYZ, height: int = 1, width: int = 1, point_step: int = 12,
         row_step: Optional[int] = None, is_bigendian: bool = False,
         intensity: bool = False) -> Tuple[List[List[float]], Optional[List[float]]]:
    points, values = as_points(message(data, fields, height, width, point_step, point_step * width if row_step is None
                                       else row_step, is_bigendian), intensity)
    assert points.dtype == np.float32 and (values is None or values.dtype == np.float32)
    return points.tolist(), None if values is None else values.tolist()


def test_by_hand() -> None:
    data = struct.pack('<6f', 1, 2, 3, -4, 5.5, 6)
    assert read(data, width=2) == ([[1, 2, 3], [-4, 5.5, 6]], None)


def test_fields_in_any_order_with_gaps() -> None:
    data = struct.pack('<f2xHf1xf', 3, 77, 1, 2)
    fields = [field('z', 0), field('ring', 6, 4), field('x', 8), field('y', 13)]
    assert read(data, fields, point_step=17)[0] == [[1, 2, 3]]


def test_float64_and_big_endian() -> None:
    fields = [field('x', 0, 8), field('y', 8, 7), field('z', 12, 8), field('intensity', 20, 4)]
    data = struct.pack('>dfdH', 1.5, 2.5, -3.5, 0x0102)
    assert read(data, fields, point_step=22, is_bigendian=True, intensity=True) == ([[1.5, 2.5, -3.5]], [0x0102])


def test_an_organised_cloud_is_read_row_by_row() -> None:
    rows = [struct.pack('<6f', *range(row, row + 6)) for row in (0, 10)]
    points = [[0, 1, 2], [3, 4, 5], [10, 11, 12], [13, 14, 15]]
    assert read(b''.join(rows), height=2, width=2)[0] == points
    assert read(b''.join(row + b'\xee' * 5 for row in rows), height=2, width=2, row_step=29)[0] == points


@pytest.mark.parametrize('row_step', [0, 1, 24, 48, 2 ** 32 - 1])
def test_a_single_rows_step_does_not_matter(row_step) -> None:
    assert read(struct.pack('<6f', 1, 2, 3, 4, 5, 6), width=2, row_step=row_step)[0] == [[1, 2, 3], [4, 5, 6]]


def test_a_single_row_may_be_padded() -> None:
    assert read(struct.pack('<3f4x', 1, 2, 3), row_step=16)[0] == [[1, 2, 3]]


FOUR = struct.pack('<12f', *range(12))
ORGANISED = {'data': FOUR, 'fields': XYZ, 'height': 2, 'width': 2, 'point_step': 12, 'row_step': 24, 'is_bigendian': 0}


@pytest.mark.parametrize('change, problem', [
    ({'row_step': 48}, 'row_step is 48, by the data it is 24'),         # that of all rows
    ({'row_step': 0}, 'row_step is 0, by the data it is 24'),
    ({'row_step': 23}, 'row_step is 23, by the data it is 24'),
    ({'row_step': 25}, 'row_step is 25, by the data it is 24'),
    ({'row_step': 2 ** 32 - 1}, 'row_step is 4294967295, by the data it is 24'),
    ({'height': 0}, 'height is 0, by the data it is 2'),
    ({'point_step': 0}, 'point_step is 0, by the data it is 12'),
    ({'height': 0, 'width': 4, 'row_step': 0}, 'height is 0, by the data it is 1')])
def test_a_number_that_contradicts_the_data_is_told_and_not_used(change, problem) -> None:
    cloud = read_cloud(message(**{**ORGANISED, **change}))
    assert cloud.points.tolist() == np.arange(12).reshape(4, 3).tolist() and cloud.problems == (problem,)
    assert read_cloud(message(**ORGANISED)).problems == ()


@pytest.mark.parametrize('change', [{'width': 0}, {'height': 0}, {'width': 0, 'height': 0, 'point_step': 0},
                                    {'width': 0, 'fields': []}, {'width': 0, 'row_step': 0}])
def test_a_cloud_in_which_nothing_was_seen_has_no_points(change) -> None:
    cloud = read_cloud(message(**{**ORGANISED, 'data': b'', **change}), with_intensity=True, further=['ring'])
    assert cloud.points.shape == (0, 3) and cloud.problems == () and len(cloud.extra) == 0


UTM = 412345.125, 5401234.5, 312.0625
DOUBLES = [field(name, 8 * i, 8) for i, name in enumerate('xyz')]


def doubles(points: Any) -> Any:
    points = np.asarray(points, '<f8')
    return read_cloud(message(points.tobytes(), DOUBLES, 1, len(points), 24, points.nbytes))


def test_doubles_far_from_the_origin_keep_their_precision() -> None:
    exact = np.random.RandomState(0).uniform(-200, 200, (5000, 3)) + UTM
    cloud = doubles(exact)
    assert cloud.points.dtype == np.float32 and cloud.problems == ()
    assert cloud.datum.tolist() == [412672, 5401600, 0]
    assert np.abs(cloud.points.astype(float) + cloud.datum - exact).max() < 5e-5


def test_a_wild_value_costs_the_others_no_precision_and_is_told() -> None:
    exact = np.random.RandomState(0).uniform(-200, 200, (5000, 3)) + UTM
    for wild in (1e12, -1e12, 0.0, np.nan):
        exact[0, 1] = wild
        cloud = doubles(exact)
        first = int(np.isfinite(wild))
        assert np.abs(cloud.points[first:].astype(float) + cloud.datum - exact[1:]).max() < 5e-5
        assert len(cloud.problems) == (abs(wild) == 1e12) and all('are rounded by up to' in p for p in cloud.problems)


def test_doubles_near_the_origin_are_absolute() -> None:
    exact = np.random.RandomState(0).uniform(-200, 200, (50, 3))
    exact[0] = 1e12
    cloud = doubles(exact)
    assert cloud.datum is None and cloud.points.tolist() == exact.astype(np.float32).tolist()
    assert len(cloud.problems) == 1
    assert doubles(exact[1:]).problems == () == doubles(np.full((2, 3), np.nan)).problems


@pytest.mark.parametrize('datatype, value, rounded', [(6, 2 ** 24 + 1, True), (5, -2 ** 31 + 1, True),
                                                      (6, 2 ** 24, False), (5, 77, False), (8, 0.1, False)])
def test_an_intensity_that_float32_rounds_is_told(datatype, value, rounded) -> None:
    data = struct.pack('<3f' + CODES[datatype], 1, 2, 3, value)
    cloud = read_cloud(message(data, [*XYZ, field('intensity', 12, datatype)], 1, 1, len(data), len(data)), True)
    assert len(cloud.problems) == rounded


@pytest.mark.parametrize('count', [0, 1, 3])
def test_count_does_not_matter(count) -> None:
    fields = [field(name, offset, 7, count) for name, offset in zip('xyz', (0, 4, 8))]
    assert read(struct.pack('<3f', 1, 2, 3), fields)[0] == [[1, 2, 3]]


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('axis', [0, 1, 2])
def test_points_that_are_not_finite_are_left_out_with_their_intensity(bad, axis) -> None:
    values = np.arange(12, dtype='<f4').reshape(3, 4)
    values[1, axis] = bad
    assert read(values.tobytes(), XYZI, width=3, point_step=16, intensity=True) == ([[0, 1, 2], [8, 9, 10]], [3, 11])


def test_an_intensity_that_is_not_finite_costs_no_point() -> None:
    points, intensity = read(struct.pack('<4f', 1, 2, 3, math.nan), XYZI, point_step=16, intensity=True)
    assert points == [[1, 2, 3]] and math.isnan(intensity[0])


def test_float64_beyond_float32_and_signalling_nans_are_quiet() -> None:
    fields = [field(name, 8 * i, 8) for i, name in enumerate(('x', 'y', 'z', 'intensity'))]
    data = struct.pack('<4d', 1e300, 2, 3, 4) + struct.pack('<3dQ', 1, 2, 3, 0x7ff0000000000001)
    data += struct.pack('<2dQd', 1, 2, 0x7ff0000000000001, 4) + struct.pack('<4d', 1, 2, 3, -1e300)
    points, intensity = read(data, fields, width=4, point_step=32, intensity=True)
    assert points == [[1, 2, 3], [1, 2, 3]]
    assert math.isnan(intensity[0]) and intensity[1] == -math.inf


def test_intensity_only_where_asked_for_and_there() -> None:
    data = struct.pack('<4f', 1, 2, 3, 4)
    assert read(data, XYZI, point_step=16)[1] is None
    assert read(data, XYZ, point_step=16, intensity=True)[1] is None
    assert read(data, XYZI, point_step=16, intensity=True)[1] == [4]


def values_of(datatype: int) -> st.SearchStrategy:
    if datatype in RANGES:
        return st.integers(*RANGES[datatype])
    return st.floats(width=32) if datatype == 7 else st.floats()


@st.composite
def clouds(draw: Callable[..., Any]) -> Tuple[SimpleNamespace, List[dict]]:
    """A message, and each point's {name: value}: laid out at random, written by struct."""
    fields, at = [], 0
    for name in draw(st.permutations(['x', 'y', 'z', 'intensity', 'ring'])):
        at += draw(st.integers(0, 3))
        datatype = draw(st.sampled_from((7, 8) if name in 'xyz' else sorted(CODES)))
        fields.append(field(name, at, datatype, draw(st.integers(0, 1))))
        at += struct.calcsize(CODES[datatype])
    point_step = at + draw(st.integers(0, 3))
    height, width = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    row_step = point_step * width + draw(st.integers(0, 9))
    order = draw(st.sampled_from('<>'))
    data, points = bytearray(draw(st.sampled_from((b'\0', b'\xff'))) * (height * row_step)), []
    for row in range(height):
        for column in range(width):
            point = {one.name: draw(values_of(one.datatype)) for one in fields}
            for one in fields:
                struct.pack_into(order + CODES[one.datatype], data, row * row_step + column * point_step + one.offset,
                                 point[one.name])
            points.append(point)
    return message(bytes(data), fields, height, width, point_step, row_step, order == '>'), points


@settings(deadline=None)
@given(clouds())
def test_any_layout(cloud) -> None:
    given_cloud, points = cloud
    cloud = read_cloud(given_cloud, with_intensity=True)
    exact = np.array([[point[name] for name in ('x', 'y', 'z', 'intensity')] for point in points], float)
    if cloud.datum is not None:
        assert np.abs(cloud.datum).max() >= DATUM_STEP * (FAR // DATUM_STEP)
        exact[:, :3] -= cloud.datum
    with np.errstate(over='ignore', invalid='ignore'):     # signalling NaNs raise it
        expected = exact.astype(np.float32)
    expected = expected[np.isfinite(expected[:, :3]).all(axis=1)]
    np.testing.assert_array_equal(cloud.points, expected[:, :3])
    np.testing.assert_array_equal(cloud.intensity, expected[:, 3])
    assert as_points(given_cloud)[1] is None


@pytest.mark.parametrize('change, error', [
    ({'fields': XYZ[1:]}, "no field x, only 'y', 'z'"),
    ({'fields': XYZ[:2]}, "no field z, only 'x', 'y'"),
    ({'fields': []}, 'no field x, only none'),
    ({'fields': [field('x', 0, 3), *XYZ[1:]]}, 'field x is of datatype 3, must be FLOAT32'),
    ({'fields': [field('x', 0, 0), *XYZ[1:]]}, 'field x is of datatype 0'),
    ({'fields': [*XYZ[:2], field('z', 9)]}, 'field z has bytes 9 to 12, point_step is 12'),
    ({'fields': [*XYZ[:2], field('z', 8, 8)]}, 'field z has bytes 8 to 15, point_step is 12'),
    ({'fields': [*XYZ[:2], field('z', 2 ** 32 - 1)]}, 'field z has bytes 4294967295 to 4294967298, point_step is 12'),
    ({'fields': [*XYZ, field('intensity', 0, 9)]}, 'field intensity is of datatype 9, must be from 1 to 8'),
    ({'fields': [*XYZ, field('intensity', 11, 4)]}, 'field intensity has bytes 11 to 12, point_step is 12'),
    ({'width': 0}, 'data has 48 bytes, height x width x point_step is 2 x 0 x 12'),
    ({'width': 0, 'height': 0}, 'data has 48 bytes, height x width x point_step is 0 x 0 x 12'),
    ({'height': 0, 'point_step': 0}, 'data has 48 bytes, height x width x point_step is 0 x 2 x 0'),
    ({'height': 0, 'width': 3}, 'data has 48 bytes, height x width x point_step is 0 x 3 x 12'),
    ({'data': bytes(47)}, 'data has 47 bytes, height x width x point_step is 2 x 2 x 12, row_step is 24'),
    ({'data': bytes(49)}, 'data has 49 bytes'),
    ({'data': b''}, 'data has 0 bytes'),
    ({'height': 1}, 'data has 48 bytes, height x width x point_step is 1 x 2 x 12, row_step is 24'),
    ({'width': 2 ** 31}, 'data has 48 bytes, height x width x point_step is 2 x 2147483648 x 12, row_step is 24'),
    ({'width': 2 ** 32 - 1, 'height': 2 ** 32 - 1, 'row_step': 2 ** 32 - 1}, 'data has 48 bytes, height x'),
    ({'height': 2 ** 31}, 'data has 48 bytes, height x width x point_step is 2147483648 x 2 x 12'),
    ({'point_step': 0, 'data': bytes(16)}, 'field y has bytes 4 to 7, point_step is 4'),
    ({'point_step': 0, 'data': bytes(47)}, 'height x width x point_step is 2 x 2 x 0'),
    ({'point_step': 0, 'row_step': 0, 'data': b''}, 'data has 0 bytes'),
    ({'point_step': 11}, 'field z has bytes 8 to 11, point_step is 11'),
    ({'point_step': 2 ** 31}, 'data has 48 bytes, height x width x point_step is 2 x 2 x 2147483648'),
    ({'point_step': 2 ** 32 - 1}, 'data has 48 bytes, height x width x point_step is 2 x 2 x 4294967295')])
def test_bad_clouds(change, error) -> None:
    cloud = message(**{'data': bytes(48), 'fields': XYZ, 'height': 2, 'width': 2, 'point_step': 12, 'row_step': 24,
                       **change})
    with pytest.raises(ValueError, match=error):
        as_points(cloud, True)


NUMBERS = st.sampled_from([0, 1, 2, 3, 4, 12, 24, 2 ** 16, 2 ** 31 - 1, 2 ** 31, 2 ** 32 - 1])
FIELDS = st.builds(field, st.sampled_from(['x', 'y', 'z', 'intensity', '']), NUMBERS, st.integers(0, 10), NUMBERS)


@given(st.lists(FIELDS, max_size=5), NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.sampled_from([0, 12, 24]))
def test_absurd_numbers_raise_nothing_else(fields, height, width, point_step, row_step, size) -> None:
    try:
        points, intensity = as_points(message(bytes(size), XYZ + fields, height, width, point_step, row_step), True)
    except ValueError:
        return
    assert points.shape == (height * width, 3) and (intensity is None or intensity.shape == (height * width,))
