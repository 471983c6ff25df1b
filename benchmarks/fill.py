# SPDX-License-Identifier: BSD-3-Clause
"""How well missing pixels are filled, and how fast: the methods of codecs/fill.py beside OpenCV's inpainting.

Photographs at 320 x 240 in 64 subimages, of which random ones are lost, the same for each method; radiometric
pictures at their own size, cut as a stream cuts them. results/bench gets a plot and a sheet of pictures to look at.
"""
import statistics
import time

import cv2
import numpy as np
from skimage.metrics import structural_similarity

from smokebot_udp.codecs.concealment.fill import BEST, METHODS
from smokebot_udp.codecs.concealment.temporal import received
from smokebot_udp.codecs.wire.interleave import Interleave, fit

from . import fill_plots, pictures

LOSSES = 0.05, 0.1, 0.2, 0.5, 0.8, 0.9, 0.95
PATTERNS = 20
QUICK, QUICK_THERMAL = ('camera', 'motorcycle_left'), ('simulated',)
"""Of these pictures only, where it must be quick."""

LOOKED_AT = 4
"""SSIM and inpainting take long: so many patterns only."""

GOALS = {0.1: 38.0, 0.2: 35.0, 0.5: 29.5, 0.8: 25.0, 0.9: 23.0}
"""[dB], of the best method"""

SIZES = {(240, 320, 3): 3.0, (480, 640, 3): 6.0, (480, 640, 4): 15.0, (480, 640, 5): 15.0}
"""{(height, width, depth): goal for a picture [ms]}"""

ROUNDS, QUICK_ROUNDS = 40, 8
ROOM = 1400
"""Bytes of pixels in a datagram."""

NEAR = np.ones((5, 5), np.uint8)
"""A peak counts as shown where a pixel as hot is shown in the square around it."""

SHEETS = {'fill_sheet.jpg': ('camera', 'motorcycle_left', 'simulated'),
          'fill_recordings.jpg': ('t640_electrical_cabinet', 'ir_Steam_Train_Valves_Thermal_Image', 'tp_FLIR')}
"""{file: pictures on it, where they are at hand}"""

EDGES = 0.05
"""The share of pixels that lie at edges: those in whose squares the counts differ most."""


def inpaint(subimages, have, cut):
    """OpenCV's, after Telea; of bytes only."""
    filled = cv2.inpaint(cut.merge(subimages), (~received(have, cut)).astype(np.uint8), 2, cv2.INPAINT_TELEA)
    return cut.split(filled)


ALL = {**METHODS, 'inpainting': inpaint}


def patterns(cut, loss, count):
    """So many (n,) bool: what came, at least one subimage; always the same."""
    random = np.random.RandomState(1)
    while count:
        have = random.random_sample(len(cut)) >= loss
        if have.any():
            yield have
            count -= 1


def quality(photographs, log):
    """{method: {loss: {picture: {'psnr' [dB], 'ssim', 'ms': of this picture's fills, medians}}}}"""
    results = {method: {loss: {} for loss in LOSSES} for method in ALL}
    for name, picture in photographs.items():
        log(name)
        cut = Interleave(*picture.shape, 3)
        subimages = cut.split(picture)
        for loss in LOSSES:
            for method, fill in ALL.items():
                few = LOOKED_AT if method == 'inpainting' else PATTERNS
                results[method][loss][name] = _measured(picture, subimages, cut, fill, patterns(cut, loss, few))
    return results


def _measured(picture, subimages, cut, fill, haves):
    psnr, ssim, seconds = [], [], []
    for have in haves:
        filled, took = _timed(fill, subimages, have, cut)
        shown = cut.merge(filled)
        psnr.append(pictures.psnr(picture, shown))
        if len(ssim) < LOOKED_AT:
            ssim.append(structural_similarity(picture, shown))
        seconds.append(took)
    return {'psnr': statistics.mean(psnr), 'ssim': statistics.mean(ssim), 'ms': 1e3 * statistics.median(seconds)}


def _timed(fill, *arguments):
    begun = time.process_time()     # what else this machine does is of no matter
    filled = fill(*arguments)
    return filled, time.process_time() - begun


def times(rounds):
    """[{'size', 'subimages', 'bits', 'loss', 'goal' [ms], method: median [ms], ...}]; each picture lost others."""
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


def thermal(recordings, log):
    """{loss: {method: {picture: {'rms', 'edges', '99.9 %', 'most', 'invented', 'hidden' [count]}}}}

    Errors of the missing pixels: edges is the rms error of those at edges, most the greatest of all; invented is by how
    much a pixel is hotter than all around it truly are, hidden by how much one truly is hotter than all that are shown
    around it.
    """
    results = {}
    for loss in (0.1, 0.2, 0.5, 0.8, 0.9):
        log('thermal, %g %% lost' % (100 * loss))
        results[loss] = {method: {name: _counts(picture, fill, loss) for name, picture in recordings.items()}
                         for method, fill in METHODS.items()}
    return results


def _counts(picture, fill, loss):
    cut, _ = fit(*picture.shape, 2, ROOM)
    subimages, hottest = cut.split(picture), cv2.dilate(picture, NEAR).astype(int)
    contrast = hottest - cv2.erode(picture, NEAR)
    edge = contrast >= np.quantile(contrast, 1 - EDGES)
    errors, at_edges, invented, hidden = [], [], 0, 0
    for have in patterns(cut, loss, LOOKED_AT):
        shown = cut.merge(fill(subimages, have, cut))
        missing, error = ~received(have, cut), np.abs(shown - picture.astype(float))
        errors.append(error[missing])
        at_edges.append(error[missing & edge])
        invented = max(invented, int((shown - hottest).max()))
        hidden = max(hidden, int((picture.astype(int) - cv2.dilate(shown, NEAR)).max()))
    errors, at_edges = np.concatenate(errors), np.concatenate(at_edges)
    return {'rms': _rms(errors), 'edges': _rms(at_edges), '99.9 %': float(np.percentile(errors, 99.9)),
            'most': int(errors.max()), 'invented': invented, 'hidden': hidden}


def _rms(errors):
    return float(np.sqrt(np.mean(errors ** 2)))


def run(log, quick=False):
    """{'quality', 'times', 'thermal': as those functions return}"""
    photographs, recordings = pictures.grey(320, 240), pictures.thermal()
    if quick:
        photographs, recordings = ({name: some[name] for name in names} for some, names in (
            (photographs, QUICK), (recordings, QUICK_THERMAL)))
    results = {'quality': quality(photographs, log), 'times': times(QUICK_ROUNDS if quick else ROUNDS),
               'thermal': thermal(recordings, log)}
    folder = pictures.TOP / 'results' / 'bench'
    folder.mkdir(parents=True, exist_ok=True)
    fill_plots.plot(results['quality'], GOALS, folder / 'fill.png')
    at_hand = {**photographs, **recordings}
    for file, names in SHEETS.items():
        shown = {name: at_hand[name] for name in names if name in at_hand}
        if shown:
            fill_plots.sheet(shown, folder / file)
    log('see %s/fill*' % folder)
    return results


def table(results):
    return '\n'.join(['filling missing pixels', '', *_quality_lines(results['quality']), '',
                      *_time_lines(results['times']), '', *_thermal_lines(results['thermal'])])


def mean(of_pictures, what):
    """The mean over pictures."""
    return statistics.mean(measured[what] for measured in of_pictures.values())


def _quality_lines(results):
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


def _time_lines(rows):
    yield 'a picture, each time with another loss, median of %d [ms of CPU]' % ROUNDS
    yield '%-12s%10s%6s%8s' % ('size', 'subimages', 'bits', 'lost') + ''.join(
        '%17s' % method for method in METHODS) + '%8s' % 'goal'
    for row in rows:
        yield '%-12s%10d%6d%8s' % (row['size'], row['subimages'], row['bits'], '%g %%' % (100 * row['loss'])) + ''.join(
            '%17.2f' % row[method] for method in METHODS) + '%8g' % row['goal']


def _thermal_lines(results):
    yield '%d radiometric pictures, missing pixels\' errors [count]: mean over pictures, and the most of all' % (
        len(results[0.1][BEST]))
    means, most = ('rms', 'edges', '99.9 %'), ('most', 'invented', 'hidden')
    yield '%-8s%-18s' % ('lost', '') + ''.join('%10s' % what for what in ('rms', 'at edges', '99.9 %', *most))
    for loss, of_methods in results.items():
        for method, of in of_methods.items():
            numbers = ['%10.1f' % mean(of, what) for what in means] + [
                '%10d' % max(measured[what] for measured in of.values()) for what in most]
            yield '%-8s%-18s' % ('%g %%' % (100 * loss), method) + ''.join(numbers)
