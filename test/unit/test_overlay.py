# SPDX-License-Identifier: BSD-3-Clause
"""The overlay: what its tiles say, and in which colour."""
import math
from typing import Any, Dict, Tuple

import numpy as np
import pytest
from hypothesis import example, given, strategies

from smokebot_udp.codecs.display.overlay import (
    ATTENTION,
    BAD,
    BATTERY_TIMEOUT,
    COLUMNS,
    GOOD,
    HEIGHT,
    LINE,
    MARK,
    MAX_PROBLEMS,
    SQUARE,
    TILE_COLOURS,
    UNKNOWN,
    WIDTH,
    OperatorStatus,
    Tile,
    overlay,
    tiles,
)

GOOD_STATUS: Dict[str, Any] = {
    'link_silence': 0.4, 'sent': 0.93, 'capacity': 2.0, 'loss': 0.2, 'round_trip': 0.045, 'signal': -61.0,
    'focus': 'navigation', 'charge': 0.82, 'voltage': 24.4, 'driver': '/desk', 'drives': True,
    'control': 'in control', 'free': True}


def said(**values: Any) -> Dict[str, Tuple[str, str]]:
    """{label: (text, level)}; the link's label may have a unit."""
    return {tile.label.split()[0]: (tile.text, tile.level) for tile in tiles(OperatorStatus(**values))}


def test_all_is_well() -> None:
    assert said(**GOOD_STATUS) == {
        'LINK': ('0.93 of 2', GOOD), 'LOSS': ('20 %', GOOD), 'ROUND': ('45 ms', GOOD), 'WI-FI': ('-61 dBm', GOOD),
        'FOCUS': ('navigation', GOOD), 'BATTERY': ('82 % 24.4 V', GOOD), 'DRIVES': ('you', GOOD),
        'STOP': ('free', GOOD)}


def test_what_is_unknown_is_a_dash() -> None:
    assert set(said().values()) == {('-', UNKNOWN)}
    assert said(voltage=24.0)['BATTERY'] == ('24.0 V', GOOD)


@pytest.mark.parametrize('change, label, text, level', [
    ({'capacity': math.nan}, 'LINK', '0.93', GOOD), ({'sent': 312.4, 'capacity': 400.0}, 'LINK', '312 of 400', GOOD),
    ({'loss': 0.31}, 'LOSS', '31 %', ATTENTION), ({'loss': 0.8}, 'LOSS', '80 %', BAD),
    ({'round_trip': 0.4}, 'ROUND', '400 ms', ATTENTION),
    ({'signal': -75.0}, 'WI-FI', '-75 dBm', ATTENTION), ({'signal': -90.0}, 'WI-FI', '-90 dBm', BAD),
    ({'modified': True}, 'FOCUS', 'navigation*', GOOD),
    ({'charge': 0.1}, 'BATTERY', '10 % 24.4 V', BAD), ({'voltage': math.nan}, 'BATTERY', '82 %', GOOD),
    ({'drives': False, 'free': False, 'control': 'desk2 drives', 'driver': 'desk2'}, 'DRIVES', 'desk2', ATTENTION),
    ({'drives': False, 'free': False, 'control': 'nobody drives', 'driver': ''}, 'DRIVES', 'nobody', UNKNOWN),
    ({'free': False, 'control': 'LOCKED: thermal is 3 s old'}, 'STOP', 'LOCKED: thermal is 3 s old', ATTENTION),
    ({'free': False, 'commands': False, 'control': 'no command stream'}, 'STOP', 'no command stream', UNKNOWN),
    ({'estop': True}, 'STOP', 'EMERGENCY STOP', BAD)])
def test_one_value_differs(change: Dict[str, Any], label: str, text: str, level: str) -> None:
    before, after = said(**GOOD_STATUS), said(**{**GOOD_STATUS, **change})
    assert after[label] == (text, level)
    others = {'DRIVES', 'STOP', label}
    assert {name for name in after if after[name] != before[name]} <= others


@pytest.mark.parametrize('silence, text', [(5.2, 'NO LINK 5.2 s'), (math.inf, 'NO LINK')])
def test_of_a_broken_link_nothing_is_known_but_the_rest_is_the_last_that_was(silence: float, text: str) -> None:
    before, after = said(**GOOD_STATUS), said(**{**GOOD_STATUS, 'link_silence': silence})
    link = {'LINK': (text, BAD), **{name: ('-', UNKNOWN) for name in ('LOSS', 'ROUND', 'WI-FI')}}
    last = {name: (before[name][0], UNKNOWN) for name in ('FOCUS', 'BATTERY', 'DRIVES')}
    assert after == {**before, **link, **last}
    assert said(**{**GOOD_STATUS, 'link_silence': silence, 'charge': 0.1})['BATTERY'] == ('10 % 24.4 V', BAD)


def test_an_old_state_of_the_battery_is_not_good() -> None:
    assert said(**GOOD_STATUS, battery_age=BATTERY_TIMEOUT - 1)['BATTERY'] == ('82 % 24.4 V', GOOD)
    assert said(**GOOD_STATUS, battery_age=BATTERY_TIMEOUT + 1)['BATTERY'] == ('82 % 24.4 V', UNKNOWN)


def colours(status: OperatorStatus) -> Any:
    """The colour at the right edge of each tile, [b, g, r]."""
    image = overlay(tiles(status), (), {})
    assert image.shape == (HEIGHT, WIDTH, 3) and image.dtype == np.uint8
    rows = (HEIGHT // 4, 3 * HEIGHT // 4)
    return [tuple(image[row, (column + 1) * WIDTH // COLUMNS - 6].tolist())
            for row in rows for column in range(COLUMNS)]


def test_a_tile_has_the_colour_of_its_level() -> None:
    shown = OperatorStatus(**{**GOOD_STATUS, 'loss': 0.4, 'estop': True})
    assert colours(shown) == [TILE_COLOURS[tile.level] for tile in tiles(shown)]
    assert TILE_COLOURS[BAD] in colours(shown) and TILE_COLOURS[ATTENTION] in colours(shown)


def test_a_good_tile_has_a_mark_and_an_unknown_one_has_none() -> None:
    assert (overlay(tiles(OperatorStatus(**GOOD_STATUS)), (), {}) == MARK).all(axis=2).any()
    assert not (overlay(tiles(OperatorStatus()), (), {}) == MARK).all(axis=2).any()


def test_a_path_with_a_hole_deserves_attention() -> None:
    link = tiles(OperatorStatus(link_silence=0.5, sent=0.9, capacity=2.0, longest=1172))[0]
    assert link == Tile('LINK [Mbit/s]', '0.9 of 2: > 1172 B do not pass', ATTENTION)
    assert tiles(OperatorStatus(link_silence=0.5, sent=0.9, capacity=2.0))[0].level == GOOD


@given(strategies.builds(OperatorStatus, *[strategies.floats()] * 6, focus=strategies.text(max_size=99),
                         charge=strategies.floats(), voltage=strategies.floats(), driver=strategies.text(max_size=99),
                         control=strategies.text(max_size=300)))
@example(OperatorStatus(focus=': ', control='a: '))
def test_whatever_the_robot_says_is_drawn(status: OperatorStatus) -> None:
    assert overlay(tiles(status), (), {}).shape == (HEIGHT, WIDTH, 3)


def test_problems_of_streams_are_lines_below() -> None:
    shown = tiles(OperatorStatus())
    image = overlay(shown, ['lidar: nobody publishes /a', 5 * 'a long text, '], {})
    assert image.shape == (HEIGHT + 2 * LINE, WIDTH, 3)
    assert (image[HEIGHT:] == TILE_COLOURS[ATTENTION]).all(axis=2).mean() > 0.5
    assert overlay(shown, 9 * ['x'], {}).shape[0] == HEIGHT + MAX_PROBLEMS * LINE


def test_the_legend_has_all_names_in_their_colours() -> None:
    legend = {'lidar': None, 'scan_%d' % 1: (255, 40, 40), **{'a_scan_with_a_long_name_%d' % number: (60, 160, 255)
                                                             for number in range(4)}}
    image = overlay(tiles(OperatorStatus()), (), legend)
    lines = image[HEIGHT:]
    assert lines.shape == (2 * LINE, WIDTH, 3) and (image[:HEIGHT] == overlay(tiles(OperatorStatus()), (), {})).all()
    assert (lines == (40, 40, 255)).all(axis=2).sum() == SQUARE ** 2
    assert (lines == (255, 160, 60)).all(axis=2).sum() == 4 * SQUARE ** 2


def test_a_stop_that_was_released_says_what_comes_first() -> None:
    assert said(**{**GOOD_STATUS, 'control': 'in control: start at rest'})['STOP'] == ('free, start at rest', GOOD)
