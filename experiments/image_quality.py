# SPDX-License-Identifier: BSD-3-Clause
"""How good pictures are over the loss, at equal bytes on the wire: segments beside JPEG with and without a code."""
import numpy as np

from benchmarks import pictures
from smokebot_udp.codecs.concealment.fill import BEST
from smokebot_udp.link_lab.channel import Channel, Quality
from smokebot_udp.streams.outbox import size_of

from . import drawing, jpeg, lossy, table
from .runner import Figure, Table, again
from .screen import HEIGHT, PAN, WIDTH, Screen, clip

TITLE = 'Pictures over the loss, at equal bytes on the wire'

EXPLANATION = """
A camera of 320 × 240 pixels pans over a photograph, 8 pixels a picture, as on a robot that turns. Each way of sending
has the same bytes a picture, headers included: as many as all 64 segments need, as 16 and as 4 of them.

* **Segments** (this package, coarse ones first): whatever comes makes a picture. What is missing is filled by kriging,
  or from the nearest pixel, as the deliverable does. Nothing is compressed.
* **Whole JPEG**: the best one that fits, scaled down where that is better. One lost packet costs the picture.
* **JPEG with 25 % redundancy**: as long as a fifth of the packets at most is lost, an ideal code restores them.
* **JPEG with a code that knows the loss**: the redundancy that promises the highest PSNR at this loss, known
  beforehand, and an ideal code. Nothing real does better.

Where nothing of a picture can be shown, the last one that could stays on the screen, and is compared with what the
camera sees by then; before the first one, the screen is grey. A difference of 60 dB or more counts as 60.
"""

PHOTOGRAPHS = 'astronaut', 'camera', 'coffee', 'gravel', 'motorcycle_left', 'rocket'
SEGMENTS = 64, 16, 4
"""Of a picture; their bytes are the budgets."""

LOSSES = 0.0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95
BURST = 8
"""Mean run of lost packets, where losses come in bursts."""

BURSTY = 16
"""The budget at which they do, too."""

WAYS = {
    lossy.FILLS[BEST]: drawing.OURS, lossy.FILLS['nearest']: drawing.PAPER, 'whole JPEG': '#1f77b4',
    'JPEG, 25 % redundancy': '#2ca02c', 'JPEG, a code that knows the loss': '#9467bd'}
"""{way: colour}"""

SHOWN = 'motorcycle_left', 16, (0.05, 0.3, 0.7)
"""Photograph, segments and losses of the pictures that are shown."""


def segments_shown(fill, sender, truths, came):
    """What can be shown of each picture, None where nothing can: of segments, filled in this way."""
    receiver = lossy.images(fill)
    for truth, which in zip(truths, came):
        message = lossy.came_of(receiver, sender.frames(lossy.message_of(truth)), which)
        yield None if message is None else lossy.picture_of(message)


def jpegs_shown(code, ladders, came):
    """The same, of JPEGs in packets with a code."""
    for ladder, which in zip(ladders, came):
        yield ladder.decoded(code.room) if np.count_nonzero(which) >= code.data else None


def losing(case, seed, count, packets):
    """What comes of so many pictures: [(packets,) bool, ...]"""
    channel = Channel(Quality(loss=case['loss'], burst=case['burst']), '%s %s' % (seed, case['photograph']))
    return [lossy.passed(channel, packets) for _ in range(count)]


def ways(case, truths, ladders, examples, seed):
    """{way: what can be shown of each picture} of one case."""
    sender = lossy.robot('image', max_subimages=case['segments'])
    budget = budget_of(sender, truths[0])
    codes = dict(zip(list(WAYS)[2:], (jpeg.codes(budget)[-1], jpeg.with_overhead(budget, 0.25),
                                      jpeg.for_loss(budget, case['loss'], examples))))
    came = losing(case, seed, len(truths), case['segments'])
    shown = {words: segments_shown(fill, sender, truths, came) for fill, words in lossy.FILLS.items()}
    came = losing(case, seed, len(truths), codes['whole JPEG'].packets)
    return {**shown, **{way: jpegs_shown(code, ladders, came) for way, code in codes.items()}}


def budget_of(sender, truth):
    return size_of(sender.frames(lossy.message_of(truth)))


def run(run):
    """Each clip in each way: quality.csv; pictures to look at: shown.npz."""
    count = 4 if run.quick else 12
    names = PHOTOGRAPHS[3:5] if run.quick else PHOTOGRAPHS
    photographs = pictures.grey(WIDTH + PAN * (count - 1), HEIGHT)
    clips = {name: clip(photographs[name], count) for name in names}
    ladders = {name: [jpeg.Ladder(truth) for truth in clips[name]] for name in run.steps(names, say='JPEGs: {}'.format)}
    examples = [of_clip[0] for of_clip in ladders.values()]
    rows, shown, told = [], {}, []
    for case in run.steps(cases(names), say=lambda case: '{photograph}, {segments} segments'.format(**case)):
        truths = clips[case['photograph']]
        for way, pictures_shown in ways(case, truths, ladders[case['photograph']], examples, run.seed).items():
            screen = Screen()
            for truth, picture in zip(truths, pictures_shown):
                screen.show(picture, truth)
            rows.append({**case, 'way': way, **screen.row()})
            if case['loss'] in SHOWN[2] and (case['photograph'], case['segments'], case['burst']) == (*SHOWN[:2], 0):
                picture, psnr, new = screen.typical()
                shown[str(len(told))] = picture
                told.append({'way': way, 'lost [%]': 100 * case['loss'], 'PSNR [dB]': psnr, 'new': new})
    table.write(run.folder / 'quality.csv', rows)
    table.write(run.folder / 'budgets.csv', [
        {'segments': segments, 'kB': budget_of(lossy.robot('image', max_subimages=segments), truths[0]) / 1e3}
        for segments in SEGMENTS])
    table.write(run.folder / 'shown.csv', told)
    np.savez_compressed(str(run.folder / 'shown.npz'), **shown)


def cases(names):
    return [{'photograph': name, 'segments': segments, 'burst': burst, 'loss': loss}
            for name in names for segments in SEGMENTS for burst in (0, BURST) for loss in LOSSES
            if not burst or (segments == BURSTY and 0 < loss <= 1 - 1 / burst)]


def plot(folder):
    rows, budgets = table.read(folder / 'quality.csv'), table.read(folder / 'budgets.csv')
    with np.load(str(folder / 'shown.npz')) as shown:
        draw_shown(shown, table.read(folder / 'shown.csv'), folder / 'shown.png')
    panels = [('%g kB a picture (%d segments)' % (round(row['kB'], 1), row['segments']), row['segments'], 0)
              for row in budgets]
    draw(rows, panels, 'PSNR [dB]', folder / 'psnr.png')
    draw(rows, panels, 'SSIM', folder / 'ssim.png')
    draw(rows, panels, 'new pictures [%]', folder / 'new.png')
    title = panels[SEGMENTS.index(BURSTY)][0]
    draw(rows, [(title + ', single losses', BURSTY, 0), (title + ', bursts of %d' % BURST, BURSTY, BURST)],
         'PSNR [dB]', folder / 'bursts.png')
    return [
        Figure('psnr.png', 'How near what the operator sees is to what the camera sees: higher is better.'),
        Figure('ssim.png', 'The same by SSIM: how alike the pictures\' structures are; 1 is the same picture.'),
        Figure('new.png', 'Of how many pictures anything could be shown.'),
        Figure('bursts.png', 'The same bytes and the same share of packets lost: each by itself, and %d in a row on '
               'average, which hit fewer pictures, but those hard.' % BURST),
        Figure('shown.png', 'What is on the screen at %s, when it is as good as half of the time.'
               % panels[SEGMENTS.index(SHOWN[1])][0]),
        *(Table('PSNR [dB] at %s, by loss:' % words, ['way'] + ['%g %%' % (100 * loss) for loss in LOSSES],
                [[way] + [round(value, 1) for value in mean(rows, way, segments, 0, 'PSNR [dB]').values()]
                 for way in WAYS]) for words, segments, _ in panels)]


def mean(rows, way, segments, burst, what):
    """{loss: mean over photographs}"""
    found = {}
    for row in rows:
        if (row['way'], row['segments'], row['burst']) == (way, segments, burst):
            found.setdefault(row['loss'], []).append(row[what])
    return {loss: float(np.mean(values)) for loss, values in found.items()}


def draw(rows, panels, what, path):
    figure, grid = drawing.canvas(5 * len(panels), 4.6, 1, len(panels), sharey=True)
    for axes, (title, segments, burst) in zip(grid, panels):
        for above, (way, colour) in zip(range(len(WAYS) + 2, 2, -1), WAYS.items()):     # ours is seen where lines meet
            values = mean(rows, way, segments, burst, what)
            axes.plot([100 * loss for loss in values], list(values.values()), '.-', color=colour, label=way,
                      zorder=above)
        axes.set(title=title, xlabel='packets lost [%]', xlim=(0, 100))
    grid[0].set_ylabel(what)
    figure.legend(*grid[0].get_legend_handles_labels(), loc='outside lower center', ncols=3)
    drawing.save(figure, path)


def draw_shown(shown, told, path):
    figure, grid = drawing.canvas(15, 2.5 * len(SHOWN[2]), len(SHOWN[2]), len(WAYS))
    for i, (axes, row) in enumerate(zip(grid.flat, told)):
        drawing.picture(axes, shown[str(i)], '%s\n%g %% lost: %.1f dB%s' % (
            row['way'], row['lost [%]'], row['PSNR [dB]'], '' if row['new'] else ', nothing new'), vmin=0, vmax=255)
    drawing.save(figure, path)


again(__name__, plot)
