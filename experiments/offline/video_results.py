# SPDX-License-Identifier: BSD-3-Clause
"""What `video` measured: figures, tables, and which goals were missed."""
import math
import pathlib
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from evaluation.video_link import VISIBLE
from evaluation.video_ways import FIXED, H264, JPEG, KNOWN, LAYERED, NIMBRO, OURS, PEERS, PREDICTED, SLICES
from smokebot_udp.arrays import Array, FloatArray
from smokebot_udp.link_lab.channel import LinkConditions

from .. import drawing, table
from ..runner import Figure, Table

COLOURS = {H264: drawing.OURS, PREDICTED: '#ff7f0e', LAYERED: drawing.LAYERED, NIMBRO: drawing.PAPER, SLICES: '#17becf',
           FIXED: '#2ca02c', KNOWN: '#1f77b4', JPEG: '#9467bd'}
"""{way: colour}"""

LINKS = {'0 %': LinkConditions(), '5 %': LinkConditions(loss=0.05), '20 %': LinkConditions(loss=0.2),
         '50 %': LinkConditions(loss=0.5), '30 %, bursts of 5': LinkConditions(loss=0.3, burst=5)}
"""{packet loss: what the link does}"""

BEST_PEER = {0.3: (37.9, 37.3, 35.7, 32.7, 35.3), 1: (41.1, 40.5, 39.3, 36.7, 37.2),
             3: (44.4, 44.0, 42.6, 40.9, 40.4)}
"""{rate [Mbit/s]: for each of LINKS the PSNR of the best peer on `euroc` in an earlier, longer study [dB]}"""

JUDGED = {'euroc': (0.3, 1, 3), 'corridor': (0.3, 1, 3)}
"""{clip: rates [Mbit/s] at which ours must be as good as the best peer}"""
TOLERANCE = 1.0
"""Maximum PSNR by which ours may be below the best peer [dB]."""
LONGEST_FREEZE = 0.5
"""Maximum duration of a freeze of our H.264 at a loss of 50 % [s]."""

STEP_TIMES = 5.0, 10.0
"""When the loss changes [s]."""
STEP_WAYS = H264, SLICES, FIXED
RECOVERY, RECOVERY_SPAN = 0.5, 0.5
"""Time from a step of the loss to the comparison with the steady quality, and duration of the comparison [s]."""
RECOVERED = 2.0
"""Maximum PSNR by which the quality may be below the steady one soon after a step of the loss [dB]."""

STRIPS = {'sway': (0.3, '20 %'), 'euroc': (1.0, '20 %'), 'corridor': (1.0, '20 %'), 'thermal': (1.0, '20 %')}
"""{clip: rate [Mbit/s] and link of the images that are shown}"""
STRIP_PERIOD, STRIP_COLUMNS, STRIP_WIDTH = 5, 5, 320

Rows = Sequence[table.Row]


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """All figures and tables of a run, for the report."""
    rows = table.read(folder / 'video.csv')
    names = list(dict.fromkeys(row['clip'] for row in rows))
    items: List[Union[Figure, Table]] = []
    for name in names:
        of_clip = [row for row in rows if row['clip'] == name]
        draw(of_clip, name, folder / ('psnr_%s.png' % name))
        items.append(Figure('psnr_%s.png' % name, '%s: how close the screen is to what the camera sees.' % name))
        items += tables(of_clip, name)
    items += step_items(folder)
    with np.load(str(folder / 'strips.npz')) as strips:
        for name in names:
            shown = [row for row in table.read(folder / 'strips.csv') if row['clip'] == name]
            if shown:
                draw_strips(strips, shown, folder / ('strips_%s.png' % name))
                items.append(Figure('strips_%s.png' % name, '%s: the screen every %.1f s at %g Mbit/s, %s lost.' % (
                    name, STRIP_PERIOD / 10, *STRIPS[name])))
    return items


def mean(rows: Rows, way: str, rate: float, link: str, column: str) -> Optional[float]:
    """The mean of a column over seeds; None: not measured."""
    found = [row[column] for row in rows
             if (row['way'], row['Mbit/s'], row['link']) == (way, rate, link) and row[column] is not None]
    return float(np.mean(found)) if found else None


def best_peer(rows: Rows, rate: float, link: str) -> Tuple[float, str]:
    """The highest PSNR of all peers [dB], and whose it is; NaN: none was measured."""
    found = ((mean(rows, way, rate, link, 'PSNR [dB]'), way) for way in PEERS)
    return max(((value, way) for value, way in found if value is not None), default=(math.nan, ''))


def rates_of(rows: Rows) -> List[float]:
    """All rates, ascending [Mbit/s]."""
    return sorted({row['Mbit/s'] for row in rows})


def draw(rows: Rows, name: str, path: pathlib.Path) -> None:
    """PSNR over the links, a panel for each rate."""
    rates = rates_of(rows)
    figure, grid = drawing.canvas(3.6 * len(rates), 4.8, 1, len(rates), sharey=True, squeeze=False)
    for axes, rate in zip(grid[0], rates):
        for order, (way, colour) in zip(range(len(COLOURS) + 2, 2, -1), COLOURS.items()):
            values = [mean(rows, way, rate, link, 'PSNR [dB]') for link in LINKS]
            axes.plot(range(len(LINKS)), [np.nan if value is None else value for value in values],
                      'o-' if way in OURS else '.--', color=colour, label=way, zorder=order)
        axes.set(title='%s, %g Mbit/s' % (name, rate), xlabel='packets lost')
        axes.set_xticks(range(len(LINKS)))
        axes.set_xticklabels([link.replace(', ', ',\n') for link in LINKS])
    grid[0][0].set_ylabel('PSNR [dB]')
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc='outside lower center', ncols=4)
    drawing.save(figure, path)


def tables(rows: Rows, name: str) -> Iterator[Table]:
    """PSNR, our lead, and what else a crew asks for."""
    head = ['Mbit/s', 'way', *LINKS]
    for column, words, digits in (
            ('PSNR [dB]', 'PSNR [dB]', 1), ('visible [%]', 'share of time with %g dB or more [%%]' % VISIBLE, 0),
            ('freeze [s]', 'longest freeze [s]', 1)):
        yield Table('%s: %s:' % (name, words), head, [
            [rate, way, *(rounded(mean(rows, way, rate, link, column), digits) for link in LINKS)]
            for rate in rates_of(rows) for way in COLOURS])
    yield Table('%s: lead of our H.264 over the best peer [dB], and which peer that is:' % name, ['Mbit/s', *LINKS],
                [[rate, *(lead(rows, rate, link) for link in LINKS)] for rate in rates_of(rows)])
    yield Table('%s: CPU time per image without loss, encode / decode [ms]:' % name,
                ['way', *('%g Mbit/s' % rate for rate in rates_of(rows))],
                [[way, *(times(rows, way, rate) for rate in rates_of(rows))] for way in COLOURS])


def doc_psnr(folder: pathlib.Path) -> Table:
    """Ours, the best peer and nimbro_network on each clip."""
    rows, lines = table.read(folder / 'video.csv'), []
    for name in dict.fromkeys(row['clip'] for row in rows):
        of_clip = [row for row in rows if row['clip'] == name]
        for rate in rates_of(of_clip):
            for way in (H264, PREDICTED, NIMBRO):
                lines.append([name, rate, way, *(rounded(mean(of_clip, way, rate, link, 'PSNR [dB]'), 1)
                                                 for link in LINKS)])
            best = [best_peer(of_clip, rate, link)[0] for link in LINKS]
            lines.append([name, rate, 'best peer', *('' if math.isnan(value) else '%.1f' % value for value in best)])
    return Table('PSNR [dB] of the screen, by the packet loss; *best peer* is the best of all ways but this package\'s '
                 'in the same cell:', ['clip', 'Mbit/s', 'way', *LINKS], lines)


def doc_leads(folder: pathlib.Path) -> Table:
    """The lead of the better one of our ways over the best peer, in each cell."""
    rows, lines, leads = table.read(folder / 'video.csv'), [], []
    for name in dict.fromkeys(row['clip'] for row in rows):
        of_clip = [row for row in rows if row['clip'] == name]
        for rate in rates_of(of_clip):
            found = [best_lead(of_clip, rate, link) for link in LINKS]
            lines.append([name, rate, *('' if math.isnan(value) else '%+.1f' % value for value in found)])
            leads += [value for value in found if not math.isnan(value)]
    return Table('Lead of the better one of our H.264 and our layered images over the best peer [dB]: at least −%g dB '
                 'in %d of %d cells.' % (TOLERANCE, sum(value >= -TOLERANCE for value in leads), len(leads)),
                 ['clip', 'Mbit/s', *LINKS], lines)


def best_lead(rows: Rows, rate: float, link: str) -> float:
    """The lead of the better one of our ways over the best peer [dB]; NaN: not measured."""
    ours = [value for value in (mean(rows, way, rate, link, 'PSNR [dB]') for way in OURS) if value is not None]
    return max(ours, default=math.nan) - best_peer(rows, rate, link)[0]


def doc_times(folder: pathlib.Path) -> Table:
    """CPU time of our ways."""
    rows = table.read(folder / 'video.csv')
    names, rates = list(dict.fromkeys(row['clip'] for row in rows)), rates_of(rows)
    return Table('CPU time per image without loss, encoding / decoding [ms]:',
                 ['clip', 'way', *('%g Mbit/s' % rate for rate in rates)], [
                     [name, way, *(times([row for row in rows if row['clip'] == name], way, rate) for rate in rates)]
                     for name in names for way in (H264, PREDICTED)])


def lead(rows: Rows, rate: float, link: str) -> Optional[str]:
    """The lead of our H.264 over the best peer, with the peer's name [dB]; None: it was not measured."""
    ours = mean(rows, H264, rate, link, 'PSNR [dB]')
    best, way = best_peer(rows, rate, link)
    return None if ours is None or not way else '%+.1f (%s)' % (ours - best, way)


def times(rows: Rows, way: str, rate: float) -> Optional[str]:
    """CPU time of a way per image [ms]; None: it was not measured."""
    first = next(iter(LINKS))
    encode, decode = (mean(rows, way, rate, first, column) for column in ('encode [ms]', 'decode [ms]'))
    return None if encode is None or decode is None else '%.1f / %.1f' % (encode, decode)


def rounded(value: Optional[float], digits: int) -> Optional[str]:
    """For a table; None stays None."""
    return None if value is None else '%.*f' % (digits, value)


def step_items(folder: pathlib.Path) -> Iterator[Union[Figure, Table]]:
    """The link whose loss changes; none where that was not measured."""
    if not (folder / 'steps.csv').exists():
        return
    rows = table.read(folder / 'steps.csv')
    names = list(dict.fromkeys(row['clip'] for row in rows))
    figure, grid = drawing.canvas(6.0 * len(names), 4.2, 1, len(names), squeeze=False)
    for axes, name in zip(grid[0], names):
        for way in STEP_WAYS:
            times_, values = curve(rows, name, way, 'steps')
            axes.plot(times_, values, color=COLOURS[way], label=way)
        axes.set(title='%s, 1 Mbit/s; 30 %% lost from %g to %g s, else 2 %%' % (name, *STEP_TIMES), xlabel='time [s]')
    grid[0][0].set_ylabel('PSNR [dB]')
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc='outside lower center', ncols=3)
    drawing.save(figure, folder / 'steps.png')
    yield Figure('steps.png', 'The loss steps from 2 to 30 % and back; mean over seeds.')
    yield steps_table(folder)


def steps_table(folder: pathlib.Path) -> Table:
    """What a step of the loss costs."""
    rows = table.read(folder / 'steps.csv')
    return Table('The loss steps from 2 to 30 %% and back. Missing to the steady quality, %g to %g s after each step '
                 '[dB]:' % (RECOVERY, RECOVERY + RECOVERY_SPAN),
                 ['clip', 'way', 'after the step up', 'after the step down'],
                 [[name, way, *('%.1f' % gap for gap in gaps(rows, name, way))]
                  for name in dict.fromkeys(row['clip'] for row in rows) for way in STEP_WAYS])


def curve(rows: Rows, name: str, way: str, link: str) -> Tuple[FloatArray, FloatArray]:
    """(n,) times [s] and (n,) PSNR [dB]."""
    found = [(row['time [s]'], row['PSNR [dB]']) for row in rows
             if (row['clip'], row['way'], row['link']) == (name, way, link)]
    times_, values = np.array(found, float).T
    return times_, values


def gaps(rows: Rows, name: str, way: str) -> List[float]:
    """How far the quality is below that of a link with the same loss all the time, soon after each step [dB]."""
    found = []
    for when, steady in zip(STEP_TIMES, ('30 %', '2 %')):
        times_, values = curve(rows, name, way, 'steps')
        soon = (times_ >= when + RECOVERY - 1e-9) & (times_ < when + RECOVERY + RECOVERY_SPAN - 1e-9)
        found.append(float((curve(rows, name, way, steady)[1] - values)[soon].mean()))
    return found


def draw_strips(strips: Mapping[str, Array], rows: Rows, path: pathlib.Path) -> None:
    """A row of images for each way."""
    ways = list(dict.fromkeys(row['way'] for row in rows))
    keys = [['%s %s %d' % (row['clip'], way, row['image']) for row in rows if row['way'] == way] for way in ways]
    height, width = strips[keys[0][0]].shape[:2]
    columns = len(keys[0])
    figure, grid = drawing.canvas(2.4 * columns, (2.4 * height / width + 0.35) * len(ways), len(ways), columns,
                                  squeeze=False)
    by_key: Dict[str, table.Row] = {'%(clip)s %(way)s %(image)d' % row: row for row in rows}
    for axes, key in zip(grid.flat, [key for of_way in keys for key in of_way]):
        row, image = by_key[key], strips[key]
        drawing.show_image(axes, image[:, :, ::-1] if image.ndim == 3 else image, '%s\n%.1f dB%s' % (
            row['way'], row['PSNR [dB]'], '' if row['new'] else ', nothing new'), vmin=0, vmax=255)
    drawing.save(figure, path)


def missed(folder: pathlib.Path) -> List[str]:
    """Where our H.264 falls behind the best peer, freezes, or takes long to adapt."""
    rows = table.read(folder / 'video.csv')
    found = []
    for name, rates in JUDGED.items():
        of_clip = [row for row in rows if row['clip'] == name]
        for rate in set(rates) & set(rates_of(of_clip)):
            found += list(behind(of_clip, name, rate))
    for row in rows:
        if (row['way'], row['link']) == (H264, '50 %') and row['freeze [s]'] > LONGEST_FREEZE:
            found.append('%(clip)s, %(Mbit/s)g Mbit/s, %(link)s: a freeze of %(freeze [s])g s' % row)
    return found + list(slow_steps(folder))


def behind(rows: Rows, name: str, rate: float) -> Iterator[str]:
    """At which losses our H.264 is below the best peer of a clip and rate."""
    for number, link in enumerate(LINKS):
        ours = mean(rows, H264, rate, link, 'PSNR [dB]')
        best, way = best_peer(rows, rate, link)
        if name == 'euroc':
            best, way = BEST_PEER[rate][number], 'the best peer of the earlier study'
        if ours is not None and ours < best - TOLERANCE:
            yield '%s, %g Mbit/s, %s: %.1f dB, %s: %.1f dB' % (name, rate, link, ours, way, best)


def slow_steps(folder: pathlib.Path) -> Iterator[str]:
    """After which steps of the loss our H.264 takes too long."""
    if (folder / 'steps.csv').exists():
        rows = table.read(folder / 'steps.csv')
        for name in dict.fromkeys(row['clip'] for row in rows):
            for words, gap in zip(('up', 'down'), gaps(rows, name, H264)):
                if gap > RECOVERED:
                    yield '%s: %.1f dB below the steady value %g s after the step %s' % (name, gap, RECOVERY, words)
