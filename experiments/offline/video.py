# SPDX-License-Identifier: BSD-3-Clause
"""Video over loss, at equal bytes on the wire: this package's codings, and H.264 and JPEG as robot teams send them."""
import functools
import importlib.util
import pathlib
from typing import Dict, Iterator, List, NamedTuple, Sequence, Union

import cv2
import numpy as np

from evaluation.video_clips import RATE, clips
from evaluation.video_link import Conditions, Watched, constant, watch
from evaluation.video_ways import LAYERED, PREDICTED, Ways
from smokebot_udp.arrays import Array
from smokebot_udp.link_lab.channel import LinkConditions

from .. import table
from ..runner import Figure, Run, Skipped, Table
from . import video_prediction, video_results
from .video_results import LINKS, STEP_TIMES, STRIP_PERIOD, STRIPS
from .workers import Workers

TITLE = 'Video over loss, at equal bytes on the wire'

EXPLANATION = """
Clips of 10 images a second, some of them recordings, are sent over a link that loses packets one by one or in bursts.
All ways may use the same rate, headers and redundancy included.

* **H.264, this package** (`coding: h264`): slices that fit a datagram, intra refresh, and an erasure code for the loss
  that the reports of the last seconds say. A report comes 0.15 s after its image was sent.
* **Layered, this package** (`coding: layered`), with and without prediction from what the operator is known to hold.
  Reports of that are as late, and as many of them are lost as of the images' packets.
* **H.264 as nimbro_network**: x264's preset ultrafast, intra refresh within 20 images; a lost packet costs the image.
* **H.264 slices**: each fits a packet and is decoded by itself; intra refresh within 10 images; what is lost is
  concealed.
* **H.264 slices + 25 %**: the same with 25 % of redundancy by an ideal erasure code across the slices of an image.
* **H.264 slices, loss known**: the refresh (10, 5 or 1 images) and the ideal code that are best for this very link,
  which is known beforehand.
* **JPEG, loss known**: the best JPEG that leaves room for the ideal code that is best for this very link.

The peers' H.264 has the highest bit rate that keeps to the rate on average. The screen is compared with what the camera
sees at the same instant, whatever is shown: PSNR, at most 60 dB. It is grey at first; the first second does not count.
An image from 30 dB on is good enough to drive by. A freeze is a time in which nothing new is shown.
Encoding and decoding times are CPU time of all threads; two such measurements run at once.
"""

RATES, QUICK_RATES = (0.3, 1.0, 3.0, 10.0), (0.3, 1.0)
"""Rates of the link, in a full and in a quick run [Mbit/s]."""

IMAGES, SLOW_IMAGES, QUICK_IMAGES = 130, 50, 30
"""Number of images of a clip: in a full run, in layers, which take long, and in a quick run."""

SEEDS = 2
"""Number of runs on a link with losses."""

STEPS = (0.0, 0.02), (STEP_TIMES[0], 0.3), (STEP_TIMES[1], 0.02)
"""(from when [s], packet loss) of the link whose loss changes."""

STEPS_RATE, STEPS_CLIPS, STEPS_SEEDS = 1.0, ('sway', 'euroc'), 6


class Cell(NamedTuple):
    """A clip, a rate and a link that are measured together."""
    clip: str
    rate: float
    """[Mbit/s]"""
    link: str
    """One of LINKS."""


class Measured(NamedTuple):
    """The results of a cell."""
    rows: List[table.Row]
    """For video.csv."""
    strips: Dict[str, Array]
    """{key: image to look at}"""
    strip_rows: List[table.Row]
    """For strips.csv: what these are."""


class Curve(NamedTuple):
    """A clip, a way of sending it and a link, whose PSNR is measured over time."""
    clip: str
    way: str
    link: str
    """One of STEP_LINKS."""


def run(run: Run) -> None:
    """Send each clip in each way: video.csv, steps.csv; images to look at: strips.npz and strips.csv."""
    if importlib.util.find_spec('av') is None:
        raise Skipped('PyAV is not installed')
    rows: List[table.Row] = []
    strips: Dict[str, Array] = {}
    strip_rows: List[table.Row] = []
    cells = [Cell(name, rate, link) for name in (['sway'] if run.quick else clips(1))
             for rate in (QUICK_RATES if run.quick else RATES) for link in LINKS]
    with Workers(run) as workers:
        for measured in workers.each(functools.partial(measure, quick=run.quick, seed=run.seed), cells,
                                     lambda cell: '%s, %g Mbit/s, %s' % cell):
            rows += measured.rows
            strips.update(measured.strips)
            strip_rows += measured.strip_rows
            table.write(run.folder / 'video.csv', rows)
        table.write(run.folder / 'strips.csv', strip_rows)
        np.savez_compressed(str(run.folder / 'strips.npz'), **strips)
        if not run.quick:
            table.write(run.folder / 'steps.csv', list(steps(run, workers)))
            video_prediction.measure(run, workers)


@functools.lru_cache(maxsize=1)
def ways_of(clip: str, images: int, quick: bool = False) -> Ways:
    """All ways of sending a clip; those of the last one are kept."""
    return Ways(clips(images)[clip], quick)


def measure(cell: Cell, quick: bool, seed: int) -> Measured:
    """All ways in a cell.

    :param seed: of the run
    """
    ways = ways_of(cell.clip, QUICK_IMAGES if quick else IMAGES, quick)
    measured = Measured([], {}, [])
    for way in video_results.COLOURS:
        watched = watched_each(ways, cell, way, quick, seed)
        measured.rows.extend(row_of(cell, way, one) for one in watched)
        if (cell.rate, cell.link) == STRIPS.get(cell.clip):
            measured.strip_rows.extend(strip(measured.strips, cell, way, watched[0]))
    return measured


def watched_each(ways: Ways, cell: Cell, way: str, quick: bool, seed: int) -> List[Watched]:
    """One way in one cell, once for each seed."""
    conditions = LINKS[cell.link]
    clip = ways.clip[:SLOW_IMAGES] if way in (LAYERED, PREDICTED) else ways.clip
    seeds = ['%s %s' % (seed, number) for number in range(SEEDS if conditions.loss and not quick else 1)]
    return [watch(clip, ways.make(way, 1e6 * cell.rate, conditions, each), constant(conditions), each, 1e6 * cell.rate)
            for each in seeds]


def row_of(cell: Cell, way: str, watched: Watched) -> table.Row:
    """What was seen, for the CSV file."""
    return {'clip': cell.clip, 'Mbit/s': cell.rate, 'link': cell.link, 'way': way,
            'PSNR [dB]': round(watched.mean, 3), 'visible [%]': round(100 * watched.visible, 1),
            'freeze [s]': watched.freeze, 'used [Mbit/s]': round(watched.rate / 1e6, 3),
            'encode [ms]': round(1e3 * watched.encoding, 2), 'decode [ms]': round(1e3 * watched.decoding, 2)}


def strip(strips: Dict[str, Array], cell: Cell, way: str, watched: Watched) -> Iterator[table.Row]:
    """Add some images of a run to those that are shown."""
    for number in range(STRIP_PERIOD, video_results.STRIP_COLUMNS * STRIP_PERIOD + 1, STRIP_PERIOD):
        key = '%s %s %d' % (cell.clip, way, number)
        image = watched.screens[number]
        scale = min(1.0, video_results.STRIP_WIDTH / image.shape[1])
        strips[key] = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        yield {'clip': cell.clip, 'way': way, 'image': number, 'PSNR [dB]': float(watched.psnr[number]),
               'new': bool(watched.new[number])}


def changing(now: float) -> LinkConditions:
    """The link whose loss changes in steps."""
    return LinkConditions(loss=[loss for since, loss in STEPS if since <= now][-1])


STEP_LINKS: Dict[str, Conditions] = {
    'steps': changing, **{'%g %%' % (100 * loss): constant(LinkConditions(loss=loss)) for _, loss in STEPS}}
"""That link, and links whose loss is that of each step all the time."""


def steps(run: Run, workers: Workers) -> Iterator[table.Row]:
    """PSNR over time on each of STEP_LINKS; means over seeds."""
    found = clips(1)
    curves = [Curve(name, way, link) for name in STEPS_CLIPS if name in found
              for way in video_results.STEP_WAYS for link in STEP_LINKS]
    measured = workers.each(functools.partial(over_time, seed=run.seed), curves, ', '.join)
    for curve, values in zip(curves, measured):
        for number, value in enumerate(values):
            yield {**curve._asdict(), 'time [s]': number / RATE, 'PSNR [dB]': round(value, 3)}


def over_time(curve: Curve, seed: int) -> List[float]:
    """PSNR of each image, mean over STEPS_SEEDS runs [dB].

    :param seed: of the run
    """
    ways = ways_of(curve.clip, int(RATE * (2 * STEP_TIMES[1] - STEP_TIMES[0])))
    rate = 1e6 * STEPS_RATE
    seeds = ['steps %d %d' % (seed, number) for number in range(STEPS_SEEDS)]
    runs = [watch(ways.clip, ways.make(curve.way, rate, LinkConditions(), each), STEP_LINKS[curve.link], each, rate)
            for each in seeds]
    means: List[float] = np.mean([watched.psnr for watched in runs], axis=0).tolist()
    return means


def plot(folder: pathlib.Path) -> Sequence[Union[Figure, Table]]:
    """Figures and tables."""
    return [*video_results.plot(folder), *video_prediction.tables(folder)]


def missed(folder: pathlib.Path) -> List[str]:
    """What falls behind the best peer, or behind images without prediction."""
    return video_results.missed(folder) + video_prediction.missed(folder)


DOC_TABLES = {'psnr': video_results.doc_psnr, 'leads': video_results.doc_leads, 'steps': video_results.steps_table,
              'times': video_results.doc_times}
