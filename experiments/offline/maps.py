# SPDX-License-Identifier: BSD-3-Clause
"""Maps in tiles beside the interleaved way and a whole PNG: bytes, and the time to a complete map over loss."""
import math
import pathlib
import statistics
from typing import Any, Dict, List, Mapping, Tuple, Union

import numpy as np

from evaluation.map_transfer import MapTransfer, Outcome, fragments
from evaluation.maps import png, recorded, recorded_names, simulated, sizes
from smokebot_udp.arrays import Array

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Maps in tiles: bytes, and time to a complete map'

EXPLANATION = """
A map crosses as **tiles**: rectangles of cells, each compressed without loss in one datagram and decodable alone, cut
so that they fit. An **overview** of a few datagrams comes first. Operators report which tiles they hold, and only what
they lack is sent again.

Beside it: the deliverable's **interleaved** map, reduced until 256 datagrams suffice and repeated every 5 s; and the
whole map as a **PNG** in fragments, sent again and again without a pause, where all fragments must be of one round, as
those of a large UDP message, or may be of any. Losses are independent, of datagrams and reports alike, with 20 ms of
delay each way. *First* is when anything is shown; *complete*, when all cells are shown as they are; of the interleaved
map, when all of the reduced map is. Then squares of 20 × 20 cells change one after the other.
"""

LARGE = 'willow-full-0.05'
"""The map whose time is measured, where it is at hand."""
RATES = 1.0e6, 0.5e6
"""What the link leaves to the map: half of 2 Mbit/s, and less [bit/s]."""
LOSSES = 0.0, 0.2, 0.5, 0.8
SEEDS = 5
LIMIT = 40.0
"""Simulated time after which a map is given up [s]."""
TILES, INTERLEAVED, ONE_ROUND, ANY_ROUND = 'tiles', 'interleaved', 'PNG, one round', 'PNG, any rounds'
COLOURS = {TILES: drawing.OURS, INTERLEAVED: drawing.PAPER, ONE_ROUND: '#1f77b4', ANY_ROUND: '#17becf'}
SIDE, CHANGES, SETTLED = 20, 8, 3.0
"""Squares that change [cell], how many, and the time before each [s]."""
GOALS = {0.0: 1.0, 0.2: 1.5, 0.5: 3.0, 0.8: 8.0}
"""{loss: time to the complete map at 1 Mbit/s [s]}"""
CHANGE_LOSS, CHANGE_TIME, CHANGE_BYTES, HELD_RATE = 0.2, 0.3, 2000, 1000
"""A change at this loss is to be shown in this time in 95 % of cases [s], by this many bytes; and bytes a second of a
map that is held."""


def maps(quick: bool) -> Dict[str, Array]:
    """Simulated, and recorded ones."""
    found = {'simulated building': simulated()}
    if not quick:
        found.update({name: recorded(name) for name in recorded_names()})
    return found


def outcome(method: str, cells: Array, rate: float, loss: float, seed: int) -> Outcome:
    """Send a map once."""
    if method in (TILES, INTERLEAVED):
        return MapTransfer(method, rate, loss, seed).show(cells, LIMIT)
    return fragments(len(png(cells)), rate, loss, seed, LIMIT, method == ONE_ROUND)


def changes(cells: Array, rate: float, loss: float, seed: int) -> List[Dict[str, Any]]:
    """Show squares that change, one after the other; a row each."""
    transfer, random, rows = MapTransfer(TILES, rate, loss, seed), np.random.RandomState(seed), []
    transfer.show(cells, LIMIT)
    for _ in range(CHANGES):
        transfer.settle(SETTLED)
        held = transfer.settle(SETTLED) / SETTLED
        cells = cells.copy()
        row, column = (random.randint(0, side - SIDE) for side in cells.shape)
        area = cells[row:row + SIDE, column:column + SIDE]
        area[:] = np.where(area == 100, 0, 100)
        shown = transfer.show(cells, LIMIT)
        rows.append({'loss': loss, 'shown [s]': shown.complete, 'sent [byte]': shown.sent, 'held [byte/s]': held})
    return rows


def run(run: Run) -> None:
    """Measure all cases: bytes.csv, times.csv and changes.csv."""
    found = maps(run.quick)
    table.write(run.folder / 'bytes.csv', [{'map': name, 'cells': cells.size, **sizes(cells)._asdict()}
                                           for name, cells in found.items()])
    name = LARGE if LARGE in found else 'simulated building'
    cells, seeds = found[name], 1 if run.quick else SEEDS
    cases = [(rate, loss, method) for rate in RATES[:1 if run.quick else None] for loss in LOSSES for method in COLOURS]
    rows = []
    for rate, loss, method in run.steps(cases, lambda case: '%g Mbit/s, %g lost, %s' % (case[0] / 1e6, *case[1:])):
        rows += [{'map': name, 'rate [Mbit/s]': rate / 1e6, 'loss': loss, 'method': method,
                  **outcome(method, cells, rate, loss, run.seed + seed)._asdict()} for seed in range(seeds)]
    table.write(run.folder / 'times.csv', rows)
    table.write(run.folder / 'changes.csv', [
        row for seed in range(seeds) for row in changes(cells, RATES[0], CHANGE_LOSS, run.seed + seed)])


def medians(folder: pathlib.Path) -> Dict[Tuple[float, str, float], Outcome]:
    """{(rate, method, loss): medians}"""
    cases: Dict[Tuple[float, str, float], List[table.Row]] = {}
    for row in table.read(folder / 'times.csv'):
        cases.setdefault((row['rate [Mbit/s]'], row['method'], row['loss']), []).append(row)

    def median(rows: List[table.Row], field: str) -> float:
        return statistics.median(float(row[field]) for row in rows)
    return {case: Outcome(median(rows, 'first'), median(rows, 'complete'), int(median(rows, 'sent')))
            for case, rows in cases.items()}


def change_stats(folder: pathlib.Path) -> Dict[str, float]:
    """Statistics of all changes: the time within which 95 % are shown, the median and the largest size sent, and the
    mean rate before a change."""
    rows = table.read(folder / 'changes.csv')
    times = sorted(float(row['shown [s]']) for row in rows)
    return {'shown, 95 % [s]': times[math.ceil(0.95 * len(times)) - 1],
            'sent, median [byte]': statistics.median(row['sent [byte]'] for row in rows),
            'sent, most [byte]': max(row['sent [byte]'] for row in rows),
            'held, mean [byte/s]': statistics.mean(row['held [byte/s]'] for row in rows)}


def missed(folder: pathlib.Path) -> List[str]:
    """The goals that are missed."""
    found, texts = medians(folder), []
    for loss, goal in GOALS.items():
        complete = found[RATES[0] / 1e6, TILES, loss].complete
        if complete > goal:
            texts.append('complete after %.1f s at %g lost, goal %g s' % (complete, loss, goal))
    stats = change_stats(folder)
    for key, goal in (('shown, 95 % [s]', CHANGE_TIME), ('sent, median [byte]', CHANGE_BYTES),
                      ('held, mean [byte/s]', HELD_RATE)):
        if stats[key] > goal:
            texts.append('change: %s is %g, goal %g' % (key, stats[key], goal))
    return texts


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Time over loss, and tables."""
    found = medians(folder)
    draw(found, folder / 'maps_time.png')
    name = table.read(folder / 'times.csv')[0]['map']
    times = [[*case, *map(_text, one)] for case, one in found.items()]
    return [
        Figure('maps_time.png', 'Time until %s is complete over the loss, and (dotted) until anything of it is shown; '
               'medians. Where a line ends, the map was not complete after %g s.' % (name, LIMIT)),
        bytes_table(folder),
        Table('%s, medians:' % name, [
            'rate [Mbit/s]', 'method', 'loss', 'first [s]', 'complete [s]', 'sent [byte]'], times),
        changes_table(folder)]


def bytes_table(folder: pathlib.Path) -> Table:
    """Sizes of whole maps."""
    rows = table.read(folder / 'bytes.csv')
    return Table('Bytes of whole maps: data of the tiles, in datagrams; the overview, reduced by 2^shift; zlib (level '
                 '9) and PNG of the whole array; a cycle of the interleaved map on the wire, reduced by a factor:',
                 list(rows[0]), [list(row.values()) for row in rows])


def changes_table(folder: pathlib.Path) -> Table:
    """What a change takes."""
    stats = change_stats(folder)
    return Table('Changes of %d × %d cells, %g %% lost:' % (SIDE, SIDE, 100 * CHANGE_LOSS), list(stats),
                 [['%.3g' % value if value < 10 else '%.0f' % value for value in stats.values()]])


def times_table(folder: pathlib.Path) -> Table:
    """Each method over loss, at the first rate."""
    found, name = medians(folder), table.read(folder / 'times.csv')[0]['map']
    rate = RATES[0] / 1e6

    def row(words: str, method: str, field: str) -> List[str]:
        return [words, *(_text(getattr(found[rate, method, loss], field)) for loss in LOSSES)]
    return Table('%s at %g Mbit/s, by the packet loss; medians of %d runs, – where it was not complete after %g s:'
                 % (name, rate, SEEDS, LIMIT), ['', *('%g %%' % (100 * loss) for loss in LOSSES)], [
                     row('tiles: overview shown [s]', TILES, 'first'), row('tiles: complete [s]', TILES, 'complete'),
                     row('tiles: sent until then [byte]', TILES, 'sent'),
                     *(row('%s: complete [s]' % method, method, 'complete') for method in COLOURS if method != TILES)])


def _text(value: float) -> str:
    if not math.isfinite(value):
        return '–'
    return '%.2f' % value if value < 1000 else '%.0f' % value


def draw(found: Mapping[Tuple[float, str, float], Outcome], path: pathlib.Path) -> None:
    """Time over loss, an axis for each rate."""
    rates = sorted({rate for rate, _, _ in found}, reverse=True)
    figure, grid = drawing.canvas(5.0 * len(rates), 4.2, 1, len(rates), sharey=True, squeeze=False)
    for axes, rate in zip(grid[0], rates):
        for method, colour in COLOURS.items():
            points = [(100 * loss, found[rate, method, loss]) for loss in LOSSES]
            shown = [(loss, one) for loss, one in points if math.isfinite(one.complete)]
            axes.plot([loss for loss, _ in shown], [one.complete for _, one in shown], 'o-', color=colour, label=method)
            if method == TILES:
                axes.plot([loss for loss, _ in points], [one.first for _, one in points], ':', color=colour)
        axes.set_yscale('log')
        axes.set_xlabel('lost [%]')
        axes.set_title('%g Mbit/s for the map' % rate, fontsize=10)
    grid[0, 0].set_ylabel('complete after [s]')
    drawing.legend_right(grid[0, -1])
    drawing.save(figure, path)


DOC_TABLES = {'times': times_table, 'changes': changes_table, 'bytes': bytes_table}
