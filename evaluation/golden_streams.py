# SPDX-License-Identifier: BSD-3-Clause
"""Streams whose datagrams are golden (tools/golden.py), and their sources: of integers only, so that these are the same
everywhere."""
from typing import Any, Callable, Mapping, NamedTuple, Sequence

import numpy as np
from genpy import Time
from geometry_msgs.msg import Pose, TransformStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from smokebot_udp.arrays import Array


class Stream(NamedTuple):
    """A stream whose datagrams are golden."""
    kind: str
    """Its `type` in streams.yaml."""
    robot: Mapping[str, Any]
    operator: Mapping[str, Any]
    source: Callable[[int], Any]
    """f(number) -> a message"""
    messages: int
    loss: int = 0
    """One datagram of as many is lost; 0: none."""
    repeats: int = 0
    """After each message the encoder sends so many times what is still to be sent."""
    alike: bool = True
    """Whether each release sends the same bytes."""


def noise(height: int, width: int, seed: int) -> Array:
    """(height, width) int64 from 0 to 15."""
    rows, columns = np.mgrid[:height, :width]
    mixed = (rows * 7919 + columns * 104729 + seed * 1299709) * 2654435761 & 0xffffffff
    return np.asarray((mixed ^ mixed >> 15) >> 7 & 15)


def scene(number: int, height: int = 96, width: int = 120, offset: int = 0, grain: int = 8) -> Array:
    """(height, width) int64 from 0 to 255: slopes and edges, which move by two pixels each image, and noise."""
    rows, columns = np.mgrid[:height, :width]
    columns = columns + 2 * number + offset
    slopes = abs((3 * columns + 2 * rows) % 256 - 128) + abs((rows * rows // 40 + columns) % 128 - 64) // 2
    return np.asarray(np.clip(slopes + 60 * (columns // 40 % 2) + noise(height, width, number) // grain, 0, 255))


def header(number: int, frame: str) -> Header:
    """The header of a message of a number."""
    return Header(stamp=Time(100 + number // 10, number % 10 * 10 ** 8), frame_id=frame)


def image(number: int, pixels: Array, encoding: str) -> Any:
    """A sensor_msgs/Image."""
    return Image(header=header(number, 'camera'), height=pixels.shape[0], width=pixels.shape[1], encoding=encoding,
                 step=pixels.nbytes // pixels.shape[0], data=pixels.tobytes())


def grey(number: int) -> Any:
    """A grey image. The scene moves at first, then stands still."""
    return image(number, scene(min(number, 5)).astype(np.uint8), 'mono8')


def thermal(number: int) -> Any:
    """A thermal image of 16 bits, in an odd size."""
    counts = 7000 + 9 * scene(min(number, 4), 81, 107, grain=16) + noise(81, 107, number) // 3
    return image(number, counts.astype('<u2'), 'mono16')


def colour(number: int) -> Any:
    """A colour image. Its planes show displaced scenes."""
    planes = [scene(number, 64, 90, 31 * plane) for plane in range(3)]
    return image(number, np.ascontiguousarray(np.dstack(planes), np.uint8), 'bgr8')


def depth(number: int) -> Any:
    """In whole millimetres, with a NaN and infinities."""
    metres = (scene(number, 50, 66) * 16).astype('<f4') / np.float32(1024)
    metres[10:20, 5:30], metres[30:33, 40:], metres[40:, :9] = np.nan, np.inf, -np.inf
    return image(number, metres, '32FC1')


def mosaic(number: int) -> Any:
    """A Bayer mosaic with an odd number of cells in a row."""
    return image(number, scene(number, 36, 54).astype(np.uint8), 'bayer_rggb8')


def occupancy(number: int) -> Any:
    """A map that grows, and whose origin moves by whole cells; walls, free and unknown cells, and graded ones."""
    height, width = 60 + 8 * number, 90
    rows, columns = np.mgrid[:height, :width] - np.array([4 * number, 0]).reshape(2, 1, 1)
    cells = np.where((rows % 20 == 3) | (columns % 24 == 7), 100, 0)
    cells[(rows * 3 + columns * 2) % 97 < 20 - 3 * number] = -1
    graded = (abs(rows - 30) < 9) & (abs(columns - 40) < 12)
    cells = np.where(graded, 30 + (rows + columns) % 40, cells).astype(np.int8)
    info = MapMetaData(resolution=0.05000000074505806, width=width, height=height, origin=Pose())
    info.origin.position.y, info.origin.orientation.w = -0.2 * number, 1.0
    return OccupancyGrid(header=header(number, 'map'), info=info, data=cells.ravel().tolist())


def points(number: int) -> Any:
    """A wall, a floor and clutter in steps of 1/64 m, with an intensity."""
    counted = np.arange(2400)
    x, y = counted * 37 % 640, counted * 53 % 480
    z = np.where(counted % 3 == 0, 0, np.where(counted % 3 == 1, counted * 11 % 160, counted * counted % 97 + number))
    cells = np.column_stack([x - 320, y - 240 + number, z]).astype('<f4') / np.float32(64)
    return cloud(number, np.column_stack([cells, counted * 29 % 200]).astype('<f4'), ('x', 'y', 'z', 'intensity'))


def cloud(number: int, values: Array, names: Sequence[str]) -> Any:
    """A sensor_msgs/PointCloud2 of float32."""
    fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(names)]
    return PointCloud2(header=header(number, 'lidar'), height=1, width=len(values), fields=fields, is_dense=True,
                       point_step=4 * len(names), row_step=values.nbytes, data=values.tobytes())


def ringed(number: int) -> Any:
    """Few points with a further field."""
    values = np.frombuffer(points(number).data, '<f4').reshape(-1, 4)[:300].copy()
    return cloud(number, values, ('x', 'y', 'z', 'ring'))


def scan(number: int) -> Any:
    """In millimetres, with NaN and infinities; the second one not in millimetres."""
    ranges = (1000 + np.arange(720) * 17 % 9000).astype(np.float32) / np.float32(1024 if number % 2 else 1000)
    ranges[5:9], ranges[100], ranges[200] = np.inf, -np.inf, np.nan
    return LaserScan(header=header(number, 'laser'), angle_min=-3.0, angle_max=3.0, angle_increment=0.008,
                     range_min=0.25, range_max=30.0, ranges=ranges.tolist(),
                     intensities=(np.arange(720) % 256).astype(np.float32).tolist())


def log(number: int) -> Any:
    """A message that is compressed and takes several datagrams."""
    text = ' '.join('%d' % (value * value * 7919 % 10007) for value in range(900))
    return Log(header=header(number, 'base'), level=2, name='/node', msg=text)


def transforms(number: int) -> Any:
    """Short ones."""
    found = []
    for child in ('base', 'laser'):
        transform = TransformStamped(header=header(number, 'odom'), child_frame_id=child)
        transform.transform.rotation.w, transform.transform.translation.x = 1.0, number / 8
        found.append(transform)
    return TFMessage(found)


LAYERED = {'coding': 'layered', 'max_bytes': 3000}
STREAMS: Mapping[str, Stream] = {
    'layered_grey': Stream('image', LAYERED, {}, grey, 9, 5, alike=False),
    'layered_16_bits': Stream('image', {**LAYERED, 'max_bytes': 4000}, {}, thermal, 12, 4, alike=False),
    'layered_exact': Stream('image', {'coding': 'layered'}, {}, thermal, 3, alike=False),
    'layered_colour': Stream('image', LAYERED, {}, colour, 6, 6, alike=False),
    'layered_depth': Stream('image', {**LAYERED, 'depth_unit': 1 / 1024}, {}, depth, 4, 5, alike=False),
    'interleaved_mosaic': Stream('image', {'coding': 'interleaved'}, {}, mosaic, 2),
    'video': Stream('image', {'coding': 'h264', 'max_bytes': 2500}, {}, lambda number: image(
        number, scene(number).astype(np.uint8), 'mono8'), 9, 9, alike=False),
    'map_tiles': Stream('grid', {'coding': 'tiles', 'robot_frame': ''}, {}, occupancy, 4, 4, 25),
    'map_interleaved': Stream('grid', {'coding': 'interleaved'}, {}, occupancy, 2),
    'cloud_sorted': Stream('cloud', {'encoding': 'sorted', 'leaf_size': 0.0, 'intensity': True}, {}, points, 2, 5),
    'cloud_packed': Stream('cloud', {'encoding': 'packed', 'leaf_size': 0.0, 'intensity': True, 'fields': 'ring'}, {},
                           ringed, 1),
    'cloud_float32': Stream('cloud', {'encoding': 'float32', 'leaf_size': 0.0}, {}, ringed, 1, 3),
    'scan': Stream('scan', {'intensity': True}, {}, scan, 2, 3),
    'scan_exact': Stream('scan', {'exact': True}, {}, scan, 2),
    'relay_compressed': Stream('relay', {'message_type': 'rosgraph_msgs/Log'}, {'message_type': 'rosgraph_msgs/Log'},
                               log, 2, alike=False),       # zlib's, of which there are several
    'relay_transforms': Stream('relay', {'message_type': 'tf2_msgs/TFMessage'},
                               {'message_type': 'tf2_msgs/TFMessage'}, transforms, 4, 2, alike=False),     # likewise
}
