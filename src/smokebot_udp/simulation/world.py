# SPDX-License-Identifier: BSD-3-Clause
"""The building: walls, furniture, people and fires, as upright prisms with a temperature and a colour.

x is east, y north, z up, the floor is at z = 0 (REP-103); metres, degrees Celsius, colours in BGR 0..255.
"""
from dataclasses import dataclass
from typing import Iterable, Iterator, Sequence, Set, Tuple

import numpy as np

from ..arrays import BoolArray, FloatArray

CEILING = 2.7
"""Height of the rooms [m]."""

SIZE = 21.0, 14.0
"""The building's outer dimensions, from (0, 0) [m]."""

ROBOT_HEIGHT = 1.0
"""Prisms above this height are not obstacles [m]."""

THICKNESS, DOOR = 0.2, 1.4
"""Thickness of walls, and width of doors [m]."""

ROOM_WALLS = (5.6, 8.4)
"""Coordinates y of the corridor's walls [m]."""

PARTITIONS = (7.0, 14.0)
"""Coordinates x of the walls between rooms [m]."""

DOORS = (3.5, 10.5, 17.5)
"""Coordinates x of the rooms' doors, on both sides of the corridor [m]."""

FLOOR, ROOF = -1, -2
"""Surface ids besides the prisms' indexes."""

Room = Tuple[int, int]
"""(column 0..2, row 0..1)"""


@dataclass(frozen=True)
class Prism:
    """An upright box with a rectangular base, rotated about its centre."""
    name: str
    centre: Tuple[float, float]
    """(x, y) [m]"""
    size: Tuple[float, float]
    """(along, across) [m]"""
    yaw: float
    """[rad]"""
    bottom: float
    """[m]"""
    top: float
    """[m]"""
    temperature: float
    """[degC]"""
    colour: Tuple[float, ...]
    """(b, g, r)"""
    flicker: float = 0.0
    """Part of its temperature above the room's that comes and goes, 0..1; only fires flicker."""

    def corners(self) -> FloatArray:
        """(4, 2) float: the base, counter-clockwise [m]."""
        along, across = self.size[0] / 2, self.size[1] / 2
        local = np.array([(-along, -across), (along, -across), (along, across), (-along, across)])
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.asarray(local @ np.array([(c, s), (-s, c)]) + self.centre)


class World:
    """P prisms, and their properties as arrays for the sensors.

    :param ambient: temperature of the rooms [degC]
    """

    def __init__(self, prisms: Iterable[Prism], ambient: float = 24.0) -> None:
        self.prisms = tuple(prisms)
        self.ambient = ambient
        corners = np.array([prism.corners() for prism in self.prisms])
        edges = np.roll(corners, -1, axis=1) - corners
        normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
        self.normals: FloatArray = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        """(P, 4, 2): outward normals of the sides; a point is inside where normal . point <= offset."""
        self.offsets: FloatArray = np.einsum('pij,pij->pi', self.normals, corners)
        """(P, 4) [m]"""
        self.bottom, self.top, self.temperature, self.flicker = (
            np.array([getattr(prism, field) for prism in self.prisms])
            for field in ('bottom', 'top', 'temperature', 'flicker'))
        self.to_ceiling: BoolArray = (self.bottom <= 0) & (self.top >= CEILING)
        """(P,) bool: prisms that hide everything behind them."""
        self.colour = np.array([prism.colour for prism in self.prisms], float)
        """(P, 3) BGR"""
        self.fires = np.array([prism.centre + (prism.top,) for prism in self.prisms if prism.flicker]).reshape(-1, 3)
        """(F, 3): (x, y, z) of the fires' tops [m]"""

    def distance(self, point: Sequence[float]) -> float:
        """The distance of a point (x, y) from the nearest obstacle to a robot [m]; negative inside one."""
        return float(self.distances(np.asarray(point, float)[np.newaxis])[0])

    def distances(self, points: FloatArray) -> FloatArray:
        """(n,) the distances of (n, 2) points from the nearest obstacle to a robot [m]; negative inside one.

        Beside a corner the distance is that of the farther side: shorter than the straight one.
        """
        low = self.bottom < ROBOT_HEIGHT
        # not a matrix product: BLAS would wake a thread on each core for it
        sides = self.normals[low, :, 0, np.newaxis] * points[:, 0] + self.normals[low, :, 1, np.newaxis] * points[:, 1]
        return np.asarray((sides - self.offsets[low, :, np.newaxis]).max(axis=1).min(axis=0))

    def index(self, name: str) -> int:
        """The surface id of the prism of this name."""
        return [prism.name for prism in self.prisms].index(name)

    def temperatures(self, time: float) -> FloatArray:
        """(P,) the prisms' temperatures at a time [s], with flickering fires [degC]."""
        phase = np.arange(len(self.prisms)) * 1.7
        wave = 0.5 + 0.25 * np.sin(9.0 * time + phase) + 0.25 * np.sin(23.0 * time + 2.0 * phase)
        return np.asarray(self.ambient + (self.temperature - self.ambient) * (1.0 - self.flicker * wave))


def building(seed: int) -> World:
    """The burning building: its rooms are always the same, the seed selects their furniture and the fires."""
    random = np.random.RandomState(seed)
    prisms = list(_walls())
    rooms: Sequence[Room] = [(column, row) for column in range(3) for row in range(2)]
    burning: Set[Room] = {rooms[i] for i in random.choice(len(rooms), 2, replace=False)}
    for room in rooms:
        prisms += _furnish(room, room in burning, random)
    prisms += _sitting()
    prisms.append(Prism('lamp', (19.8, 7.6), (0.3, 0.3), 0.3, 0.0, 1.6, 45.0, (120, 210, 240)))
    return World(prisms)


def _walls() -> Iterator[Prism]:
    width, depth = SIZE
    half = THICKNESS / 2
    grey, cool = (165, 175, 180), 24.0

    def wall(name: str, x0: float, y0: float, x1: float, y1: float) -> Prism:
        size = max(x1 - x0, THICKNESS), max(y1 - y0, THICKNESS)
        return Prism(name, ((x0 + x1) / 2, (y0 + y1) / 2), size, 0.0, 0.0, CEILING, cool, grey)

    yield wall('south wall', 0, half, width, half)
    yield wall('north wall', 0, depth - half, width, depth - half)
    yield wall('west wall', half, 0, half, depth)
    yield wall('east wall', width - half, 0, width - half, depth)
    for y in ROOM_WALLS:
        edges = [0.0] + [x + side * DOOR / 2 for x in DOORS for side in (-1, 1)] + [width]
        for i in range(0, len(edges), 2):
            yield wall('corridor wall %d at %g' % (i // 2, y), edges[i], y, edges[i + 1], y)
        for x in DOORS:
            yield Prism('lintel %g %g' % (x, y), (x, y), (DOOR, THICKNESS), 0.0, 2.1, CEILING, cool, (120, 140, 160))
    for x in PARTITIONS:
        yield wall('partition %g south' % x, x, 0, x, ROOM_WALLS[0])
        yield wall('partition %g north' % x, x, ROOM_WALLS[1], x, depth)


def room_centre(room: Room) -> Tuple[float, float]:
    """(x, y) of the centre of a room [m]."""
    column, row = room
    return DOORS[column], (ROOM_WALLS[0] / 2, (ROOM_WALLS[1] + SIZE[1]) / 2)[row]


def _furnish(room: Room, burning: bool, random: np.random.RandomState) -> Iterator[Prism]:
    """The furniture along the walls of a room, and a fire or a person; the robot's way to the centre stays free."""
    x, y = room_centre(room)
    inward = 1 if room[1] else -1     # away from the corridor
    turn = random.uniform(-0.1, 0.1, 4)
    yield Prism('desk %d %d' % room, (x - 2.3, y + inward * 1.6), (1.5, 0.7), turn[0], 0.0, 0.75,
                random.uniform(22, 27), (60, 100, 150))
    yield Prism('shelf %d %d' % room, (x + 2.75, y + inward * 0.3), (0.5, 1.8), turn[1], 0.0, random.uniform(1.4, 2.1),
                random.uniform(20, 26), (70, 70, 110))
    yield Prism('barrel %d %d' % room, (x - 2.6, y - inward * 1.2), (0.5, 0.5), np.pi / 4 + turn[2], 0.0, 0.9,
                random.uniform(25, 70), tuple(random.uniform(40, 200, 3)))
    if burning:
        yield Prism('fire %d %d' % room, (x + 1.6, y + inward * 2.0), (0.9, 0.7), turn[3], 0.0, 0.55,
                    random.uniform(380, 620), (30, 120, 255), flicker=0.35)
    else:
        yield from _lying('person %d %d' % room, (x + 1.2, y + inward * 1.7), turn[3] * 4)


SKIN, CLOTHES = 35.0, 31.0
"""Temperatures of people, who are warmer than what surrounds them [degC]."""

FACE, JACKET, TROUSERS = (110, 140, 190), (90, 110, 60), (90, 70, 60)
"""BGR"""

LYING: Sequence[Tuple[str, float, float, float, float, float, float, Tuple[float, ...]]] = (
    ('', 0.15, 0.0, 0.62, 0.42, 0.26, CLOTHES, JACKET), ("'s head", 0.62, 0.0, 0.22, 0.2, 0.22, SKIN, FACE),
    ("'s legs", -0.6, 0.0, 0.88, 0.3, 0.16, CLOTHES - 1.5, TROUSERS),
    ("'s arm", 0.3, -0.42, 0.16, 0.5, 0.08, SKIN, FACE))
"""Parts of a person who lies on the floor: (name, x, y of its centre in the person's frame, length, width, height [m],
temperature [degC], BGR)."""

SITTING = (4.8, ROOM_WALLS[1] - 0.36), (8.3, ROOM_WALLS[0] + 0.36)
"""(x, y) of people who sit in the corridor with their backs to its walls [m]; the way between them stays free."""


def _lying(name: str, centre: Tuple[float, float], yaw: float) -> Iterator[Prism]:
    c, s = np.cos(yaw), np.sin(yaw)
    for part, x, y, length, width, height, temperature, colour in LYING:
        place = centre[0] + c * x - s * y, centre[1] + s * x + c * y
        yield Prism(name + part, place, (length, width), yaw, 0.0, height, temperature, colour)


def _sitting() -> Iterator[Prism]:
    for number, (x, y) in enumerate(SITTING):
        wall = 1 if y > SIZE[1] / 2 else -1
        name = 'person %d' % number
        yield Prism(name, (x, y + wall * 0.12), (0.42, 0.24), 0.0, 0.0, 0.62, CLOTHES, JACKET)
        yield Prism(name + "'s head", (x, y + wall * 0.12), (0.2, 0.2), 0.0, 0.62, 0.88, SKIN, FACE)
        yield Prism(name + "'s legs", (x, y - wall * 0.22), (0.34, 0.46), 0.0, 0.0, 0.16, CLOTHES - 1.5, TROUSERS)
