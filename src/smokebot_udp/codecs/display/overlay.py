# SPDX-License-Identifier: BSD-3-Clause
"""An image with what an operator has to know at any time: the link, the focus, the battery, who drives, and whether the
robot is stopped.

It has two rows of tiles. A tile's colour says whether its value is good, deserves attention, is bad, or is unknown.
Below are problems of streams, in words, and a legend that names what is drawn in which colour.
"""
import math
from dataclasses import dataclass, replace
from typing import List, Mapping, NamedTuple, Optional, Sequence, Tuple

import cv2
import numpy as np

from ...arrays import UInt8Array
from .view import COLOURS, FRESH, FROZEN, OLD, duration, write

WIDTH, HEIGHT = 640, 150
"""[pixel]"""

COLUMNS, GAP = 4, 3

GOOD, ATTENTION, BAD, UNKNOWN = 'good', 'attention', 'bad', 'unknown'
TILE_COLOURS = {GOOD: (55, 55, 55), ATTENTION: COLOURS[OLD], BAD: COLOURS[FROZEN], UNKNOWN: (55, 55, 55)}
"""{level: [b, g, r]}"""
TEXT_COLOURS = {GOOD: (255, 255, 255), ATTENTION: (0, 0, 0), BAD: (255, 255, 255), UNKNOWN: (150, 150, 150)}
MARK = COLOURS[FRESH]
"""Colour of the bar at the left of a good tile [b, g, r]."""

LINK_TIMEOUT = 3.0
"""Without a report from the robot for this time the link counts as broken [s]."""

BATTERY_TIMEOUT = 30.0
"""A state of the battery that is older says nothing good: drivers send it each second, or each ten [s]."""

LINE, SQUARE, MAX_PROBLEMS = 22, 12, 3
"""Height of a line of text, and of the legend's squares [pixel]; lines of problems."""

FONT, FONT_SIZE, LEGEND_COLOUR = cv2.FONT_HERSHEY_SIMPLEX, 0.45, (230, 230, 230)

RAINBOW = cv2.applyColorMap(np.linspace(255, 0, SQUARE).astype(np.uint8)[:, None], cv2.COLORMAP_RAINBOW)
"""(SQUARE, 1, 3) uint8, bgr: red above."""

EMERGENCY_STOP = 'EMERGENCY STOP'


class AttentionLimits(NamedTuple):
    """From when a value deserves attention, and from when it is bad."""
    attention: float
    bad: float


LOSS, ROUND_TRIP = AttentionLimits(0.3, 0.7), AttentionLimits(0.3, 1.0)
"""Limits of the packet-loss ratio and of the round-trip time [s]. Higher values are worse."""
SIGNAL, CHARGE = AttentionLimits(-70.0, -80.0), AttentionLimits(0.3, 0.15)
"""Limits of the Wi-Fi signal strength [dBm] and of the battery's charge, a ratio. Lower values are worse."""


@dataclass(frozen=True)
class OperatorStatus:
    """What the overlay shows. NaN and empty texts: unknown."""
    link_silence: float = math.nan
    """Time since the robot's last report of the link; infinite: there was none [s]."""
    sent: float = math.nan
    """Rate at which the data of all streams are sent [Mbit/s]."""
    capacity: float = math.nan
    """Capacity of the link [Mbit/s]."""
    loss: float = math.nan
    """Packet-loss ratio, 0..1."""
    round_trip: float = math.nan
    """Round-trip time of the link [s]."""
    signal: float = math.nan
    """Wi-Fi signal strength on the side where it is weaker [dBm]."""
    focus: str = ''
    modified: bool = False
    """Whether a setting differs from the focus's."""
    charge: float = math.nan
    """Charge of the battery, 0..1."""
    voltage: float = math.nan
    """Voltage of the battery [V]."""
    battery_age: float = 0.0
    """Time since both were shown [s]."""
    driver: str = ''
    """Who drives; empty: nobody."""
    drives: bool = False
    """Whether this operator drives."""
    control: str = ''
    """The state of control in words, as on operator/control; empty: unknown."""
    commands: bool = True
    """Whether there is anything by which this operator could drive."""
    free: bool = False
    """Whether this operator's commands leave and are obeyed."""
    estop: bool = False
    """Whether the emergency stop is engaged."""
    problems: Tuple[str, ...] = ()
    """Problems of streams, in words."""
    longest: int = 0
    """Longer datagrams do not pass; 0: all pass [byte of UDP payload]."""


class Tile(NamedTuple):
    """One value."""
    label: str
    text: str
    level: str
    """GOOD, ATTENTION, BAD or UNKNOWN."""


def tiles(status: OperatorStatus) -> Tuple[Tile, ...]:
    """The tiles, row by row. While the link is broken its values are unknown; the others are the last ones, and none of
    them is good. Neither is an old state of the battery."""
    broken = status.link_silence > LINK_TIMEOUT
    if broken:
        status = replace(status, loss=math.nan, round_trip=math.nan, signal=math.nan)
    return (_link(status),
            _tile('LOSS', '%.0f %%', 100, status.loss, LOSS),
            _tile('ROUND TRIP', '%.0f ms', 1e3, status.round_trip, ROUND_TRIP),
            _tile('WI-FI', '%.0f dBm', 1, status.signal, SIGNAL),
            _last(Tile('FOCUS', (status.focus or '-') + '*' * status.modified, _known(status.focus)), broken),
            _last(_battery(status), broken or status.battery_age > BATTERY_TIMEOUT), _last(_driver(status), broken),
            _stop(status))


def _last(tile: Tile, is_old: bool) -> Tile:
    """A tile whose value is the last one that was known."""
    return tile._replace(level=UNKNOWN) if is_old and tile.level == GOOD else tile


def overlay(shown: Tuple[Tile, ...], problems: Sequence[str],
            legend: Mapping[str, Optional[Tuple[int, int, int]]]) -> UInt8Array:
    """The image of the tiles, the problems and the legend below: (HEIGHT or more, WIDTH, 3) uint8, bgr.

    :param problems: of streams; the first MAX_PROBLEMS are shown
    :param legend: {what: (red, green, blue)}; None: the colours of a rainbow
    """
    image: UInt8Array = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    rows = -(-len(shown) // COLUMNS)
    width, height = WIDTH // COLUMNS, HEIGHT // rows
    for number, tile in enumerate(shown):
        row, column = divmod(number, COLUMNS)
        _draw(image[row * height + GAP:(row + 1) * height - GAP, column * width + GAP:(column + 1) * width - GAP], tile)
    return np.vstack([image, *_lines(problems), *_legend(legend)])


def _lines(problems: Sequence[str]) -> List[UInt8Array]:
    """[(LINE, WIDTH, 3) uint8, bgr], one for each problem; one that is too long is smaller."""
    shown = list(problems[:MAX_PROBLEMS])
    if len(problems) > len(shown):
        shown[-1] = '%s  (and %d more)' % (shown[-1], len(problems) - len(shown))
    found = []
    for text in shown:
        line: UInt8Array = np.zeros((LINE, WIDTH, 3), np.uint8)
        line[1:-1] = TILE_COLOURS[ATTENTION]
        width = cv2.getTextSize(text, FONT, FONT_SIZE, 1)[0][0]
        size = FONT_SIZE * min(1.0, (WIDTH - 4 * GAP) / max(width, 1))
        cv2.putText(line, text, (2 * GAP, LINE - 7), FONT, size, TEXT_COLOURS[ATTENTION], 1, cv2.LINE_AA)
        found.append(line)
    return found


def _legend(entries: Mapping[str, Optional[Tuple[int, int, int]]]) -> List[UInt8Array]:
    """[(LINE, WIDTH, 3) uint8, bgr]"""
    lines: List[UInt8Array] = []
    left = WIDTH
    for name, colour in entries.items():
        width = 4 * GAP + SQUARE + cv2.getTextSize(name, FONT, FONT_SIZE, 1)[0][0]
        if left + width > WIDTH:
            lines.append(np.zeros((LINE, WIDTH, 3), np.uint8))
            left = GAP
        top = (LINE - SQUARE) // 2
        lines[-1][top:top + SQUARE, left:left + SQUARE] = RAINBOW if colour is None else colour[::-1]
        cv2.putText(lines[-1], name, (left + SQUARE + GAP, top + SQUARE - 1), FONT, FONT_SIZE, LEGEND_COLOUR, 1,
                    cv2.LINE_AA)
        left += width
    return lines


def _draw(image: UInt8Array, tile: Tile) -> None:
    height, width = image.shape[:2]
    image[:] = TILE_COLOURS[tile.level]
    if tile.level == GOOD:
        image[:, :2 * GAP] = MARK
    colour = TEXT_COLOURS[tile.level]
    cv2.putText(image, tile.label, (5 * GAP, height // 3), FONT, 0.42, colour, 1, cv2.LINE_AA)
    lines = [line for line in tile.text.split(': ', 1) if line] or ['-']    # 'LOCKED: why' is larger on two lines
    room = 2 * height // 3 // len(lines)
    for number, line in enumerate(lines):
        write(image, line, (4 * GAP, height // 3 + number * room, width - 6 * GAP, room), colour)


def _tile(label: str, text: str, factor: float, value: float, limits: AttentionLimits) -> Tile:
    """:param factor: of the value in the text"""
    if not math.isfinite(value):
        return Tile(label, '-', UNKNOWN)
    return Tile(label, text % (factor * value), _level(value, limits))


def _level(value: float, limits: AttentionLimits) -> str:
    sign = 1 if limits.bad > limits.attention else -1
    return (BAD if sign * value >= sign * limits.bad else
            ATTENTION if sign * value >= sign * limits.attention else GOOD)


def _known(text: str) -> str:
    return GOOD if text else UNKNOWN


def _link(status: OperatorStatus) -> Tile:
    silence = status.link_silence
    if silence > LINK_TIMEOUT:
        return Tile('LINK', 'NO LINK' + ('' if math.isinf(silence) else ' ' + duration(silence)), BAD)
    if math.isnan(silence) or math.isnan(status.sent):
        return Tile('LINK', '-', UNKNOWN)
    of: List[float] = [status.sent] + ([status.capacity] if math.isfinite(status.capacity) else [])
    rates = ' of '.join('%.3g' % value if value < 100 else '%.0f' % value for value in of)
    if status.longest:
        return Tile('LINK [Mbit/s]', '%s: > %d B do not pass' % (rates, status.longest), ATTENTION)
    return Tile('LINK [Mbit/s]', rates, GOOD)


def _battery(status: OperatorStatus) -> Tile:
    volts = '' if math.isnan(status.voltage) else '%.1f V' % status.voltage
    charge = _tile('BATTERY', '%.0f %%', 100, status.charge, CHARGE)
    if charge.level == UNKNOWN:
        return Tile('BATTERY', volts or '-', _known(volts))
    return charge._replace(text=' '.join(filter(None, (charge.text, volts))))


def _driver(status: OperatorStatus) -> Tile:
    if status.drives:
        return Tile('DRIVES', 'you', GOOD)
    if status.driver:
        return Tile('DRIVES', status.driver, ATTENTION)
    return Tile('DRIVES', 'nobody' if status.control else '-', UNKNOWN)


def _stop(status: OperatorStatus) -> Tile:
    """Whether the robot obeys, or why not."""
    if status.estop:
        return Tile('STOP', EMERGENCY_STOP, BAD)
    if status.free:
        return Tile('STOP', status.control.replace('in control', 'free').replace(':', ','), GOOD)
    level = ATTENTION if status.drives and status.commands else UNKNOWN
    return Tile('STOP', status.control or '-', level)
