# SPDX-License-Identifier: BSD-3-Clause
"""The building: walls, furniture, people and fires, as upright prisms with a temperature and a colour.

x is east, y north, z up, the floor is z = 0 (REP-103); metres, degrees Celsius, colours in BGR 0..255.
"""
from dataclasses import dataclass

import numpy as np

CEILING = 2.7
"""Height of the rooms [m]."""

SIZE = 21.0, 14.0
"""The building's outer measures, from (0, 0) [m]."""

ROBOT_HEIGHT = 1.0
"""What hangs higher is not in its way [m]."""

THICKNESS = 0.2
DOOR = 1.4

ROOM_WALLS = (5.6, 8.4)          # y of the corridor's walls
PARTITIONS = (7.0, 14.0)         # x of the walls between rooms
DOORS = (3.5, 10.5, 17.5)        # x of each room's door, on both sides of the corridor

FLOOR, ROOF = -1, -2
"""Surface ids besides the prisms' own indexes."""


@dataclass(frozen=True)
class Prism:
    """An upright box on a rectangle, turned about its centre."""
    name: str
    centre: tuple          # (x, y) [m]
    size: tuple            # (along, across) [m]
    yaw: float             # [rad]
    bottom: float          # [m]
    top: float             # [m]
    temperature: float     # [degC]
    colour: tuple          # (b, g, r)
    flicker: float = 0.0   # how much of its temperature above the room's comes and goes, 0..1

    def corners(self):
        """(4, 2) float: the footprint, counter-clockwise."""
        along, across = self.size[0] / 2, self.size[1] / 2
        local = np.array([(-along, -across), (along, -across), (along, across), (-along, across)])
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return local @ np.array([(c, s), (-s, c)]) + self.centre


class World:
    """Prisms, and their properties as arrays for the sensors."""

    def __init__(self, prisms, ambient=24.0):
        self.prisms = tuple(prisms)
        self.ambient = ambient
        corners = np.array([prism.corners() for prism in self.prisms])
        edges = np.roll(corners, -1, axis=1) - corners
        normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
        self.normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
        """(P, 4, 2): outward normals of the sides; inside is normal . point <= offset."""
        self.offsets = np.einsum('pij,pij->pi', self.normals, corners)
        self.bottom, self.top, self.temperature, self.flicker = (
            np.array([getattr(prism, field) for prism in self.prisms])
            for field in ('bottom', 'top', 'temperature', 'flicker'))
        self.to_ceiling = (self.bottom <= 0) & (self.top >= CEILING)
        """(P,) bool: what nothing is seen behind."""
        self.colour = np.array([prism.colour for prism in self.prisms], float)
        self.fires = np.array([prism.centre + (prism.top,) for prism in self.prisms if prism.flicker]).reshape(-1, 3)

    def distance(self, point):
        """How far a point of the floor is from the nearest prism in a robot's way; negative inside one [m]."""
        low = self.bottom < ROBOT_HEIGHT
        return float((self.normals[low] @ np.asarray(point, float) - self.offsets[low]).max(axis=1).min())

    def index(self, name):
        """The surface id of the prism of this name."""
        return [prism.name for prism in self.prisms].index(name)

    def temperatures(self, time):
        """(P,) the prisms' temperatures now, fires flickering [degC]."""
        phase = np.arange(len(self.prisms)) * 1.7
        wave = 0.5 + 0.25 * np.sin(9.0 * time + phase) + 0.25 * np.sin(23.0 * time + 2.0 * phase)
        return self.ambient + (self.temperature - self.ambient) * (1.0 - self.flicker * wave)


def building(seed):
    """The burning building: rooms and corridor stand, the seed furnishes them and lays the fires."""
    random = np.random.RandomState(seed)
    prisms = list(_walls())
    rooms = [(column, row) for column in range(3) for row in range(2)]
    burning = {rooms[i] for i in random.choice(len(rooms), 2, replace=False)}
    for room in rooms:
        prisms += _furnish(room, room in burning, random)
    prisms.append(Prism('lamp', (19.8, 7.6), (0.3, 0.3), 0.3, 0.0, 1.6, 45.0, (120, 210, 240)))
    return World(prisms)


def _walls():
    width, depth = SIZE
    half = THICKNESS / 2
    grey, cool = (165, 175, 180), 24.0

    def wall(name, x0, y0, x1, y1):
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


def room_centre(room):
    """(x, y) of the middle of the room in (column 0..2, row 0..1)."""
    column, row = room
    return DOORS[column], (ROOM_WALLS[0] / 2, (ROOM_WALLS[1] + SIZE[1]) / 2)[row]


def _furnish(room, burning, random):
    """What stands along the walls of a room, away from the robot's way through its middle."""
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
        yield Prism('person %d %d' % room, (x + 1.4, y + inward * 1.9), (1.7, 0.45), turn[3] * 4, 0.0, 0.3,
                    33.0, (90, 110, 60))
