# SPDX-License-Identifier: BSD-3-Clause
"""The burning building that every sensor sees: six rooms along a corridor, furniture, a person, fires.

Metres, degrees Celsius, REP-103 axes in the frame `map`. Every solid thing is a box, perhaps turned about the vertical.
"""
import numpy as np

CEILING = 2.7
FLOOR, ROOF = -1, -2
"""Surface ids of what is no box."""
DOORS = (3.5, 10.5, 17.5)
"""x of the rooms' doors and centres [m]."""
LENGTH, DEPTH = 21.0, 14.0
CORRIDOR = (6.0, 8.0)
THICK, DOOR_WIDTH, LINTEL = 0.15, 1.1, 2.05
WALL = (165, 178, 188)


def room_centre(room):
    """(x, y) of the room (column 0..2, row 0..1)."""
    column, row = room
    return DOORS[column], (3.0, 11.0)[row]


class World:
    """Boxes as arrays over P boxes: normals (P, 4, 2) outward, offsets (P, 4), bottom, top, colour (P, 3)."""

    ambient = 24.0

    def __init__(self, boxes, fires):
        boxes = [_outline(*box[:5]) + box[5:] for box in boxes]
        self.normals = np.array([box[0] for box in boxes])
        self.offsets = np.array([box[1] for box in boxes])
        self.bottom, self.top, self._base, self.flicker = (
            np.array([box[i] for box in boxes], np.float32) for i in (2, 3, 4, 5))
        self.colour = np.array([box[6] for box in boxes], np.float32)
        self.fires = fires

    def temperatures(self, time):
        """(P,) of the boxes [degC]; fires flicker."""
        phase = np.arange(len(self._base))
        return self._base + self.flicker * (np.sin(9.1 * time + phase) + 0.5 * np.sin(23.7 * time + 2 * phase))


def _outline(x, y, length, width, yaw):
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    left = np.array([-ahead[1], ahead[0]])
    normals = np.array([ahead, -ahead, left, -left])
    return normals, normals @ np.array([x, y]) + np.array([length, length, width, width]) / 2


def building(seed):
    """:return: World; the same for the same seed"""
    random = np.random.RandomState(seed)
    boxes = _walls()
    fires = []
    burning = set(random.permutation(6)[:3])
    for index in range(6):
        centre = np.array(room_centre((index % 3, index // 3)))
        boxes += _furniture(random, centre)
        if index in burning:
            x, y = centre + (random.choice([-2.4, 2.4]), random.choice([-1.6, 1.6]))
            fires.append((x, y, 0.4))
            boxes.append((x, y, 0.7, 0.6, random.uniform(0, 3), 0.0, 0.8, random.uniform(380, 620), 40.0, (30, 90, 200)))
    x, y = room_centre((random.randint(3), random.randint(2)))
    boxes += [(x + 1.2, y - 1.0, 0.6, 0.42, 0.4, 0.0, 0.25, 33.0, 0.0, (120, 60, 40)),
              (x + 0.45, y - 1.3, 0.75, 0.3, 0.4, 0.0, 0.18, 31.0, 0.0, (90, 50, 40)),
              (x + 1.67, y - 0.8, 0.22, 0.2, 0.4, 0.0, 0.22, 34.5, 0.0, (140, 170, 210))]
    return World(boxes, fires)


def _walls():
    def wall(x0, y0, x1, y1, bottom=0.0):
        return ((x0 + x1) / 2, (y0 + y1) / 2, max(x1 - x0, THICK), max(y1 - y0, THICK), 0.0, bottom, CEILING, 22.0, 0.0,
                WALL)
    walls = [wall(0, 0, LENGTH, 0), wall(0, DEPTH, LENGTH, DEPTH), wall(0, 0, 0, DEPTH), wall(LENGTH, 0, LENGTH, DEPTH)]
    for x in (7.0, 14.0):
        walls += [wall(x, 0, x, CORRIDOR[0]), wall(x, CORRIDOR[1], x, DEPTH)]
    for y in CORRIDOR:
        edges = [0.0] + [x + side * DOOR_WIDTH / 2 for x in DOORS for side in (-1, 1)] + [LENGTH]
        walls += [wall(start, y, end, y) for start, end in zip(edges[::2], edges[1::2])]
        walls += [wall(start, y, end, y, LINTEL) for start, end in zip(edges[1:-1:2], edges[2::2])]
    return walls


def _furniture(random, centre):
    """Along the room's outer sides, off the robot's way."""
    side = random.choice([-1, 1])
    outward = np.sign(centre[1] - 7.0)
    x, y = centre
    things = [(x - side * 2.9, y, 0.45, 1.6, 0.0, 0.0, random.uniform(1.5, 2.0), 23.0, 0.0, (60, 110, 150)),
              (x - side * 0.8, y + outward * 2.3, 1.5, 0.7, 0.0, 0.0, 0.74, 23.5, 0.0, (80, 130, 165)),
              (x + side * 1.3, y + outward * 2.5, 0.5, 0.5, random.uniform(0, 1.5), 0.0, 0.9, 24.0, 0.0, (130, 70, 40)),
              (x + side * 3.1, y + outward * 2.4, 0.4, 0.8, 0.0, 0.0, 1.1, random.uniform(40, 62), 0.0, (150, 150, 145))]
    return things
