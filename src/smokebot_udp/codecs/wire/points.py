# SPDX-License-Identifier: BSD-3-Clause
"""The points of a sensor_msgs/PointCloud2 of any layout as plain arrays."""
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ...arrays import Array, Buffer, DType, Float32Array, FloatArray, IntArray


def bounding_box(points: Array) -> Array:
    """(2, 3): the least and the greatest coordinates of (n, 3) points, n >= 1."""
    rows = np.ascontiguousarray(points.T)       # a fifth of the time of minima along the short axis
    return np.stack([rows.min(axis=1), rows.max(axis=1)])


DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""{sensor_msgs/PointField datatype: numpy type}"""

FLOATS = 7, 8
WHOLE = 5, 6
"""Datatypes whose values FLOAT32 may round: integers of 32 bits."""

FAR, DATUM_STEP = 8192.0, 1024
"""Doubles whose median is farther from the origin than FAR are read relative to a datum, a multiple of DATUM_STEP: as
FLOAT32 they would be rounded by 0.5 mm and more, in UTM by 0.25 m [m]."""

ROUNDED = 1e-3
"""Doubles that are rounded by more deserve a warning [m]."""

SAMPLE = 1000
"""Points whose median is taken."""


class Cloud(NamedTuple):
    """The finite points of a cloud, in its order."""
    points: Array
    """(n, 3) float32 x, y, z [m]"""
    intensity: Optional[Float32Array]
    """(n,)"""
    extra: Array
    """(n,) structured array of the further fields: little-endian unsigned integers with the bytes of the values."""
    datatypes: Tuple[int, ...]
    """Datatypes of the further fields, as in sensor_msgs/PointField."""
    datum: Optional[IntArray] = None
    """(3,) int: what the points are relative to; None: they are not, FLOAT32 is good enough [m]."""
    problems: Tuple[str, ...] = ()
    """What contradicts the data, or was rounded."""


class Layout(NamedTuple):
    """Where the points of a cloud are."""
    height: int
    width: int
    point_step: int
    """[byte]"""
    row_step: int
    """[byte]"""
    problem: Tuple[str, ...] = ()
    """A field that contradicts the data, which decide."""


def as_points(message: Any, with_intensity: bool = False) -> Tuple[Float32Array, Optional[Float32Array]]:
    """The finite points of a cloud, organised or not.

    :param message: a sensor_msgs/PointCloud2, or an object with the same attributes; its header is not used
    :return: (n, 3) float32 x, y, z [m], and (n,) float32 intensity, or None if not requested or not present; in the
        cloud's order, without points whose coordinates are NaN or infinite
    :raises ValueError: names the wrong field and its value
    """
    cloud = read_cloud(message, with_intensity)
    points = cloud.points if cloud.datum is None else (cloud.points + cloud.datum).astype(np.float32)
    return points, cloud.intensity


def read_cloud(message: Any, with_intensity: bool = False, further: Sequence[str] = ()) -> Cloud:
    """As as_points, with further fields of any type; doubles far from the origin are relative to a datum.

    :param further: their names; those that the cloud does not have are left out
    :raises ValueError: names the wrong field and its value
    """
    data, is_bigendian = message.data, message.is_bigendian
    layout = _layout(data, message.height, message.width, message.point_step, message.row_step)
    if not layout.height * layout.width:    # whatever its fields are
        return Cloud(np.zeros((0, 3), np.float32), None, _raw(data, [], (0, 0), (0, 0), False), ())
    by_name = {field.name: field for field in message.fields}
    _check_coordinates(by_name)
    with_intensity = with_intensity and 'intensity' in by_name and 'intensity' not in further
    further = [name for name in further if name in by_name]
    for name in further:
        if by_name[name].count > 1:
            raise ValueError('field %s has %d values a point, must be one' % (name, by_name[name].count))
    names = ['x', 'y', 'z'] + ['intensity'] * with_intensity
    formats = [_format(by_name[name], layout.point_step, is_bigendian) for name in names]
    offsets = [by_name[name].offset for name in names]
    dtype: DType = np.dtype({'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': layout.point_step})
    shape, steps = (layout.height, layout.width), (layout.row_step, layout.point_step)
    grid: Array = np.ndarray(shape, dtype, data, 0, steps)
    points, datum, problems = _coordinates(grid)
    intensity = None
    if with_intensity:
        intensity, rounded = _intensity(grid['intensity'].reshape(-1), by_name['intensity'].datatype)
        problems += rounded
    extra = _raw(data, [by_name[name] for name in further], shape, steps, is_bigendian)
    finite = np.isfinite(points)
    if not finite.all():
        finite = finite.all(axis=1)
        points = points[finite]
        intensity = None if intensity is None else intensity[finite]
        extra = extra[finite]
    return Cloud(points, intensity, extra, tuple(by_name[name].datatype for name in further), datum,
                 layout.problem + problems)


def _check_coordinates(by_name: Mapping[str, Any]) -> None:
    """:raises ValueError: naming a coordinate that is missing or of a wrong type"""
    for name in 'xyz':
        if name not in by_name:
            raise ValueError('the cloud has no field %s, only %s' % (name, ', '.join(map(repr, by_name)) or 'none'))
        if by_name[name].datatype not in FLOATS:
            raise ValueError('field %s is of datatype %d, must be FLOAT32 (7) or FLOAT64 (8)' % (
                name, by_name[name].datatype))


def _coordinates(grid: Array) -> Tuple[Float32Array, Optional[IntArray], Tuple[str, ...]]:
    """(n, 3) float32 points, their datum, and how they were rounded, as of Cloud.

    :param grid: (height, width) structured array
    """
    if not any(grid.dtype[name].itemsize == 8 for name in 'xyz'):
        points = np.empty((grid.size, 3), np.float32)
        with np.errstate(invalid='ignore'):     # signalling NaNs
            for axis, name in enumerate('xyz'):
                points[:, axis] = grid[name].reshape(-1)
        return points, None, ()
    with np.errstate(over='ignore', invalid='ignore'):     # beyond float32; signalling NaNs
        exact = np.stack([grid[name].reshape(-1).astype(np.float64) for name in 'xyz'], axis=1)
        datum = _datum(exact)
        if datum is not None:
            exact -= datum
        points = exact.astype(np.float32)
        error = np.abs(exact - points)
    worst = float(error.max(where=np.isfinite(error), initial=0.0))
    return points, datum, ('coordinates of FLOAT64 are rounded by up to %.2g m: they are too far from the others'
                           % worst,) * (worst > ROUNDED)


def _datum(exact: FloatArray) -> Optional[IntArray]:
    """What doubles are to be relative to: about the middle of the cloud, wherever single ones are. None: nothing.

    :param exact: (n, 3) float64, n >= 1 [m]
    """
    sample = exact[::-(-len(exact) // SAMPLE)]
    sample = sample[np.isfinite(sample).all(axis=1)]
    if not len(sample):
        return None
    middle = np.median(sample, axis=0)
    if not FAR < np.abs(middle).max() < 2 ** 31 - DATUM_STEP:
        return None
    datum: IntArray = (np.rint(middle / DATUM_STEP) * DATUM_STEP).astype(np.int64)
    return datum


def _intensity(values: Array, datatype: int) -> Tuple[Float32Array, Tuple[str, ...]]:
    """(n,) float32 intensities, and whether they were rounded: integers are to be exact."""
    with np.errstate(over='ignore', invalid='ignore'):
        intensity: Float32Array = values.astype(np.float32)
    rounded = datatype in WHOLE and bool((intensity.astype(np.float64) != values).any())
    return intensity, ('field intensity has integers that FLOAT32 rounds; named in the setting fields it is sent as it '
                       'is',) * rounded


def _raw(data: Buffer, fields: List[Any], shape: Tuple[int, int], steps: Tuple[int, int], is_bigendian: bool) -> Array:
    """(n,) structured array of the bytes of some fields, as little-endian unsigned integers."""
    sizes = [(field.name, _format(field, steps[1], is_bigendian).itemsize) for field in fields]
    values: Array = np.empty(shape[0] * shape[1], [(name, '<u%d' % size) for name, size in sizes])
    for field, (name, size) in zip(fields, sizes):
        order = '>' if is_bigendian else '<'
        grid: Array = np.ndarray(shape, '%su%d' % (order, size), data, field.offset, steps)
        values[name] = grid.reshape(-1)
    return values


def _format(field: Any, point_step: int, is_bigendian: bool) -> DType:
    if field.datatype not in DATATYPES:
        raise ValueError('field %s is of datatype %d, must be from 1 to 8' % (field.name, field.datatype))
    dtype: DType = np.dtype(DATATYPES[field.datatype])
    if field.offset + dtype.itemsize > point_step:
        raise ValueError('field %s has bytes %d to %d, point_step is %d' % (
            field.name, field.offset, field.offset + dtype.itemsize - 1, point_step))
    return dtype.newbyteorder('>' if is_bigendian else '<')


def _layout(data: Buffer, height: int, width: int, point_step: int, row_step: int) -> Layout:
    """Where the points are. A height or point_step of 0, and any row_step, follow from the data and the others.

    :raises ValueError: the data are of another size, whichever of the numbers is wrong
    """
    given, size, problem = Layout(height, width, point_step, row_step), len(data), ''
    if not size and not height * width:
        return given
    if not height and width * point_step and size % (width * point_step) == 0:
        given = given._replace(height=size // (width * point_step))
        problem = 'height is 0, by the data it is %d' % given.height
    elif not point_step and height * width and size % (height * width) == 0:
        given = given._replace(point_step=size // (height * width))
        problem = 'point_step is 0, by the data it is %d' % given.point_step
    row = given.width * given.point_step
    if not size or not row or size not in (given.height * row, given.height * max(row_step, row)):
        raise ValueError('data has %d bytes, height x width x point_step is %d x %d x %d, row_step is %d' % (
            size, given.height, given.width, given.point_step, row_step))
    if row_step < row or given.height * row_step != size:   # else the rows may be padded
        # with one row it is not needed, and many drivers set it wrong
        if given.height > 1:
            problem = problem or 'row_step is %d, by the data it is %d' % (row_step, row)
        given = given._replace(row_step=row)
    return given._replace(problem=(problem,) if problem else ())
