# SPDX-License-Identifier: BSD-3-Clause
"""Image quality over loss, at equal bytes on the wire: layered and interleaved images, and JPEG with erasure codes."""
import pathlib
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from evaluation import jpeg_packets
from evaluation.display import HEIGHT, PAN, WIDTH, Display, clip
from evaluation.jpeg_packets import ErasureCode, JpegLadder
from evaluation.losses import delivered
from evaluation.offline_link import Sender, datagram_count, image_message, image_of, image_receiver, received, wire_size
from evaluation.recordings import photographs
from smokebot_udp.arrays import Array, BoolArray, UInt8Array
from smokebot_udp.codecs.concealment.fill import BEST
from smokebot_udp.link_lab.channel import Channel, LinkConditions
from smokebot_udp.streams.air import LossBeliefs

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Images over loss, at equal bytes on the wire'

EXPLANATION = """
A camera of 320 × 240 pixels pans over a photograph, 8 pixels per image, as on a robot that turns. Each method may use
the same number of bytes per image, headers included: as many as all 64 segments need, as 16 and as 4 of them.

* **Layered** (this package, `coding: layered`): compressed, and protected for the loss that the reports of the last 6 s
  say.
* **Interleaved** (this package, `coding: interleaved`, coarse segments first): nothing is compressed, and whatever
  arrives makes an image. Missing pixels are filled by kriging, or from the nearest pixel, as in the deliverable.
* **Whole JPEG**: the best one that fits, scaled down where that is better. One lost packet costs the image.
* **JPEG with 25 % redundancy**: an ideal erasure code restores up to a fifth of the packets.
* **JPEG with a code that knows the loss**: an ideal erasure code with the redundancy of the highest expected PSNR at
  this loss, known beforehand. No real code is better.

Where nothing of an image can be shown, the last one stays on the display, and is compared with what the camera sees by
then; before the first one, the display is grey. A PSNR above 60 dB counts as 60.
"""

PHOTOGRAPHS = 'astronaut', 'camera', 'coffee', 'gravel', 'motorcycle_left', 'rocket'
SEGMENTS = 64, 16, 4
"""Numbers of segments per image. Each gives a budget: the size of an image in that many segments."""

LOSSES = 0.0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95
BURST = 8
"""Mean run of lost packets, where losses come in bursts."""

BURSTY = 16
"""Number of segments at whose budget losses come in bursts, too."""

IMAGES, QUICK_IMAGES = 12, 4
"""Number of images of each clip, in a full and in a quick run."""

REPORTS, RATE = 60, 10.0
"""Number of images that were reported before the first one, and images per second."""

LAYERED = 'layered (this package)'
INTERLEAVED = {BEST: 'interleaved, kriging (this package)', 'nearest': 'interleaved, nearest pixel (the deliverable)'}
"""{method of concealment: name}"""

JPEGS = 'whole JPEG', 'JPEG, 25 % redundancy', 'JPEG, a code that knows the loss'
COLOURS = dict(zip((LAYERED, *INTERLEAVED.values(), *JPEGS), (
    drawing.LAYERED, drawing.OURS, drawing.PAPER, '#1f77b4', '#2ca02c', '#9467bd')))
"""{method: colour}"""

SHOWN = 'motorcycle_left', 16, (0.05, 0.3, 0.7)
"""Photograph, segments and losses of the images that are shown."""

Case = Dict[str, Any]
"""The values of `photograph`, `segments`, `burst` and `loss`."""


def interleaved_shown(fill: str, sender: Sender, truths: Sequence[UInt8Array],
                      arrived: Sequence[BoolArray]) -> Iterator[Optional[UInt8Array]]:
    """What can be shown of each interleaved image, its missing pixels filled so; None: nothing."""
    receiver = image_receiver(fill)
    for truth, which in zip(truths, arrived):
        yield shown_of(received(receiver, sender.frames(image_message(truth)), which))


def layered_shown(budget: int, truths: Sequence[UInt8Array], channel: Channel) -> Iterator[Optional[UInt8Array]]:
    """What can be shown of each layered image; None: nothing.

    :param budget: of an image on the wire [byte]
    :param channel: carries the images that were reported before, too
    """
    sender, receiver, beliefs = Sender('image', coding='layered', max_bytes=budget), image_receiver(BEST), LossBeliefs()
    packets = -(-budget // jpeg_packets.MTU)
    for number in range(REPORTS):
        beliefs.add(packets, np.count_nonzero(delivered(channel, packets)), number / RATE)
    for number, truth in enumerate(truths, REPORTS):
        sender.expect(beliefs.air(number / RATE))
        frames = sender.frames(image_message(truth))
        if wire_size(frames) > budget:
            raise RuntimeError('an image takes %d bytes of %d' % (wire_size(frames), budget))
        which = delivered(channel, datagram_count(frames))
        beliefs.add(len(which), np.count_nonzero(which), number / RATE)
        yield shown_of(received(receiver, frames, which))


def shown_of(message: Optional[Any]) -> Optional[UInt8Array]:
    """The image of a message; None: there is none."""
    return None if message is None else image_of(message)


def jpegs_shown(code: ErasureCode, ladders: Sequence[JpegLadder],
                arrived: Sequence[BoolArray]) -> Iterator[Optional[UInt8Array]]:
    """What can be shown of each image with JPEG and this code; None: nothing."""
    for ladder, which in zip(ladders, arrived):
        yield ladder.decoded(code.room) if np.count_nonzero(which) >= code.data else None


def channel_of(case: Case, seed: int) -> Channel:
    """The link of a case."""
    return Channel(conditions_of(case), '%s %s' % (seed, case['photograph']))


def conditions_of(case: Case) -> LinkConditions:
    """What the link of a case does."""
    return LinkConditions(loss=case['loss'], burst=case['burst'])


def arrivals(case: Case, seed: int, count: int, packets: int) -> List[BoolArray]:
    """Which packets of each of some images arrive: (packets,) bool each."""
    channel = channel_of(case, seed)
    return [delivered(channel, packets) for _ in range(count)]


def methods(case: Case, truths: Sequence[UInt8Array], ladders: Sequence[JpegLadder], examples: Sequence[JpegLadder],
            seed: int) -> Dict[str, Iterable[Optional[UInt8Array]]]:
    """{method: what can be shown of each image} of one case; examples: JPEGs by which a code is chosen."""
    sender = Sender('image', coding='interleaved', max_subimages=case['segments'])
    budget = budget_of(sender, truths[0])
    codes = dict(zip(JPEGS, (
        jpeg_packets.codes(budget)[-1], jpeg_packets.with_redundancy(budget, 0.25),
        jpeg_packets.for_loss(budget, conditions_of(case), examples))))
    arrived = arrivals(case, seed, len(truths), case['segments'])
    shown: Dict[str, Iterable[Optional[UInt8Array]]] = {
        LAYERED: layered_shown(budget, truths, channel_of(case, seed)),
        **{words: interleaved_shown(fill, sender, truths, arrived) for fill, words in INTERLEAVED.items()}}
    arrived = arrivals(case, seed, len(truths), codes[JPEGS[0]].packets)
    return {**shown, **{method: jpegs_shown(code, ladders, arrived) for method, code in codes.items()}}


def budget_of(sender: Sender, truth: UInt8Array) -> int:
    """The budget: size of an image on the wire [byte]."""
    return wire_size(sender.frames(image_message(truth)))


def run(run: Run) -> None:
    """Send each clip by each method: quality.csv and budgets.csv; images to look at: shown.npz and shown.csv."""
    count = QUICK_IMAGES if run.quick else IMAGES
    names = PHOTOGRAPHS[3:5] if run.quick else PHOTOGRAPHS
    panoramas = photographs(WIDTH + PAN * (count - 1), HEIGHT)
    clips = {name: clip(panoramas[name], count) for name in names}
    ladders = {name: [JpegLadder(truth) for truth in clips[name]] for name in run.steps(names, 'JPEGs: {}'.format)}
    examples = [of_clip[0] for of_clip in ladders.values()]
    rows: List[table.Row] = []
    shown: Dict[str, UInt8Array] = {}
    shown_rows: List[table.Row] = []
    for case in run.steps(cases(names), lambda case: '{photograph}, {segments} segments'.format(**case)):
        truths = clips[case['photograph']]
        for method, images in methods(case, truths, ladders[case['photograph']], examples, run.seed).items():
            display = Display()
            for truth, image in zip(truths, images):
                display.show(image, truth)
            rows.append({**case, 'way': method, **display.row()})
            if case['loss'] in SHOWN[2] and (case['photograph'], case['segments'], case['burst']) == (*SHOWN[:2], 0):
                typical, quality, new = display.typical()
                shown[str(len(shown_rows))] = typical
                shown_rows.append({'way': method, 'lost [%]': 100 * case['loss'], 'PSNR [dB]': quality, 'new': new})
    table.write(run.folder / 'quality.csv', rows)
    table.write(run.folder / 'budgets.csv', [
        {'segments': segments,
         'kB': budget_of(Sender('image', coding='interleaved', max_subimages=segments), truths[0]) / 1e3}
        for segments in SEGMENTS])
    table.write(run.folder / 'shown.csv', shown_rows)
    np.savez_compressed(str(run.folder / 'shown.npz'), **shown)


def cases(names: Sequence[str]) -> List[Case]:
    """All that is measured."""
    return [{'photograph': name, 'segments': segments, 'burst': burst, 'loss': loss}
            for name in names for segments in SEGMENTS for burst in (0, BURST) for loss in LOSSES
            if not burst or (segments == BURSTY and 0 < loss <= 1 - 1 / burst)]


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """Figures over loss, images to look at, and tables of PSNR."""
    rows, budgets = table.read(folder / 'quality.csv'), table.read(folder / 'budgets.csv')
    with np.load(str(folder / 'shown.npz')) as shown:
        draw_shown(shown, table.read(folder / 'shown.csv'), folder / 'shown.png')
    panels = [('%g kB per image (%d segments)' % (round(row['kB'], 1), row['segments']), row['segments'], 0)
              for row in budgets]
    draw(rows, panels, 'PSNR [dB]', folder / 'psnr.png')
    draw(rows, panels, 'SSIM', folder / 'ssim.png')
    draw(rows, panels, 'new pictures [%]', folder / 'new.png', 'new images [%]')
    title = panels[SEGMENTS.index(BURSTY)][0]
    draw(rows, [(title + ', single losses', BURSTY, 0), (title + ', bursts of %d' % BURST, BURSTY, BURST)],
         'PSNR [dB]', folder / 'bursts.png')
    return [
        Figure('psnr.png', 'How close what the operator sees is to what the camera sees: higher is better.'),
        Figure('ssim.png', 'The same by SSIM, the similarity of structures; 1: the same image.'),
        Figure('new.png', 'The share of images that could be shown, at least in part.'),
        Figure('bursts.png', 'The same bytes and the same share of packets lost: single ones, and %d in a row on '
               'average, which hit fewer images, but those hard.' % BURST),
        Figure('shown.png', 'What is on the display at %s, in a moment of median quality.'
               % panels[SEGMENTS.index(SHOWN[1])][0]),
        *(psnr_table(rows, words, segments, 0) for words, segments, _ in panels), lead_table(folder)]


def psnr_table(rows: Sequence[table.Row], words: str, segments: int, burst: int) -> Table:
    """The quality of all methods over loss at a budget; words: name the budget."""
    values = {method: mean(rows, method, segments, burst, 'PSNR [dB]') for method in COLOURS}
    return Table('PSNR [dB] at %s, by the packet loss:' % words, ['method', *map(_percent, values[LAYERED])],
                 [[method, *('%.1f' % value for value in found.values())] for method, found in values.items()])


def _percent(loss: float) -> str:
    return '%g %%' % (100 * loss)


def lead_table(folder: pathlib.Path) -> Table:
    """The lead of our methods over the JPEG whose code knows the loss, at each budget."""
    rows, known = table.read(folder / 'quality.csv'), JPEGS[-1]
    lines = []
    for budget in table.read(folder / 'budgets.csv'):
        rival = mean(rows, known, budget['segments'], 0, 'PSNR [dB]')
        for method in (LAYERED, INTERLEAVED[BEST]):
            ours = mean(rows, method, budget['segments'], 0, 'PSNR [dB]')
            lines.append(['%.1f kB' % budget['kB'], method, *('%+.1f' % (ours[loss] - rival[loss]) for loss in rival)])
    behind = [gap for gap in _gaps(rows) if gap < 0]
    return Table('Lead over the JPEG with a code that knows the loss [dB]. Of all %d combinations of photograph, '
                 'budget, loss and bursts, layered images are behind it in %d, by at most %.1f dB:' % (
                     len(_gaps(rows)), len(behind), -min(behind, default=0.0)),
                 ['per image', 'method', *map(_percent, LOSSES)], lines)


def _gaps(rows: Sequence[table.Row]) -> List[float]:
    """The lead of layered images in each case."""
    by_case = {(row['photograph'], row['segments'], row['burst'], row['loss'], row['way']): row['PSNR [dB]']
               for row in rows}
    return [value - by_case[(*case, JPEGS[-1])] for (*case, way), value in by_case.items() if way == LAYERED]


def single_losses_table(folder: pathlib.Path) -> Table:
    """psnr_table at the middle budget."""
    return _doc_table(folder, 'single losses', 0)


def bursts_table(folder: pathlib.Path) -> Table:
    """The same with bursts."""
    return _doc_table(folder, 'losses in bursts of %d' % BURST, BURST)


def _doc_table(folder: pathlib.Path, losses: str, burst: int) -> Table:
    size, = (row['kB'] for row in table.read(folder / 'budgets.csv') if row['segments'] == BURSTY)
    return psnr_table(table.read(folder / 'quality.csv'), '%.1f kB per image (%d of 64 segments), %s' % (
        size, BURSTY, losses), BURSTY, burst)


DOC_TABLES = {'psnr': single_losses_table, 'lead': lead_table, 'bursts': bursts_table}


def mean(rows: Sequence[table.Row], method: str, segments: int, burst: int, column: str) -> Dict[float, float]:
    """{loss: mean of a column over photographs}"""
    found: Dict[float, List[float]] = {}
    for row in rows:
        if (row['way'], row['segments'], row['burst']) == (method, segments, burst):
            found.setdefault(row['loss'], []).append(row[column])
    return {loss: float(np.mean(values)) for loss, values in found.items()}


def draw(rows: Sequence[table.Row], panels: Sequence[Tuple[str, int, int]], column: str, path: pathlib.Path,
         label: str = '') -> None:
    """A column over loss, with all methods; panels: (title, segments, burst); label: of the column, if it differs."""
    figure, grid = drawing.canvas(5 * len(panels), 4.6, 1, len(panels), sharey=True)
    for axes, (title, segments, burst) in zip(grid, panels):
        # ours is in front where lines meet
        for order, (method, colour) in zip(range(len(COLOURS) + 2, 2, -1), COLOURS.items()):
            values = mean(rows, method, segments, burst, column)
            axes.plot([100 * loss for loss in values], list(values.values()), '.-', color=colour, label=method,
                      zorder=order)
        axes.set(title=title, xlabel='packets lost [%]', xlim=(0, 100))
    grid[0].set_ylabel(label or column)
    figure.legend(*grid[0].get_legend_handles_labels(), loc='outside lower center', ncols=3)
    drawing.save(figure, path)


def draw_shown(shown: Mapping[str, Array], rows: Sequence[table.Row], path: pathlib.Path) -> None:
    """Images to look at: a row for each loss, a column for each method."""
    figure, grid = drawing.canvas(3 * len(COLOURS), 2.5 * len(SHOWN[2]), len(SHOWN[2]), len(COLOURS))
    for i, (axes, row) in enumerate(zip(grid.flat, rows)):
        drawing.show_image(axes, shown[str(i)], '%s\n%g %% lost: %.1f dB%s' % (
            row['way'], row['lost [%]'], row['PSNR [dB]'], '' if row['new'] else ', nothing new'), vmin=0, vmax=255)
    drawing.save(figure, path)
