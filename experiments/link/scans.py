# SPDX-License-Identifier: BSD-3-Clause
"""Bytes of laser scans, as they are and in steps of 1 mm, and how often they come over a bad link."""
import pathlib
from typing import Dict, List, Union

import numpy as np

from evaluation.offline_link import Receiver, Sender, received, wire_size
from evaluation.recordings import RECORDINGS
from evaluation.rooms import rooms, scan_message
from evaluation.scan_run import ScanRun
from evaluation.state_run import RATE_LIMIT
from smokebot_udp.arrays import Float32Array

from .. import table
from ..runner import Figure, Run, Table

TITLE = 'Laser scans on the wire and over loss'

EXPLANATION = """
1081 ranges over 270 degrees, as of a Hokuyo UTM-30LX, in rooms with boxes, with noise of the datasheet's 10 mm and of
3 and 20 mm; and the scans of a Hokuyo URG with 681 ranges, where the recording is at hand. Ranges are floats; those of
the URG are whole millimetres.

Then scans of 1081 ranges, with 10 mm of noise, at 10 Hz, beside all other streams of the simulated robot (the shipped
streams.yaml, all settings as shipped), over a link of 2 Mbit/s with 20 ms of delay each way. A scan of which one half
is lost is published with every second range; the others are NaN.
"""

NOISES = 0.003, 0.01, 0.02
"""[m]"""

SCANS, QUICK_SCANS = 20, 3
RECORDED = 'hokuyo_demo.bag'

LOSSES = 0.0, 0.2, 0.5
SECONDS, QUICK_SECONDS = 25.0, 5.0


def recorded(count: int) -> Float32Array:
    """(n, 681) ranges of the recording; n is 0 where it is not at hand."""
    path = RECORDINGS / 'bags' / RECORDED
    if not path.exists():
        return np.zeros((0, 681), np.float32)
    import rosbag
    with rosbag.Bag(str(path)) as bag:
        ranges = [message.ranges for _, message, _ in bag.read_messages('/scan')]
    return np.array(ranges[::max(1, len(ranges) // count)], np.float32)


def run(run: Run) -> None:
    """Write scans.csv and rates.csv."""
    table.write(run.folder / 'scans.csv', byte_rows(run))
    with ScanRun(run.seed, run.folder / 'nodes.log') as link:
        rows = [link.measure(loss, exact, QUICK_SECONDS if run.quick else SECONDS)
                for exact, loss in run.steps([(exact, loss) for exact in (False, True) for loss in LOSSES])]
    table.write(run.folder / 'rates.csv', rows)


def byte_rows(run: Run) -> List[Dict[str, object]]:
    """A row for each kind of scan."""
    count = QUICK_SCANS if run.quick else SCANS
    sources: Dict[str, Float32Array] = {'%g mm of noise' % (1e3 * noise): rooms(noise, count, run.seed)
                                        for noise in NOISES}
    sources['recorded URG'] = recorded(count)
    rows: List[Dict[str, object]] = []
    for name, scans in sources.items():
        if not len(scans):
            continue
        sizes: Dict[str, List[int]] = {}
        errors = []
        for ranges in scans:
            message = scan_message(ranges)
            for words, exact in ('exact', True), ('1 mm', False):
                frames = Sender('scan', exact=exact).frames(message)
                sizes.setdefault(words, []).append(wire_size(frames))
            shown = received(Receiver('scan'), frames, np.ones(sum(map(len, frames)), bool))
            assert shown is not None
            errors.append(abs(np.asarray(shown.ranges, float) - ranges.astype(float)).max())
        rows.append({'scans': name, 'ranges': scans.shape[1], 'exact [byte]': float(np.mean(sizes['exact'])),
                     '1 mm [byte]': float(np.mean(sizes['1 mm'])), 'most [byte]': max(sizes['1 mm']),
                     'error [mm]': 1e3 * max(errors)})
    return rows


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The tables."""
    return [bytes_table(folder), rates_table(folder)]


def bytes_table(folder: pathlib.Path) -> Table:
    """Bytes and errors."""
    rows = table.read(folder / 'scans.csv')
    return Table('A scan on the wire, whole IP packets: mean, the longest one, and the largest error of a range:',
                 ['scans', 'ranges', 'exact [byte]', '1 mm [byte]', 'most [byte]', 'error [mm]'],
                 [[row['scans'], '%d' % row['ranges'], *('%.0f' % row[key] for key in (
                     'exact [byte]', '1 mm [byte]', 'most [byte]')), '%.2f' % row['error [mm]']] for row in rows])


def rates_table(folder: pathlib.Path) -> Table:
    """How often scans come, and how much of them."""
    rows = table.read(folder / 'rates.csv')
    return Table('Scans of 1081 ranges at 10 Hz, and all other streams, over %g Mbit/s:' % (1e-6 * RATE_LIMIT),
                 ['ranges', 'loss [%]', 'come [Hz]', 'whole [%]', 'ranges [%]', 'age p50 [ms]', 'age p95 [ms]'],
                 [['exact' if row['exact'] else '1 mm', '%g' % row['loss [%]'], '%.1f' % row['come [Hz]'],
                   *('%.0f' % row[key] for key in ('whole [%]', 'ranges [%]', 'age p50 [ms]', 'age p95 [ms]'))]
                  for row in rows])


DOC_TABLES = {'bytes': bytes_table, 'rates': rates_table}
