# SPDX-License-Identifier: BSD-3-Clause
"""The quality and the speed of the methods of codecs/concealment/fill.py, beside OpenCV's inpainting.

Photographs at 320 x 240 in 64 subimages; random ones are lost, the same for each method; radiometric images
at their own size, split as by a stream. Writes a plot and sheets of images to results/bench.
"""
import statistics
import time
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Tuple

import cv2
import numpy as np

from evaluation import TOP, quality, recordings
from evaluation.losses import patterns
from smokebot_udp.arrays import Array, BoolArray, FloatArray, UInt8Array
from smokebot_udp.codecs.concealment.fill import BEST, METHODS
from smokebot_udp.codecs.wire.interleave import Interleave, fit

from . import fill_plots

LOSSES = 0.05, 0.1, 0.2, 0.5, 0.8, 0.9, 0.95
THERMAL_LOSSES = 0.1, 0.2, 0.5, 0.8, 0.9
PATTERNS = 20
QUICK, QUICK_THERMAL = ('camera', 'motorcycle_left'), ('simulated',)
"""The images of a quick run."""

SLOW_PATTERNS = 4
"""The number of patterns for SSIM and inpainting, which are slow, and for radiometric images."""

GOALS = {0.1: 38.0, 0.2: 35.0, 0.5: 29.5, 0.8: 25.0, 0.9: 23.0}
"""{loss: PSNR of the best method [dB]}"""

SIZES = {(240, 320, 3): 3.0, (480, 640, 3): 6.0, (480, 640, 4): 15.0, (480, 640, 5): 15.0}
"""{(height, width, depth): goal for the time of one fill [ms]}"""

ROUNDS, QUICK_ROUNDS = 40, 8
ROOM = 1400
"""Bytes of pixels in a datagram."""

NEIGHBOURHOOD = np.ones((5, 5), np.uint8)
"""A peak counts as shown where a pixel as hot is shown in the square around it."""

SHEETS = {'fill_sheet.jpg': ('camera', 'motorcycle_left', 'simulated'),
          'fill_recordings.jpg': ('t640_electrical_cabinet', 'ir_Steam_Train_Valves_Thermal_Image', 'tp_FLIR')}
"""{file: its images, where they are at hand}"""

EDGES = 0.05
"""The share of pixels that count as edges: those with the largest differences in their neighbourhood."""

Fill = Callable[[Array, BoolArray, Interleave], Array]
Measures = Dict[str, Dict[float, Dict[str, Dict[str, float]]]]
"""{method: {loss: {image: {measure: value}}}}"""


def inpaint(subimages: UInt8Array, have: BoolArray, cut: Interleave) -> UInt8Array:
    """OpenCV's inpainting after Telea; for bytes only."""
    filled = cv2.inpaint(cut.merge(subimages), (~cut.pixel_mask(have)).astype(np.uint8), 2, cv2.INPAINT_TELEA)
    return cut.split(filled)


ALL: Dict[str, Fill] = {**METHODS, 'inpainting': inpaint}


def measure_quality(photographs: Mapping[str, UInt8Array], log: Callable[[str], None]) -> Measures:
    """Means of 'psnr' [dB] and 'ssim', and the median of 'ms', for each method, loss and photograph."""
    results: Measures = {method: {loss: {} for loss in LOSSES} for method in ALL}
    for name, image in photographs.items():
        log(name)
        height, width = image.shape
        cut = Interleave(height, width, 3)
        subimages = cut.split(image)
        for loss in LOSSES:
            for method, fill in ALL.items():
                count = SLOW_PATTERNS if method == 'inpainting' else PATTERNS
                results[method][loss][name] = _measured(image, subimages, cut, fill, patterns(cut, loss, count))
    return results


def _measured(image: UInt8Array, subimages: UInt8Array, cut: Interleave, fill: Fill,
              haves: Iterable[BoolArray]) -> Dict[str, float]:
    psnr: List[float] = []
    ssim: List[float] = []
    seconds: List[float] = []
    for have in haves:
        filled, took = _timed(fill, subimages, have, cut)
        shown = cut.merge(filled)
        psnr.append(quality.psnr(image, shown))
        if len(ssim) < SLOW_PATTERNS:
            ssim.append(quality.ssim(image, shown))
        seconds.append(took)
    return {'psnr': statistics.mean(psnr), 'ssim': statistics.mean(ssim), 'ms': 1e3 * statistics.median(seconds)}


def _timed(fill: Fill, subimages: Array, have: BoolArray, cut: Interleave) -> Tuple[Array, float]:
    """The filled subimages, and the processor time it took [s]."""
    begun = time.process_time()
    filled = fill(subimages, have, cut)
    return filled, time.process_time() - begun


def measure_times(rounds: int) -> List[Dict[str, Any]]:
    """[{'size', 'subimages', 'bits', 'loss', 'goal' [ms], method: median [ms], ...}]; each round loses others."""
    rows = []
    for (height, width, depth), goal in SIZES.items():
        cut = Interleave(height, width, depth)
        for kind in (np.uint8, np.uint16):
            noise = np.random.RandomState(0).randint(0, np.iinfo(kind).max, (height, width)).astype(kind)
            subimages = cut.split(noise)
            for loss in (0.1, 0.5, 0.9):
                row = {'size': '%d x %d' % (width, height), 'subimages': len(cut), 'bits': 8 * noise.itemsize,
                       'loss': loss, 'goal': goal}
                for method, fill in METHODS.items():
                    row[method] = 1e3 * statistics.median(
                        _timed(fill, subimages, have, cut)[1] for have in patterns(cut, loss, rounds))
                rows.append(row)
    return rows


def measure_thermal(images: Mapping[str, Array],
                    log: Callable[[str], None]) -> Dict[float, Dict[str, Dict[str, Dict[str, float]]]]:
    """Errors of missing pixels [count]: {loss: {method: {image: {measure: value}}}}.

    'rms', of those at edges ('edges'), '99.9 %' and 'most'; 'invented' is by how much a shown pixel exceeds all true
    ones around it, 'hidden' by how much a true one exceeds all shown ones around it.
    """
    results = {}
    for loss in THERMAL_LOSSES:
        log('thermal, %g %% lost' % (100 * loss))
        results[loss] = {method: {name: _errors(image, fill, loss) for name, image in images.items()}
                         for method, fill in METHODS.items()}
    return results


def _errors(image: Array, fill: Fill, loss: float) -> Dict[str, float]:
    height, width = image.shape
    cut, _ = fit(height, width, 2, ROOM)
    subimages, hottest = cut.split(image), cv2.dilate(image, NEIGHBOURHOOD).astype(int)
    contrast = hottest - cv2.erode(image, NEIGHBOURHOOD)
    edge = contrast >= np.quantile(contrast, 1 - EDGES)
    errors, at_edges, invented, hidden = [], [], 0, 0
    for have in patterns(cut, loss, SLOW_PATTERNS):
        shown = cut.merge(fill(subimages, have, cut))
        missing, error = ~cut.pixel_mask(have), np.abs(shown - image.astype(float))
        errors.append(error[missing])
        at_edges.append(error[missing & edge])
        invented = max(invented, int((shown - hottest).max()))
        hidden = max(hidden, int((image.astype(int) - cv2.dilate(shown, NEIGHBOURHOOD)).max()))
    together = np.concatenate(errors)
    return {'rms': _rms(together), 'edges': _rms(np.concatenate(at_edges)),
            '99.9 %': float(np.percentile(together, 99.9)), 'most': int(together.max()), 'invented': invented,
            'hidden': hidden}


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors ** 2)))


def run(log: Callable[[str], None], quick: bool = False) -> Dict[str, Any]:
    """{'quality', 'times', 'thermal'}: what measure_quality, measure_times and measure_thermal return."""
    photographs, thermal = recordings.photographs(320, 240), recordings.thermal()
    if quick:
        photographs = {name: photographs[name] for name in QUICK}
        thermal = {name: thermal[name] for name in QUICK_THERMAL}
    results: Dict[str, Any] = {
        'quality': measure_quality(photographs, log), 'times': measure_times(QUICK_ROUNDS if quick else ROUNDS),
        'thermal': measure_thermal(thermal, log)}
    folder = TOP / 'results' / 'bench'
    folder.mkdir(parents=True, exist_ok=True)
    fill_plots.plot(results['quality'], GOALS, folder / 'fill.png')
    at_hand = {**photographs, **thermal}
    for file, names in SHEETS.items():
        shown = {name: at_hand[name] for name in names if name in at_hand}
        if shown:
            fill_plots.sheet(shown, folder / file)
    log('see %s/fill*' % folder)
    return results


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    return '\n'.join(['filling missing pixels', '', *_quality_lines(results['quality']), '',
                      *_time_lines(results['times']), '', *_thermal_lines(results['thermal'])])


def mean(of_images: Mapping[str, Mapping[str, float]], measure: str) -> float:
    """Over images."""
    return statistics.mean(measured[measure] for measured in of_images.values())


def _quality_lines(results: Measures) -> Iterator[str]:
    count = len(results[BEST][LOSSES[0]])
    yield '%d photographs, 320 x 240, 64 subimages, %d losses each: PSNR [dB], in brackets SSIM' % (count, PATTERNS)
    yield '%-18s' % 'lost' + ''.join('%13s' % ('%g %%' % (100 * loss)) for loss in LOSSES)
    for method, of_losses in results.items():
        yield '%-18s' % method + ''.join(
            '%13s' % ('%.2f (%.2f)' % (mean(p, 'psnr'), mean(p, 'ssim'))) for p in of_losses.values())
    yield '%-18s' % 'goal' + ''.join('%13s' % ('%.1f       ' % GOALS[loss] if loss in GOALS else '') for loss in LOSSES)
    yield '%-18s' % 'least gain' + ''.join(
        '%13s' % ('%.2f       ' % min(results[BEST][loss][name]['psnr'] - results['nearest'][loss][name]['psnr']
                                     for name in results[BEST][loss])) for loss in LOSSES)
    yield 'median of a fill [ms of CPU]: ' + ', '.join('%s %.1f' % (
        method, statistics.median(m['ms'] for p in of_losses.values() for m in p.values()))
        for method, of_losses in results.items())


def _time_lines(rows: List[Dict[str, Any]]) -> Iterator[str]:
    yield 'one image, each time with other losses, median of %d [ms of CPU]' % ROUNDS
    yield '%-12s%10s%6s%8s' % ('size', 'subimages', 'bits', 'lost') + ''.join(
        '%17s' % method for method in METHODS) + '%8s' % 'goal'
    for row in rows:
        yield '%-12s%10d%6d%8s' % (row['size'], row['subimages'], row['bits'], '%g %%' % (100 * row['loss'])) + ''.join(
            '%17.2f' % row[method] for method in METHODS) + '%8g' % row['goal']


def _thermal_lines(results: Dict[float, Dict[str, Dict[str, Dict[str, float]]]]) -> Iterator[str]:
    yield '%d radiometric images, errors of missing pixels [count]: mean over images; from "most" on, the maximum' % (
        len(results[0.1][BEST]))
    means, maxima = ('rms', 'edges', '99.9 %'), ('most', 'invented', 'hidden')
    yield '%-8s%-18s' % ('lost', '') + ''.join('%10s' % head for head in ('rms', 'at edges', '99.9 %', *maxima))
    for loss, of_methods in results.items():
        for method, of_images in of_methods.items():
            numbers = ['%10.1f' % mean(of_images, measure) for measure in means] + [
                '%10d' % max(measured[measure] for measured in of_images.values()) for measure in maxima]
            yield '%-8s%-18s' % ('%g %%' % (100 * loss), method) + ''.join(numbers)
