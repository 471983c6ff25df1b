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


def corner(first: Any, second: Any) -> Any:
    return Lattice.of('map', first).corner(second)


def test_numbers_by_hand() -> None:
    first = info(-50.0, -23.4)
    assert corner(first, first) == (-1000, -468)
    assert corner(first, info(-50.35, -23.3)) == (-1007, -466)
    # turned by a right angle, the map's x axis is the frame's y axis
    assert corner(info(1.0, 2.0, 0.5, turn=math.pi / 2), info(1.0, 2.0, 0.5, turn=math.pi / 2)) == (4, -2)


def test_half_a_cell_beside_zero_is_no_matter_of_rounding() -> None:
    first, second = info(0.025, 0.0), info(-0.025, 0.0)
    assert corner(first, second)[0] - corner(first, first)[0] == -1
    assert corner(second, second)[0] - corner(second, first)[0] == -1


def test_the_orientation_of_zeros_is_none_and_a_quaternion_may_be_negative() -> None:
    zeros = MapMetaData(resolution=0.05, origin=Pose(Point(1.0, 2.0, 0.0), Quaternion(0.0, 0.0, 0.0, 0.0)))
    assert corner(zeros, info(1.0, 2.0)) == (20, 40)
    assert corner(info(1.0, 2.0, turn=1.0), info(1.0, 2.0, turn=1.0, sign=-1.0)) is not None


@pytest.mark.parametrize('other', [
    info(0.0, 0.0, 0.05001), info(0.02, 0.0), info(0.0, -0.01), info(0.0, 0.0, z=0.1), info(0.0, 0.0, turn=0.01)])
def test_another_lattice(other: Any) -> None:
    assert corner(info(0.0, 0.0), other) is None and corner(other, info(0.0, 0.0)) is None


def test_rounding_errors_make_no_other_lattice() -> None:
    assert corner(info(0.0, 0.0), info(-123.4501, 0.00004, 0.05 * (1 + 5e-8), z=1e-9)) == (-2469, 0)


@pytest.mark.parametrize('broken, named', [
    (info(0.0, 0.0, 0.0), 'resolution is 0.0'), (info(0.0, 0.0, -1.0), 'resolution'),
    (info(0.0, 0.0, math.nan), 'resolution is nan'), (info(0.0, 0.0, math.inf), 'resolution'),
    (info(math.nan, 0.0), 'origin.position is .nan'), (info(0.0, math.inf), 'origin.position'),
    (info(0.0, 0.0, z=math.nan), 'origin.position'), (info(0.0, 0.0, turn=math.nan), 'origin.orientation'),
    (info(0.051 * MAX_NUMBER, 0.0), 'cells away'), (info(1e300, 1e300, 1e-300), 'cells away')])
def test_impossible(broken: Any, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Lattice.of('map', broken)
    with pytest.raises(ValueError, match=named):
        Lattice.of('map', info(0.0, 0.0)).corner(broken)


cells = st.tuples(st.integers(-100000, 100000), st.integers(-100000, 100000))
metres = st.floats(-1000.0, 1000.0)


@given(metres, metres, st.floats(-3.0, 3.0), st.sampled_from([0.01, 0.05, 0.1, 1.0]), cells)
def test_a_map_that_grows_keeps_its_numbers(x: float, y: float, turn: float, resolution: float,
                                            grown: Tuple[int, int]) -> None:
    first = info(x, y, resolution, turn=turn)
    along, across = grown[0] * resolution, grown[1] * resolution
    second = info(x + along * math.cos(turn) - across * math.sin(turn),
                  y + along * math.sin(turn) + across * math.cos(turn), resolution, turn=turn)
    before, after = corner(first, first), corner(first, second)
    assert (after[0] - before[0], after[1] - before[1]) == grown
