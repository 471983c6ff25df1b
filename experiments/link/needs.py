# SPDX-License-Identifier: BSD-3-Clause
"""What each stream takes of the processors of both machines, and of the link."""
import pathlib
from typing import Any, Dict, List, Union

from evaluation.needs_run import LINKS, Case, NeedsRun

from .. import table
from ..runner import Figure, Run, Table

TITLE = 'What each stream takes'

EXPLANATION = """
Streams of the package's streams.yaml alone, from the simulated robot on its tour, all settings as shipped, own masters
and a sealed link. The processor's share is that of robot_sender and of operator_receiver, of one core; the desk draws
the view of images for a subscriber. The link's share is all that the robot sends, with all headers. An image takes what
the link has, up to what it needs: on a slow link it is coarser.
"""

CASES = [Case('camera, 640 x 480, colour, 10 Hz', ['camera'], ['camera']),
         Case('camera, 1280 x 720, colour, 10 Hz', ['camera'], ['camera'], ['_width:=1280', '_height:=720']),
         Case('thermal, 640 x 480, 16 bits, 10 Hz', ['thermal'], ['thermal']),
         Case('cloud of a 16-beam LiDAR, 10 Hz', ['lidar'], ['lidar']),
         Case('laser scan, 10 Hz', ['scan'], ['scan']),
         Case('map, growing, 0.05 m', ['map'], ['lidar', 'map']),
         Case('odometry 10 Hz, tf 20 Hz', ['odom', 'tf', 'tf_static'])]
SECONDS, QUICK_SECONDS = 5.0, 2.0


def run(run: Run) -> None:
    """Write needs.csv."""
    rows: List[Dict[str, Any]] = []
    for case in run.steps(CASES, lambda case: case.title):
        with NeedsRun(case, run.seed, run.folder / 'nodes.log') as nodes:
            rows += [nodes.measure(link, QUICK_SECONDS if run.quick else SECONDS) for link in LINKS]
        table.write(run.folder / 'needs.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The table."""
    return [needs_table(folder)]


def needs_table(folder: pathlib.Path) -> Table:
    """A row for each stream, the links side by side."""
    rows = table.read(folder / 'needs.csv')
    found: Dict[str, List[str]] = {}
    for row in rows:
        found.setdefault(row['stream'], []).extend([
            '%.2g' % (row['sent [kbit/s]'] / 1e3), '%.1f' % row['shown [Hz]'], '%.0f' % row['robot [%]'],
            '%.0f' % row['desk [%]']])
    links = [('%s link' % name) for name in LINKS]
    return Table(
        'On a bad link (2 Mbit/s, 20 % loss, 20 ms) and a good one (20 Mbit/s, no loss, 5 ms), shares of one core:',
        ['stream', *('%s: %s' % (link, title) for link in links for title in (
            'Mbit/s', 'shown [Hz]', 'robot [%]', 'desk [%]'))],
        [[stream, *cells] for stream, cells in found.items()])


DOC_TABLES = {'needs': needs_table}
