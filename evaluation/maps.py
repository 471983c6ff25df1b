# SPDX-License-Identifier: BSD-3-Clause
"""Maps to measure with, simulated and recorded, and how many bytes each way of coding takes."""
import pathlib
import zlib
from typing import Any, Dict, NamedTuple

import cv2
import numpy as np
from nav_msgs.msg import OccupancyGrid
from scipy import ndimage

from smokebot_udp.arrays import Array
from smokebot_udp.codecs.tiles.overview import overview
from smokebot_udp.codecs.tiles.tiling import Tiling
from smokebot_udp.codecs.wire.grid import UNKNOWN
from smokebot_udp.simulation.drive import Drive
from smokebot_udp.simulation.mapping import RESOLUTION, Mapper
from smokebot_udp.simulation.world import building

from . import TOP
from .offline_link import Sender, datagram_count, wire_size

RECORDINGS = TOP.parent / 'shared' / 'data' / 'maps'
OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196
"""Limits of the occupancy of occupied and of free cells, as map_server has them."""

ROOM = 1290
"""Room for data in a datagram of 1472 bytes, without MapTile's head [byte]."""

CORNER = -1000, -468
"""Column and row of a map's first cell on the lattice, such that roots and blocks of the overview are cut."""

INFLATION, DECAY = 0.8, 3.0
"""Radius of the inflation of costs [m], and their decay [1/m]."""


def recorded(name: str, graded: bool = False) -> Array:
    """The image of a map_server as cells: (height, width) int8, from south to north.

    :param graded: as with `mode: scale`; else trinary
    """
    grey = np.flipud(cv2.imread(str(RECORDINGS / (name + '.pgm')), cv2.IMREAD_UNCHANGED))
    occupancy = 1 - grey / 255.0
    between = 1 + (occupancy - FREE_BELOW) / (OCCUPIED_ABOVE - FREE_BELOW) * 98 if graded else UNKNOWN
    cells: Array = np.select([occupancy > OCCUPIED_ABOVE, occupancy < FREE_BELOW, grey == 205], [100, 0, UNKNOWN],
                             between).astype(np.int8)
    return cells


def recorded_names() -> Dict[str, pathlib.Path]:
    """The maps at hand, by name."""
    return {path.stem: path for path in sorted(RECORDINGS.glob('*.pgm'))}


def simulated() -> Array:
    """The building's map after one tour of the robot: (300, 500) int8."""
    drive, mapper = Drive(), Mapper(building(1))
    for time in np.arange(0.0, drive.period, 1.0):
        mapper.update(drive.pose(time))
    return mapper.cells


def costs(cells: Array) -> Array:
    """A map as costmap_2d inflates its obstacles: 100, 99 beside them, and then falling to 0."""
    distance = ndimage.distance_transform_edt(cells != 100) * RESOLUTION
    values = np.where(distance < 0.2, 99, 98 * np.exp(-DECAY * (distance - 0.2)))
    values[distance > INFLATION] = np.maximum(cells, UNKNOWN)[distance > INFLATION]
    values[cells == 100] = 100
    return values.astype(np.int8)


def map_message(cells: Array, resolution: float = RESOLUTION) -> Any:
    """A nav_msgs/OccupancyGrid of (height, width) int8 cells."""
    message = OccupancyGrid(data=cells.ravel())
    message.header.frame_id = 'map'
    message.info.height, message.info.width = cells.shape
    message.info.resolution, message.info.origin.orientation.w = resolution, 1.0
    return message


def png(cells: Array) -> bytes:
    """The whole map as the smallest PNG that OpenCV makes."""
    return bytes(cv2.imencode('.png', cells.view(np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])


class Sizes(NamedTuple):
    """Sizes of a map in all codings [byte]."""
    tiles: int
    """Size of the data of all tiles, without heads [byte]."""
    datagrams: int
    overview: int
    shift: int
    """Shift of the overview: its cells are 2^shift cells a side."""
    zlib: int
    """Size of the whole array in zlib's format, level 9 [byte]."""
    png: int
    interleaved: int
    """Size of a refresh cycle of the interleaved, reduced map, on the wire [byte]."""
    factor: int
    """Factor by which the interleaved map is reduced."""


def sizes(cells: Array) -> Sizes:
    """Code a map in all ways."""
    tiles = Tiling(ROOM).update(cells, CORNER)
    shift, pieces = overview(cells, CORNER, ROOM)
    frames = Sender('grid', coding='interleaved').frames(map_message(cells))
    assert datagram_count(frames)
    return Sizes(sum(len(tile.data) for tile in tiles), len(tiles), sum(len(piece.data) for piece in pieces), shift,
                 len(zlib.compress(cells.tobytes(), 9)), len(png(cells)), wire_size(frames),
                 round(float(frames[0].records['info']['resolution'][0]) / RESOLUTION))
