# SPDX-License-Identifier: BSD-3-Clause
"""The path that a robot has driven, and its footprint."""
import math

import pytest
from hypothesis import given, strategies

from smokebot_udp.codecs.display.driven_path import DrivenPath
from smokebot_udp.mission.footprint import DEFAULT_FOOTPRINT, read_footprint
from smokebot_udp.nodes.robot_markers import outline

FLOATS = strategies.floats(-1e9, 1e9)


def test_positions_are_a_spacing_apart() -> None:
    path = DrivenPath(spacing=1.0)
    changes = [path.add('odom', (x, 0.0, 0.0)) for x in (0.0, 0.4, 1.0, 1.9, 2.2)]
    assert changes == [True, False, True, False, True]
    assert [x for x, _, _ in path.positions] == [0.0, 1.0, 2.2]


def test_a_long_path_keeps_its_beginning_and_becomes_coarser() -> None:
    path = DrivenPath(max_positions=4, spacing=1.0)
    for x in range(8):
        path.add('odom', (float(x), 0.0, 0.0))
    assert [x for x, _, _ in path.positions] == [0.0, 2.0, 4.0, 6.0]


def test_another_frame_or_a_jump_begins_a_new_path() -> None:
    path = DrivenPath()
    path.add('odom', (0.0, 0.0, 0.0))
    path.add('odom2', (1.0, 0.0, 0.0))
    assert path.positions == ((1.0, 0.0, 0.0),)
    path.add('odom2', (9.0, 0.0, 0.0))
    assert path.positions == ((9.0, 0.0, 0.0),)
    assert not path.add('odom2', (math.nan, 0.0, 0.0)) and len(path.positions) == 1


@given(strategies.lists(strategies.tuples(FLOATS, FLOATS, FLOATS)), strategies.integers(2, 9))
def test_a_path_is_bounded_and_ends_near_the_robot(positions: list, most: int) -> None:
    path = DrivenPath(max_positions=most)
    for position in positions:
        path.add('odom', position)
        assert 1 <= len(path.positions) <= most
        assert math.dist(path.positions[-1], position) <= max(3.0, 0.1 * 2 ** len(positions))


def test_a_footprint_is_a_closed_line_with_an_arrow_ahead() -> None:
    line, arrow = outline(read_footprint(DEFAULT_FOOTPRINT), 'ugv1/base_link')
    assert len(line.points) == 5 and line.points[0] == line.points[-1]
    assert arrow.points[1].x > 0.35 and arrow.points[1].y == 0
    assert {marker.header.frame_id for marker in (line, arrow)} == {'ugv1/base_link'}
    assert line.frame_locked and arrow.frame_locked
    assert outline(read_footprint('[]'), 'base_link') == []


@pytest.mark.parametrize('text', ['', 'x', '[[0, 0], [1, 1]]', '[[0, 0], [1, 1], [2]]', '[[0, 0], [1, 1], ["2", 2]]',
                                  '[[0, 0], [1, 1], [NaN, 2]]', '[[0, 0], [1, 1], [1e9, 2]]', '7', '{}', '[' * 9999,
                                  str([[0, 0]] * 65), '[[0, 0], [1, 1], [true, 2]]',
                                  '[[0, 0], [1, 1], [1%s, 2]]' % ('0' * 400)])
def test_what_is_no_footprint(text: str) -> None:
    with pytest.raises(ValueError, match='must be 3 to 64 points'):
        read_footprint(text)
