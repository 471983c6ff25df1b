# SPDX-License-Identifier: BSD-3-Clause
"""What a simulated place consists of. Every sensor is rendered from this one description.

Metres, degrees Celsius and REP-103 axes in the frame `map`: x east, y north, z up from the floor.
Everything solid is a vertical prism over a convex outline. It stands on the floor (wall, desk, sill) or hangs
from the ceiling (lintel), and no two of them share ground; so each column of a level sensor sees the
lower ones in front of the higher ones behind, and nothing else, which is what makes columns.py fast.
"""
from dataclasses import dataclass
from typing import Tuple

import numpy as np


@dataclass(frozen=True, eq=False)
class Prism:
    """One solid thing."""
    corners: np.ndarray
    """(E, 2) float64 [m], the outline, counter-clockwise seen from above."""
    bottom: float
    """[m]; 0 where it stands on the floor."""
    top: float
    """[m]; the ceiling's height where it hangs."""
    kind: str
    """What it is; surfaces.py knows how each kind looks."""
    temperature: float
    """Of its surface away from any fire [degC]."""
    colour: Tuple[int, int, int]
    """Blue, green, red: 0..255."""


@dataclass(frozen=True)
class Fire:
    """Flames above something that burns."""
    x: float
    y: float
    base: float
    """Where the flames begin [m]."""
    radius: float
    """Of the flames at their foot [m]."""
    height: float
    """Of the flames, on average [m]."""
    temperature: float
    """That a thermal camera sees in their middle [degC]."""


@dataclass(frozen=True)
class Waypoint:
    """Where the robot turns on its round."""
    x: float
    y: float
    stay: float = 0.0
    """How long it stands there before it goes on [s]."""


@dataclass(frozen=True)
class World:
    """A building on fire, and a round through it that touches nothing."""
    seed: int
    bounds: Tuple[float, float, float, float]
    """x_min, y_min, x_max, y_max of the floor and the ceiling [m]; beyond is open air."""
    ceiling: float
    """Height [m]."""
    prisms: Tuple[Prism, ...]
    fires: Tuple[Fire, ...]
    route: Tuple[Waypoint, ...]
    """Closed: the last is followed by the first."""


def box(x, y, length, width, yaw, bottom, top, kind, temperature, colour):
    """A prism over a rectangle: centre (x, y), `length` along `yaw` [rad], `width` across, all in metres."""
    along = np.array([np.cos(yaw), np.sin(yaw)]) * length / 2
    across = np.array([-np.sin(yaw), np.cos(yaw)]) * width / 2
    corners = np.array([x, y]) + np.array([-along - across, along - across, along + across, across - along])
    return Prism(corners, bottom, top, kind, temperature, colour)


def cylinder(x, y, radius, top, kind, temperature, colour, sides=10):
    """An upright prism of many sides around (x, y) on the floor: a barrel, a head."""
    angles = 2 * np.pi * np.arange(sides) / sides
    corners = np.array([x, y]) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return Prism(corners, 0.0, top, kind, temperature, colour)


def distance_to_prism(points, prism):
    """How far points are from a prism's outline, seen from above; 0 inside.

    :param points: (N, 2) ndarray [m]
    :return: (N,) ndarray [m]
    """
    start = prism.corners
    edge = np.roll(start, -1, axis=0) - start
    offset = np.asarray(points)[:, None, :] - start
    share = np.clip((offset * edge).sum(axis=2) / (edge * edge).sum(axis=1), 0, 1)
    distance = np.linalg.norm(offset - share[..., None] * edge, axis=2).min(axis=1)
    inside = (edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0] >= 0).all(axis=1)
    return np.where(inside, 0.0, distance)
