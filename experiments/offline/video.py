# SPDX-License-Identifier: BSD-3-Clause
"""Video over loss, at equal bytes on the wire: this package's codings, and H.264 and JPEG as robot teams send them."""
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
"""

RATES, QUICK_RATES = (0.3, 1.0, 3.0, 10.0), (0.3, 1.0)
"""[Mbit/s]"""

IMAGES, SLOW_IMAGES, QUICK_IMAGES = 130, 50, 30
"""Of a clip; of what is sent in layers, which takes long."""

SEEDS = 2
"""Runs on a link with losses."""

STEPS = (0.0, 0.02), (STEP_TIMES[0], 0.3), (STEP_TIMES[1], 0.02)
"""(from when [s], packet loss) of the link whose loss changes."""

STEPS_RATE, STEPS_CLIPS, STEPS_SEEDS = 1.0, ('sway', 'euroc'), 6


class Cell(NamedTuple):
    """What is measured at a time."""
    clip: str
    rate: float
    """[Mbit/s]"""
    link: str
    """One of LINKS."""


def run(run: Run) -> None:
    """Send each clip in each way: video.csv, steps.csv; images to look at: strips.npz and strips.csv."""
    if importlib.util.find_spec('av') is None:
        raise Skipped('PyAV is not installed')
    found = clips(QUICK_IMAGES if run.quick else IMAGES)
    rows: List[table.Row] = []
    strips: Dict[str, Array] = {}
    strip_rows: List[table.Row] = []
    for name in ['sway'] if run.quick else found:
        ways = Ways(found[name], run.quick)
        cells = [Cell(name, rate, link) for rate in (QUICK_RATES if run.quick else RATES) for link in LINKS]
        for cell in run.steps(cells, lambda cell: '%s, %g Mbit/s, %s' % cell):
            for way in video_results.COLOURS:
                watched = watched_each(ways, cell, way, run)
                rows += [row_of(cell, way, one) for one in watched]
                if (cell.rate, cell.link) == STRIPS.get(cell.clip):
                    strip_rows += strip(strips, cell, way, watched[0])
            table.write(run.folder / 'video.csv', rows)
    table.write(run.folder / 'strips.csv', strip_rows)
    np.savez_compressed(str(run.folder / 'strips.npz'), **strips)
    if not run.quick:
        table.write(run.folder / 'steps.csv', list(steps(run)))
    video_prediction.measure(run)


def watched_each(ways: Ways, cell: Cell, way: str, run: Run) -> List[Watched]:
    """One way in one cell, once for each seed."""
    conditions = LINKS[cell.link]
    clip = ways.clip[:SLOW_IMAGES] if way in (LAYERED, PREDICTED) else ways.clip
    seeds = ['%s %s' % (run.seed, number) for number in range(SEEDS if conditions.loss and not run.quick else 1)]
    return [watch(clip, ways.make(way, 1e6 * cell.rate, conditions, seed), constant(conditions), seed, 1e6 * cell.rate)
            for seed in seeds]


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


def steps(run: Run) -> Iterator[table.Row]:
    """PSNR over time on that link, beside links whose loss is that of each step all the time; means over seeds."""
    links: Dict[str, Conditions] = {'steps': changing}
    links.update({'%g %%' % (100 * loss): constant(LinkConditions(loss=loss)) for _, loss in STEPS})
    found = clips(int(RATE * (2 * STEP_TIMES[1] - STEP_TIMES[0])))
    for name in [name for name in STEPS_CLIPS if name in found]:
        ways = Ways(found[name])
        for way, link in run.steps([(way, link) for way in video_results.STEP_WAYS for link in links], ', '.join):
            for number, value in enumerate(curve(ways, way, links[link], run.seed)):
                yield {'clip': name, 'way': way, 'link': link, 'time [s]': number / RATE,
                       'PSNR [dB]': round(value, 3)}


def curve(ways: Ways, way: str, conditions: Conditions, seed: int) -> List[float]:
    """PSNR of each image, mean over STEPS_SEEDS runs [dB]."""
    rate = 1e6 * STEPS_RATE
    seeds = ['steps %d %d' % (seed, number) for number in range(STEPS_SEEDS)]
    runs = [watch(ways.clip, ways.make(way, rate, LinkConditions(), each), conditions, each, rate) for each in seeds]
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
