# SPDX-License-Identifier: BSD-3-Clause
"""Layered images: their expected quality over loss at equal bytes on the wire, and the time of each stage.

Beside them: raw pixels with kriging (coding: interleaved), and JPEG and JPEG 2000 under an ideal erasure code that
knows the loss. Expectations are exact (evaluation/layered_quality.py), but for raw pixels, where some losses are drawn.
"""
import functools
import math
import statistics
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Sequence

import cv2
import numpy as np
from sensor_msgs.msg import Image

from evaluation.jpeg_packets import STALE_PSNR, JpegLadder, codes
from evaluation.layered_quality import HEAD, ROOM, Air, Coded, psnr
from evaluation.offline_link import Sender, image_receiver, received, wire_size
from evaluation.recordings import RECORDINGS, photographs
from smokebot_udp.arrays import Array, IntArray, UInt8Array
from smokebot_udp.codecs.concealment.fill import BEST
from smokebot_udp.codecs.layered.image import decode, encode
from smokebot_udp.codecs.layered.pieces import Plan, Restorer, protect
from smokebot_udp.codecs.layered.plan import best_plan, worth
from smokebot_udp.link_lab.channel import LinkConditions
from smokebot_udp.streams.air import LossBeliefs

PHOTOGRAPHS = ('astronaut', 'camera', 'coffee', 'coins', 'gravel', 'motorcycle_left', 'brick', 'grass', 'euroc_142976',
               'rtabmap_020', 'tum_4', 'acfr_pose1')
THERMAL = ('single/flirpy_radiometric', 'single/ir_IRWaterCooler', 'single/t640_electrical_cabinet',
           'single/tp_M30T_DJI_0003_R', 'seq_sc660_640x480/frame00_1339617128.699',
           'seq_t1030sc_1024x768_30hz/frame03_1495223133.683')
QUICK = 2
"""Number of images of each kind in a quick run."""

LOSSES = 0.0, 0.05, 0.1, 0.2, 0.5, 0.8, 0.9, 0.95
BUDGETS, THERMAL_BUDGETS = (5, 10, 18, 20, 40, 83), (20, 80, 160, 300, 650)
"""Budgets of an image on the wire: of 8-bit images, and of thermal ones [kB]."""

GOALS = {18: {0.0: 42.4, 0.2: 37.0, 0.5: 31.9}, 40: {0.2: 46.1, 0.5: 39.4, 0.8: 30.7},
         83: {0.5: 48.4, 0.8: 36.8, 0.9: 30.5}}
"""{budget: {loss: PSNR with a known loss [dB]}}"""

THERMAL_GOALS = {80: {0.0: 4.5, 0.2: 6.9, 0.5: 9.6}, 300: {0.0: 0.0}, 650: {0.0: 0.0, 0.05: 0.0, 0.1: 0.0, 0.2: 0.0}}
"""{budget: {loss: rms error with a known loss [count]}}"""

KNOWN, REPORTED, RAW = 'layered, loss known', 'layered, loss reported', 'raw pixels, kriging'
JPEG, JPEG_2000 = 'JPEG, ideal code, loss known', 'JPEG 2000, ideal code, loss known'
PATTERNS = 2
"""Drawn losses of raw pixels."""

REPORTS, REPORT_SEEDS, IMAGE_RATE = 60, 3, 10.0
"""Reports of 0.1 s before an image is planned, how often they are drawn, and images a second."""

BURST = 8.0
WRONG_BUDGET, WRONG_LOSSES = 20, (0.01, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
DATAGRAM = 1500
JPEG_2000_RATES = sorted({max(1, round(1000 / factor)) for factor in np.geomspace(1, 1000, 60).tolist()})
ROUNDS, QUICK_ROUNDS = 25, 5
Cells = Dict[str, Dict[int, Dict[float, float]]]
"""{method: {budget [kB]: {loss: quality}}}"""


def thermal_images() -> Dict[str, Array]:
    """The middle 640 x 480 of radiometric recordings: {name: (480, 640) uint16}."""
    images = {}
    for name in THERMAL:
        image = cv2.imread(str(RECORDINGS / 'thermal' / (name + '.png')), cv2.IMREAD_UNCHANGED)
        if image is not None:
            top, left = (image.shape[0] - 480) // 2, (image.shape[1] - 640) // 2
            images[name] = np.ascontiguousarray(image[top:top + 480, left:left + 640])
    return images


@functools.lru_cache(maxsize=None)
def reported(loss: float, budget: int, seed: int) -> Air:
    """The expected losses after 6 s of reports on images of a size [kB]."""
    random, beliefs, count = np.random.RandomState(seed), LossBeliefs(), max(1, 1000 * budget // DATAGRAM)
    for number in range(REPORTS):
        beliefs.add(count, count - random.binomial(count, loss), number / IMAGE_RATE)
    believed = beliefs.air((REPORTS - 0.5) / IMAGE_RATE)
    return Air(believed.losses, believed.burst)


class Ladder(NamedTuple):
    """Codings of an image by size: what a code that is not progressive can send."""
    sizes: List[int]
    """Ascending [byte]."""
    values: List[float]
    """The best quality within each."""
    nothing: float
    """The quality where nothing is shown."""

    def best(self, room: int) -> float:
        """The best quality within a size [byte]."""
        place = int(np.searchsorted(self.sizes, room, 'right'))
        return self.values[place - 1] if place else self.nothing

    def expected(self, budget: int, loss: float) -> float:
        """With the ideal code that is best on average at this loss, for this very image."""
        conditions = LinkConditions(loss=loss)
        return max(self.nothing + code.success(conditions) * (self.best(code.room) - self.nothing)
                   for code in codes(budget))


def jpeg_ladder(image: UInt8Array) -> Ladder:
    """PSNR of JPEGs [dB]."""
    ladder = JpegLadder(image)
    sizes = sorted({step.size for step in (ladder.best(size) for size in range(400, 2 * image.size, 100)) if step})
    return Ladder(sizes, [step.psnr for step in map(ladder.best, sizes) if step], STALE_PSNR)


def jpeg_2000_ladder(image: Array) -> Ladder:
    """Minus rms error of JPEG 2000 [count]."""
    found = []
    for rate in JPEG_2000_RATES:
        data = cv2.imencode('.jp2', image, [cv2.IMWRITE_JPEG2000_COMPRESSION_X1000, rate])[1]
        shown = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        found.append((len(data), -float(np.sqrt(((shown.astype(float) - image) ** 2).mean()))))
    found.sort()
    best = np.maximum.accumulate([value for _, value in found])
    return Ladder([size for size, _ in found], best.tolist(), -float(image.std()))


def image_message(image: Array) -> Any:
    """A sensor_msgs/Image of a (height, width) uint8 or uint16 image."""
    message = Image(height=image.shape[0], width=image.shape[1], encoding='mono%d' % (8 * image.itemsize),
                    step=image.shape[1] * image.itemsize, data=image.tobytes())
    message.header.frame_id = 'camera'
    return message


def raw_error(image: Array, budget: int, loss: float) -> float:
    """The mean squared error of as many raw subimages as the budget carries, the rest concealed."""
    message, receiver = image_message(image), image_receiver(BEST)
    size = wire_size(Sender('image', coding='interleaved', max_subimages=1).frames(message))
    frames = Sender('image', coding='interleaved', max_subimages=max(1, int(1000 * budget / size))).frames(message)
    while wire_size(frames) > 1000 * budget and sum(map(len, frames)) > 1:
        frames = Sender('image', coding='interleaved', max_subimages=max(1, sum(map(len, frames)) - 1)).frames(message)
    random, errors = np.random.RandomState(1), []
    for _ in range(PATTERNS):
        shown = received(receiver, frames, random.random_sample(sum(map(len, frames))) >= loss)
        pixels = np.full(image.shape, image.mean()) if shown is None else np.frombuffer(
            shown.data, image.dtype).reshape(image.shape)
        errors.append(float(((pixels.astype(float) - image) ** 2).mean()))
    return statistics.mean(errors)


def layered_cell(coded: Sequence[Coded], budget: int, believed: Iterable[Air], air: Air,
                 quality: Callable[[float], float]) -> float:
    """The mean quality of images that are planned for what is believed, over a link as it is."""
    values = []
    for expected in believed:
        for one in coded:
            lossless, plan = one.plan(1000 * budget, expected)
            values.append(one.expected(lossless, plan, air, quality))
    return statistics.mean(values)


def layered_cells(coded: Sequence[Coded], budgets: Sequence[int], quality: Callable[[float], float],
                  log: Callable[[str], None]) -> Cells:
    """KNOWN and REPORTED."""
    cells: Cells = {KNOWN: {}, REPORTED: {}}
    for budget in budgets:
        log('layered, %d kB' % budget)
        for method in cells:
            cells[method][budget] = {}
        for loss in LOSSES:
            air = Air({loss: 1.0})
            beliefs = [reported(loss, budget, seed) for seed in range(REPORT_SEEDS)]
            cells[KNOWN][budget][loss] = layered_cell(coded, budget, [air], air, quality)
            cells[REPORTED][budget][loss] = layered_cell(coded, budget, beliefs, air, quality)
    return cells


def other_cells(images: Sequence[Array], budgets: Sequence[int], method: str, ladders: Sequence[Ladder], sign: float,
                quality: Callable[[float], float], log: Callable[[str], None]) -> Cells:
    """RAW, and an ideal code.

    :param sign: of the ladders' values
    """
    cells: Cells = {RAW: {}, method: {}}
    for budget in budgets:
        log('others, %d kB' % budget)
        cells[RAW][budget] = {loss: statistics.mean(quality(raw_error(image, budget, loss)) for image in images)
                              for loss in LOSSES}
        cells[method][budget] = {
            loss: sign * statistics.mean(ladder.expected(1000 * budget, loss) for ladder in ladders) for loss in LOSSES}
    return cells


def wrong_cells(coded: Sequence[Coded]) -> Dict[str, Dict[float, float]]:
    """{plan: {true loss: PSNR}}: what is believed is wrong, by WRONG_BUDGET."""
    step = LossBeliefs()
    random, count = np.random.RandomState(3), 1000 * WRONG_BUDGET // DATAGRAM
    for number in range(REPORTS):
        step.add(count, count - random.binomial(count, 0.05 if number < REPORTS - 5 else 0.3), number / IMAGE_RATE)
    after = step.air((REPORTS - 0.5) / IMAGE_RATE)
    plans: Mapping[str, List[Air]] = {
        'for 5 %, known': [Air({0.05: 1.0})],
        '5 % reported': [reported(0.05, WRONG_BUDGET, seed) for seed in range(REPORT_SEEDS)],
        '5 % reported, then 0.5 s of 30 %': [Air(after.losses, after.burst)],
        'no reports': [Air(LossBeliefs().air(0.0).losses)]}
    cells = {name: {loss: layered_cell(coded, WRONG_BUDGET, believed, Air({loss: 1.0}), psnr) for loss in WRONG_LOSSES}
             for name, believed in plans.items()}
    cells['known'] = {loss: layered_cell(coded, WRONG_BUDGET, [Air({loss: 1.0})], Air({loss: 1.0}), psnr)
                      for loss in WRONG_LOSSES}
    return cells


def burst_cells(coded: Sequence[Coded]) -> Dict[str, Dict[float, float]]:
    """{plan: {loss: PSNR}} with bursts of BURST, by WRONG_BUDGET."""
    losses = [loss for loss in WRONG_LOSSES if 0.01 < loss <= 1 - 1 / BURST]
    return {name: {loss: layered_cell(coded, WRONG_BUDGET, [Air({loss: 1.0}, burst)], Air({loss: 1.0}, BURST), psnr)
                   for loss in losses}
            for name, burst in (('loss and bursts known', BURST), ('loss known, thought to be single', None))}


class Stages:
    """Sends an image at 80 kB through all stages, a fifth of its datagrams lost.

    :param image: (height, width) or (height, width, 3)
    """

    def __init__(self, image: Array) -> None:
        self._image, self.datagrams = image, 0
        self._shape = image.shape[0], image.shape[1], 1 if image.ndim == 2 else 3, image.itemsize
        self._times: Dict[str, List[float]] = {}

    def run(self) -> None:
        """Once."""
        stream = self._timed('encode', encode, self._image, False, 80000)
        values = worth(stream.errors, stream.cells, 0.065 if self._image.itemsize == 1 else None)
        plan = self._timed('plan', best_plan, stream.ends, values, 106000, {0.2: 0.9, 0.5: 0.1}, None, HEAD, ROOM)
        self.datagrams = plan.count
        pieces = self._timed('protect', protect, stream.data, plan)
        received = np.flatnonzero(np.random.RandomState(1).random_sample(plan.count) >= 0.2)
        restored = self._timed('restore', self._restored, plan, received, pieces[received])
        self._timed('decode', decode, restored, *self._shape)

    def least(self) -> Dict[str, float]:
        """{stage: [ms]}, the first, which compiles, not counted."""
        return {stage: min(times[1:]) for stage, times in self._times.items()}

    def _timed(self, stage: str, function: Callable[..., Any], *arguments: Any) -> Any:
        begun = time.perf_counter()
        value = function(*arguments)
        self._times.setdefault(stage, []).append(1e3 * (time.perf_counter() - begun))
        return value

    @staticmethod
    def _restored(plan: Plan, received: IntArray, pieces: UInt8Array) -> bytes:
        """In batches of ten."""
        restorer = Restorer(plan.count, plan.layers)
        for at in range(0, len(received), 10):
            restorer.add(received[at:at + 10], pieces[at:at + 10])
        return restorer.restored()


def stage_times(kinds: Mapping[str, Array], rounds: int) -> Dict[str, Dict[str, float]]:
    """{kind: {stage: least time [ms]}}, and the number of datagrams."""
    result = {}
    for kind, image in kinds.items():
        stages = Stages(image)
        for _ in range(rounds + 1):
            stages.run()
        result[kind] = {**stages.least(), 'datagrams': stages.datagrams}
    return result


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """All tables."""
    found = photographs(320, 240)
    images: List[Array] = [found[name] for name in PHOTOGRAPHS if name in found][:QUICK if quick else None]
    coded = [Coded(image) for image in images]
    log('JPEGs')
    cells = {**layered_cells(coded, BUDGETS, psnr, log),
             **other_cells(images, BUDGETS, JPEG, [jpeg_ladder(image) for image in images], 1.0, psnr, log)}
    results: Dict[str, Any] = {'images': len(images), 'quality': cells, 'wrong': wrong_cells(coded),
                               'bursts': burst_cells(coded)}
    kinds: Dict[str, Array] = {'grey 640 x 480': photographs(640, 480)['camera']}
    thermal = list(thermal_images().values())[:QUICK if quick else None]
    if thermal:
        log('JPEG 2000')
        kinds['16 bits 640 x 480'] = thermal[0]
        results['thermal images'] = len(thermal)
        coded = [Coded(image) for image in thermal]
        results['thermal'] = {
            **layered_cells(coded, THERMAL_BUDGETS, math.sqrt, log),
            **other_cells(thermal, THERMAL_BUDGETS, JPEG_2000, [jpeg_2000_ladder(image) for image in thermal], -1.0,
                          math.sqrt, log)}
    kinds['colour 640 x 480'] = np.dstack([photographs(640, 480)[name] for name in ('coffee', 'camera', 'coffee')])
    results['times'] = stage_times(kinds, QUICK_ROUNDS if quick else ROUNDS)
    return results


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> List[str]:
    """A table."""
    return ['| ' + ' | '.join(cells) + ' |' for cells in [head, ['---'] * len(head), *rows]]


def quality_table(cells: Cells, goals: Mapping[int, Mapping[float, float]], digits: int) -> List[str]:
    """Methods over loss at each budget, and the goals."""
    rows: List[List[str]] = []
    for budget in cells[KNOWN]:
        for method, by_budget in cells.items():
            rows.append(['%d' % budget, method] + ['%.*f' % (digits, by_budget[budget][loss]) for loss in LOSSES])
        if budget in goals:
            rows.append(['%d' % budget, 'goal, loss known'] + [
                '%.*f' % (digits, goals[budget][loss]) if loss in goals[budget] else '' for loss in LOSSES])
    return markdown(['kB', 'method', *map(percent, LOSSES)], rows)


def percent(loss: float) -> str:
    """A loss as text."""
    return '%g %%' % (100 * loss)


def over_loss(cells: Mapping[str, Mapping[float, float]]) -> List[str]:
    """Plans over the true loss."""
    losses = list(next(iter(cells.values())))
    return markdown(['plan', *map(percent, losses)],
                    [[name, *('%.1f' % values[loss] for loss in losses)] for name, values in cells.items()])


def table(results: Mapping[str, Any]) -> str:
    """The results as text."""
    lines = ['PSNR [dB], 320 x 240, mean of %d images' % results['images'], '']
    lines += quality_table(results['quality'], GOALS, 1)
    if 'thermal' in results:
        lines += ['', 'rms error [count], 640 x 480, 16 bits, mean of %d images' % results['thermal images'], '']
        lines += quality_table(results['thermal'], THERMAL_GOALS, 2)
    lines += ['', 'The loss is another than believed: PSNR [dB] at %d kB' % WRONG_BUDGET, '']
    lines += over_loss(results['wrong'])
    lines += ['', 'Bursts of %d: PSNR [dB] at %d kB' % (BURST, WRONG_BUDGET), '', *over_loss(results['bursts'])]
    stages = list(next(iter(results['times'].values())))
    lines += ['', 'Least times at 80 kB, a fifth of the datagrams lost [ms]', '']
    lines += markdown(['image', *stages], [[kind, *('%.3g' % times[stage] for stage in stages)]
                                           for kind, times in results['times'].items()])
    return '\n'.join(lines)
