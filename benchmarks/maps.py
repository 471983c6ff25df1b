# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles: bytes beside zlib, PNG and the interleaved way, and the processor time of each step.

Recorded maps are used where they are at hand: as they are (three values), with their grey values (scale), and as costs.
"""
import statistics
import time
from typing import Any, Callable, Dict, List

import numpy as np

from evaluation.maps import CORNER, ROOM, costs, recorded, recorded_names, simulated, sizes
from smokebot_udp.arrays import Array
from smokebot_udp.codecs.tiles.coder import decode, encode
from smokebot_udp.codecs.tiles.overview import overview
from smokebot_udp.codecs.tiles.tiling import Tiling
from smokebot_udp.streams.grid.copies import Pattern
from smokebot_udp.streams.grid.tile_queue import Item, TileQueue

ROUNDS, QUICK_ROUNDS = 9, 3
SIDE = 20
"""Side of the square that changes [cell]."""
GOAL, GOAL_PLUS = 0.7, 300
"""Goal of the size of the tiles of a map of three values: at most this part of zlib's, plus this number of bytes."""
STEPS = 'tiling', 'encode', 'decode', 'change', 'pool', 'look'
QUEUED = 4000
"""Number of tiles in a map. The next ones to send are chosen up to fifty times a second."""


def maps(quick: bool) -> Dict[str, Array]:
    """{name: (height, width) int8}"""
    built = simulated()
    found = {'simulated building': built, 'simulated building, costs': costs(built)}
    names = list(recorded_names())
    for name in names[:2] if quick else names:
        cells = recorded(name)
        found.update({name: cells, name + ', scale': recorded(name, graded=True), name + ', costs': costs(cells)})
    return found


class Steps:
    """Times of the steps of a map.

    :param cells: (height, width) int8
    """

    def __init__(self, cells: Array) -> None:
        self._cells, self._random = cells, np.random.RandomState(1)
        self._times: Dict[str, List[float]] = {}

    def medians(self, rounds: int) -> Dict[str, float]:
        """{step: [ms of CPU]}; the first round, which compiles, does not count."""
        for _ in range(rounds + 1):
            self._round()
        return {step: statistics.median(times[1:]) for step, times in self._times.items()}

    def _round(self) -> None:
        tiling, cells = Tiling(ROOM), self._cells
        tiles = self._timed('tiling', tiling.update, cells, CORNER)
        parts = [cells[tile.row - CORNER[1]:, tile.column - CORNER[0]:][:tile.height, :tile.width] for tile in tiles]
        self._timed('encode', lambda: [encode(part, ROOM) for part in parts])
        decoded = self._timed('decode', lambda: [
            decode(np.frombuffer(tile.data, np.uint8), tile.height, tile.width) for tile in tiles])
        assert all(np.array_equal(*pair) for pair in zip(decoded, parts))
        changed = cells.copy()
        row, column = (self._random.randint(0, max(1, side - SIDE)) for side in cells.shape)
        changed[row:row + SIDE, column:column + SIDE] = 100
        self._timed('change', tiling.update, changed, CORNER)
        self._timed('pool', overview, cells, CORNER, ROOM)
        queue = TileQueue()
        queue.attend(['one', 'another'], 0.0)
        queue.add([Item(number + 1, tiles[number % len(tiles)].place, b'', False) for number in range(QUEUED)])
        self._timed('look', lambda: (queue.due(0.0, Pattern(0.2, 5.0), (0.0, 0.0)), queue.wanted(0.0)))

    def _timed(self, step: str, function: Callable[..., Any], *arguments: Any) -> Any:
        begun = time.process_time()
        result = function(*arguments)
        self._times.setdefault(step, []).append(1e3 * (time.process_time() - begun))
        return result


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """{map: sizes and times}"""
    results = {}
    for name, cells in maps(quick).items():
        log(name)
        results[name] = {'shape': list(cells.shape), **sizes(cells)._asdict(),
                         **Steps(cells).medians(QUICK_ROUNDS if quick else ROUNDS)}
    return results


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    lines = ['maps in tiles of at most %d bytes: bytes, median times [ms of CPU]' % ROOM, '']
    lines.append('%-34s%12s%8s%6s%8s%8s%7s%9s%13s' % (
        'map', 'cells', 'tiles', 'dgrams', 'zlib', 'PNG', 'ratio', 'overview', 'interleaved')
        + ''.join('%9s' % step for step in STEPS))
    for name, of_map in results.items():
        missed = ',' not in name and of_map['tiles'] > GOAL * of_map['zlib'] + GOAL_PLUS
        lines.append('%-34s%12s%8d%6d%8d%8d%7.3f%9s%13s' % (
            name, '%d x %d' % tuple(of_map['shape']), of_map['tiles'], of_map['datagrams'], of_map['zlib'],
            of_map['png'], of_map['tiles'] / of_map['zlib'], '%d /%d' % (of_map['overview'], 1 << of_map['shift']),
            '%d /%d' % (of_map['interleaved'], of_map['factor'])) + ''.join(
                '%9.1f' % of_map[step] for step in STEPS) + (' goal missed' if missed else ''))
    lines.append('ratio: to zlib; /n: reduced by n; change: %d x %d cells; pool: the overview; look: what is next '
                 'of %d tiles' % (SIDE, SIDE, QUEUED))
    return '\n'.join(lines)
