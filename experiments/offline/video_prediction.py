# SPDX-License-Identifier: BSD-3-Clause
"""Layered images with and without prediction, at equal bytes: a part of the experiment `video`."""
import functools
import pathlib
from typing import Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from evaluation.video_clips import RATE, Clip, small_clips
from evaluation.video_link import Watched, constant, watch
from evaluation.video_ways import LAYERED, PREDICTED, Ways
from smokebot_udp.link_lab.channel import LinkConditions

from .. import table
from ..runner import Run, Table
from .workers import Workers

FILE = 'prediction.csv'
IMAGES = 70


class Case(NamedTuple):
    """What is measured, with and without prediction."""
    clip: str
    size: float
    """Size of an image on the wire [kB]."""
    loss: float
    gain: Optional[float]
    """What prediction must gain, at least [dB]; None: the standing image must become exact."""


CASES = (
    Case('thermal, standing', 12.5, 0.2, None), Case('thermal, moving', 12.5, 0.0, -0.1),
    Case('thermal, moving', 12.5, 0.2, -0.1), Case('euroc, small', 5, 0.0, 3.0), Case('euroc, small', 16, 0.0, 4.0),
    Case('euroc, small', 5, 0.2, -0.1), Case('euroc, small', 16, 0.2, -0.1))

EXACT_WITHIN = 5.0
"""The standing image must be exact from then on [s]."""


def measure(run: Run, workers: Workers) -> None:
    """Send the clips whose recordings are there: prediction.csv, if any is."""
    found = small_clips(1)
    cases = [case for case in CASES if case.clip in found]
    measured = workers.each(functools.partial(compared, seed=run.seed), cases, lambda case: case.clip)
    rows = [row for of_case in measured for row in of_case]
    if rows:
        table.write(run.folder / FILE, rows)


def compared(case: Case, seed: int) -> List[table.Row]:
    """A case with and without prediction.

    :param seed: of the run
    """
    conditions, rate, rows = LinkConditions(loss=case.loss), 8e3 * case.size * RATE, []
    clip = small_clips(IMAGES)[case.clip]
    for way in (PREDICTED, LAYERED):
        watched = watch(clip, Ways(clip).make(way, rate, conditions, seed), constant(conditions), seed, rate)
        rows.append({'clip': case.clip, 'kB': case.size, 'loss': case.loss, 'way': way,
                     'PSNR [dB]': round(watched.mean, 3), 'exact from [s]': exact_from(clip, watched),
                     'encode [ms]': round(1e3 * watched.encoding, 1), 'decode [ms]': round(1e3 * watched.decoding, 1)})
    return rows


def exact_from(clip: Clip, watched: Watched) -> Optional[float]:
    """From when on the screen showed exactly what the camera saw [s]; None: it did not in the end."""
    wrong = [number for number, (image, screen) in enumerate(zip(clip, watched.screens))
             if not np.array_equal(image, screen)]
    since = wrong[-1] + 1 if wrong else 0
    return None if since == len(clip) else since / RATE


def pairs(folder: pathlib.Path) -> Iterator[Tuple[Case, table.Row, table.Row]]:
    """Each case that was measured: with and without prediction."""
    if not (folder / FILE).exists():
        return
    found = {(row['clip'], row['kB'], row['loss'], row['way']): row for row in table.read(folder / FILE)}
    for case in CASES:
        keys = [(case.clip, case.size, case.loss, way) for way in (PREDICTED, LAYERED)]
        if keys[0] in found:
            yield case, found[keys[0]], found[keys[1]]


def tables(folder: pathlib.Path) -> List[Table]:
    """What prediction gains; none where it was not measured."""
    rows = []
    for case, predicted, intra in pairs(folder):
        both = intra, predicted
        rows.append([case.clip, case.size, '%g %%' % (100 * case.loss), *('%.1f' % row['PSNR [dB]'] for row in both),
                     '%+.2f' % gain(predicted, intra), predicted['exact from [s]'],
                     *('%(encode [ms])g / %(decode [ms])g' % row for row in both)])
    head = ['clip', 'kB per image', 'lost', 'without [dB]', 'predicted [dB]', 'gain [dB]', 'exact from [s]',
            'CPU without, encode / decode [ms]', 'CPU predicted [ms]']
    caption = 'Layered images without and with prediction; PSNR of 16 bits is of the range of the clip:'
    return [Table(caption, head, rows)] if rows else []


def gain(predicted: table.Row, intra: table.Row) -> float:
    """The gain of prediction in PSNR [dB]."""
    return float(predicted['PSNR [dB]'] - intra['PSNR [dB]'])


def missed(folder: pathlib.Path) -> List[str]:
    """Where prediction gains too little, or a standing image does not become exact in time."""
    texts = []
    for case, predicted, intra in pairs(folder):
        words, since = '%s, %g kB, %g %%' % (case.clip, case.size, 100 * case.loss), predicted['exact from [s]']
        if case.gain is not None and gain(predicted, intra) < case.gain:
            texts.append('%s: prediction gains %.2f dB' % (words, gain(predicted, intra)))
        if case.gain is None and (since is None or since > EXACT_WITHIN):
            texts.append('%s: %s' % (words, 'never exact' if since is None else 'exact from %g s on' % since))
    return texts
