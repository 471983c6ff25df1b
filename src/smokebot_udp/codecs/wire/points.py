# SPDX-License-Identifier: BSD-3-Clause
"""The points of a sensor_msgs/PointCloud2 of any layout as plain arrays."""
from typing import Any, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ...arrays import Array, Buffer, DType, Float32Array

DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
"""{sensor_msgs/PointField datatype: numpy type}"""

FLOATS = 7, 8


class Cloud(NamedTuple):
    """The finite points of a cloud, in its order."""
    points: Float32Array
    """(n, 3) x, y, z [m]"""
    intensity: Optional[Float32Array]
    """(n,)"""
    extra: Array
    """(n,) structured array of the further fields: little-endian unsigned integers with the bytes of the values."""
    datatypes: Tuple[int, ...]
    """Of the further fields."""


def as_points(data: Buffer, fields: Iterable[Any], height: int, width: int, point_step: int, row_step: int,
              is_bigendian: bool, with_intensity: bool = False) -> Tuple[Float32Array, Optional[Float32Array]]:
    """The finite points of a cloud, organised or not.

    :param fields: sensor_msgs/PointFields: objects with name, offset, datatype, count
    :return: (n, 3) float32 x, y, z [m], and (n,) float32 intensity, or None if not requested or not present; in the
        cloud's order, without points whose coordinates are NaN or infinite
    :raises ValueError: names the wrong field and its value
    """
    cloud = read_cloud(data, fields, height, width, point_step, row_step, is_bigendian, with_intensity)
    return cloud.points, cloud.intensity


def read_cloud(data: Buffer, fields: Iterable[Any], height: int, width: int, point_step: int, row_step: int,
               is_bigendian: bool, with_intensity: bool = False, further: Sequence[str] = ()) -> Cloud:
    """As as_points, with further fields of any type.

    :param further: their names; those that the cloud does not have are left out
    :raises ValueError: names the wrong field and its value
    """
    by_name = {field.name: field for field in fields}
    for name in 'xyz':
        if name not in by_name:
            raise ValueError('the cloud has no field %s, only %s' % (name, ', '.join(map(repr, by_name)) or 'none'))
        if by_name[name].datatype not in FLOATS:
            raise ValueError('field %s is of datatype %d, must be FLOAT32 (7) or FLOAT64 (8)' % (
                name, by_name[name].datatype))
    with_intensity = with_intensity and 'intensity' in by_name and 'intensity' not in further
    further = [name for name in further if name in by_name]
    for name in further:
        if by_name[name].count > 1:
            raise ValueError('field %s has %d values a point, must be one' % (name, by_name[name].count))
    names = ['x', 'y', 'z'] + ['intensity'] * with_intensity
    formats = [_format(by_name[name], point_step, is_bigendian) for name in names]
    offsets = [by_name[name].offset for name in names]
    row_step = _row_step(data, height, width, point_step, row_step)
    dtype = np.dtype({'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': point_step})
    grid: Array = np.ndarray((height, width), dtype, data, 0, (row_step, point_step))
    points = np.empty((height * width, 3), np.float32)
    with np.errstate(over='ignore', invalid='ignore'):     # float64 beyond float32; signalling NaNs
        for axis, name in enumerate('xyz'):
            points[:, axis] = grid[name].reshape(-1)
        intensity = grid['intensity'].reshape(-1).astype(np.float32) if with_intensity else None
    extra = _raw(data, [by_name[name] for name in further], (height, width), (row_step, point_step), is_bigendian)
    finite = np.isfinite(points)
    if not finite.all():
        finite = finite.all(axis=1)
        points = points[finite]
        intensity = None if intensity is None else intensity[finite]
        extra = extra[finite]
    return Cloud(points, intensity, extra, tuple(by_name[name].datatype for name in further))


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
    dtype = np.dtype(DATATYPES[field.datatype])
    if field.offset + dtype.itemsize > point_step:
        raise ValueError('field %s has bytes %d to %d, point_step is %d' % (
            field.name, field.offset, field.offset + dtype.itemsize - 1, point_step))
    return dtype.newbyteorder('>' if is_bigendian else '<')


def _row_step(data: Buffer, height: int, width: int, point_step: int, row_step: int) -> int:
    """Distance between rows [byte]. Some drivers set row_step wrong if there is only one row."""
    if height == 0 or width == 0:
        raise ValueError('the cloud is empty: height %d, width %d' % (height, width))
    if height == 1 and len(data) == width * point_step:
        return len(data)
    if row_step < width * point_step:
        raise ValueError('row_step is %d, width x point_step is %d x %d = %d' % (
            row_step, width, point_step, width * point_step))
    if len(data) != height * row_step:
        raise ValueError('data has %d bytes, height x row_step is %d x %d = %d' % (
            len(data), height, row_step, height * row_step))
    return row_step
