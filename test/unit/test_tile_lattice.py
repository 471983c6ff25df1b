# SPDX-License-Identifier: BSD-3-Clause
"""Numbers of cells: by hand, and that they stay when a map grows, moves or turns."""
import math
from typing import Any, Tuple

import pytest
from geometry_msgs.msg import Point, Pose, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import MapMetaData

from smokebot_udp.codecs.tiles.lattice import MAX_NUMBER, Lattice


def info(x: float, y: float, resolution: float = 0.05, z: float = 0.0, turn: float = 0.0, sign: float = 1.0) -> Any:
    return MapMetaData(resolution=resolution, origin=Pose(Point(x, y, z), Quaternion(
        0.0, 0.0, sign * math.sin(turn / 2), sign * math.cos(turn / 2))))


def way(first: Any, second: Any) -> Any:
    return Lattice.of('map', first).to(Lattice.of('map', second))


def same(first: Any, second: Any) -> bool:
    found = Lattice.of('map', first).same(Lattice.of('map', second))
    assert found == Lattice.of('map', second).same(Lattice.of('map', first))
    return found


def test_numbers_by_hand() -> None:
    first = info(-50.0, -23.4)
    assert Lattice.of('map', first).corner == (-1000, -468)
    assert way(first, first) == (0.0, 0.0)
    assert way(first, info(-50.35, -23.3)) == pytest.approx((-7.0, 2.0))
    assert way(first, info(-49.99, -23.43)) == pytest.approx((0.2, -0.6))
    # turned by a right angle, the map's x axis is the frame's y axis
    assert Lattice.of('map', info(1.0, 2.0, 0.5, turn=math.pi / 2)).corner == (4, -2)


def test_the_orientation_of_zeros_is_none_and_a_quaternion_may_be_negative() -> None:
    zeros = MapMetaData(resolution=0.05, origin=Pose(Point(1.0, 2.0, 0.0), Quaternion(0.0, 0.0, 0.0, 0.0)))
    assert Lattice.of('map', zeros).corner == (20, 40) and same(zeros, info(1.0, 2.0))
    assert same(info(1.0, 2.0, turn=1.0), info(1.0, 2.0, turn=1.0, sign=-1.0))


@pytest.mark.parametrize('other', [
    info(0.02, 0.0), info(0.0, -0.01), info(0.0, 0.0, z=0.1), info(0.0, 0.0, turn=0.01), info(0.05, 0.0)])
def test_another_place(other: Any) -> None:
    assert not same(info(0.0, 0.0), other) and way(info(0.0, 0.0), other) is not None


def test_between_other_cells_there_is_no_way() -> None:
    assert way(info(0.0, 0.0), info(0.0, 0.0, 0.05001)) is None
    assert Lattice.of('map', info(0.0, 0.0)).to(Lattice.of('odom', info(0.0, 0.0))) is None


def test_rounding_errors_make_no_other_place() -> None:
    first, second = info(-123.4501, 2.0), info(-123.45, 2.00004, 0.05 * (1 + 5e-8), z=1e-9)
    assert same(first, second) and max(map(abs, way(first, second))) < 0.01


@pytest.mark.parametrize('broken, named', [
    (info(0.0, 0.0, 0.0), 'resolution is 0.0'), (info(0.0, 0.0, -1.0), 'resolution'),
    (info(0.0, 0.0, math.nan), 'resolution is nan'), (info(0.0, 0.0, math.inf), 'resolution'),
    (info(math.nan, 0.0), 'origin.position is .nan'), (info(0.0, math.inf), 'origin.position'),
    (info(0.0, 0.0, z=math.nan), 'origin.position'), (info(0.0, 0.0, turn=math.nan), 'origin.orientation'),
    (info(0.051 * MAX_NUMBER, 0.0), 'cells away'), (info(1e300, 1e300, 1e-300), 'cells away')])
def test_impossible(broken: Any, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Lattice.of('map', broken)


cells = st.tuples(st.floats(-100000, 100000), st.floats(-100000, 100000))
metres = st.floats(-1000.0, 1000.0)


@given(metres, metres, st.floats(-3.0, 3.0), st.sampled_from([0.01, 0.05, 0.1, 1.0]), cells)
def test_a_map_that_grows(x: float, y: float, turn: float, resolution: float, grown: Tuple[float, float]) -> None:
    first = info(x, y, resolution, turn=turn)
    along, across = grown[0] * resolution, grown[1] * resolution
    second = info(x + along * math.cos(turn) - across * math.sin(turn),
                  y + along * math.sin(turn) + across * math.cos(turn), resolution, turn=turn)
    assert way(first, second) == pytest.approx(grown, abs=1e-5)
