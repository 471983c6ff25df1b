# SPDX-License-Identifier: BSD-3-Clause
"""Finds ways through the building: the shortest over the cells of a grid, then straightened where nothing is near.

The grid is the building's floor plan with inflated obstacles, as the costmap of a navigation stack has it.
"""
from typing import List

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ..arrays import BoolArray, FloatArray, IntArray
from .motion import RADIUS
from .pose import Point
from .world import SIZE, World

RESOLUTION = 0.1
"""Side of a cell [m]."""

CLEARANCE = RADIUS + RESOLUTION
"""Distance of a free cell's centre from all obstacles [m]; that of any point on a way is less by half a diagonal."""

SAMPLES_PER_CELL = 2
"""Points that are checked on each cell's length of a straight line."""

TOLERANCE = 0.5
"""[m]"""

STEP = 0.02
"""Distance between points that are checked off the grid [m]."""

ROUNDING = 1e-6
"""A robot that stands at a wall may be nearer than RADIUS by this [m]."""

NEIGHBOURS = (0, 1), (1, 0), (1, 1), (1, -1)
"""(rows, columns) from a cell to half of its neighbours; the others are those of the neighbours."""


class Planner:
    """Ways of a round robot of RADIUS in a building.

    :param world: all of its obstacles are known
    """

    def __init__(self, world: World) -> None:
        self._world = world
        columns, rows = (int(round(length / RESOLUTION)) for length in SIZE)
        x, y = ((np.arange(number) + 0.5) * RESOLUTION for number in (columns, rows))
        distances = [world.distances(np.stack([x, np.full(columns, one)], axis=1)) for one in y]
        self._free: BoolArray = np.array(distances) >= CLEARANCE
        """(rows, columns) bool"""
        self._free[[0, -1]] = self._free[:, [0, -1]] = False
        # cells behind furniture, to which no way leads, are not free
        parts = csgraph.connected_components(_graph(self._free), directed=False)[1].reshape(self._free.shape)
        self._free &= parts == np.bincount(parts[self._free]).argmax()
        self._graph = _graph(self._free)

    def way(self, start: Point, goal: Point) -> List[Point]:
        """The points (x, y) [m] at which the way from a start to a goal bends, and the goal.

        A goal at which the robot would touch an obstacle is moved to the nearest free cell within TOLERANCE.

        :raises ValueError: where the robot cannot stand at the goal, or no way leads there
        """
        if not (0 < goal[0] < SIZE[0] and 0 < goal[1] < SIZE[1]):
            raise ValueError('the goal is outside of the building')
        first, last = self._cell(start), self._cell(goal)
        if self._world.distance(goal) < RADIUS:
            nearest = self._centre(last)
            if np.hypot(*np.subtract(nearest, goal)) > TOLERANCE:
                raise ValueError('the goal is in or behind an obstacle')
            goal = nearest
        before = csgraph.dijkstra(self._graph, directed=False, indices=last, return_predecessors=True)[1]
        cells = [first]
        while cells[-1] != last:
            cells.append(int(before[cells[-1]]))
        way = [*self._straightened(np.array(cells)), goal]
        if not (self._can_go(start, way[0]) and self._can_go(*way[-2:])):
            raise ValueError('no way leads to the goal')
        # to a cell's centre beside it the robot would turn twice, which takes longer than most ways
        if len(way) > 1 and self._can_go(start, way[1]):
            del way[0]
        if len(way) > 1 and self._can_go(way[-3] if len(way) > 2 else start, goal):
            del way[-2]
        return way

    def _can_go(self, one: Point, other: Point) -> bool:
        """Whether the robot touches nothing on a straight line."""
        steps = int(np.ceil(np.hypot(*np.subtract(other, one)) / STEP)) + 2
        points = one + np.linspace(0, 1, steps)[:, np.newaxis] * np.subtract(other, one)
        return bool((self._world.distances(points) > RADIUS - ROUNDING).all())

    def _cell(self, point: Point) -> int:
        """The index of the free cell nearest to a point."""
        rows, columns = np.nonzero(self._free)
        squared = (columns + 0.5 - point[0] / RESOLUTION) ** 2 + (rows + 0.5 - point[1] / RESOLUTION) ** 2
        nearest = int(squared.argmin())
        return int(rows[nearest] * self._free.shape[1] + columns[nearest])

    def _centre(self, cell: int) -> Point:
        """The centre of a cell [m]."""
        row, column = divmod(cell, self._free.shape[1])
        return (column + 0.5) * RESOLUTION, (row + 0.5) * RESOLUTION

    def _straightened(self, cells: IntArray) -> List[Point]:
        """The centres of those cells of a way that are needed: straight lines between them cross free cells only."""
        centres = np.array([self._centre(int(cell)) for cell in cells])
        kept = [0]
        while kept[-1] < len(cells) - 1:
            here = kept[-1]
            kept.append(next((there for there in range(len(cells) - 1, here + 1, -1)
                              if self._is_clear(centres[here], centres[there])), here + 1))
        return [(float(x), float(y)) for x, y in centres[kept]]

    def _is_clear(self, one: FloatArray, other: FloatArray) -> bool:
        """Whether a straight line crosses free cells only: (x, y) of its ends [m]."""
        steps = SAMPLES_PER_CELL * int(np.ceil(np.abs(other - one).max() / RESOLUTION)) + 1
        points = one + np.linspace(0, 1, steps)[:, np.newaxis] * (other - one)
        columns, rows = (points / RESOLUTION).astype(int).T
        return bool(self._free[rows, columns].all())


def _graph(free: BoolArray) -> 'sparse.csr_matrix':
    """(n, n): the lengths of the steps from each cell to its neighbours [cells].

    :param free: (rows, columns) bool, False along the border
    """
    index = np.arange(free.size).reshape(free.shape)
    rows, columns = np.nonzero(free)
    starts, ends, lengths = [], [], []
    for down, right in NEIGHBOURS:
        below, beside = rows + down, columns + right
        possible = free[below, beside]
        starts.append(index[rows, columns][possible])
        ends.append(index[below, beside][possible])
        lengths.append(np.full(int(possible.sum()), np.hypot(down, right)))
    places = np.concatenate(starts), np.concatenate(ends)
    return sparse.csr_matrix((np.concatenate(lengths), places), (free.size, free.size))
