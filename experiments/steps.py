# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot's data over a link whose rate goes up and down in steps, in one of several ways."""
import bisect
import sys
import time
from dataclasses import dataclass
from typing import List, Sequence

import numpy as np

from benchmarks.pictures import psnr
from smokebot_udp.link_lab.listener import Listener
from smokebot_udp.link_lab.stack import Stack

from . import keeper
from .crossing import LATE
from .runner import TOP

RATES = 20e6, 5e6, 1e6, 0.3e6, 20e6
"""[bit/s]"""

DELAY, QUEUE = 0.02, 0.2
"""Each way [s]."""

EVERY = 0.25
"""The link's counts are read so often [s]."""

ATTEMPTS = 2

STARTED = 60.0
"""Nodes that do not bring a picture within this will not [s]."""

STEADY, SETTLED = 2.0, 1.0
"""What the link carries counts from so long after a step, what it drops from so long [s]."""

CAMERA, ODOM, TF = 'thermal/image_raw', 'odom', 'tf'
REPORT = 'smokebot_udp/link/report'


@dataclass
class Way:
    """A way of sending."""
    robot: Sequence[str]
    """robot_sender's arguments; None: everything goes whole."""
    transport: str = 'UDPROS'
    congestion_control: str = 'cubic'

    @property
    def picture(self):
        """The topic of what the operator sees."""
        return 'whole/thermal' if self.robot is None else 'operator/thermal/image_raw'

    @property
    def left(self):
        """[[topic, kind, transport], ...] to hear on the robot's side: the camera's pictures, and what left."""
        wires = {name: 'whole/' + name if self.robot is None else 'smokebot_udp/%s/segments' % name
                 for name in (ODOM, TF)}
        status = [] if self.robot is None else [['robot_sender/status', 'status', 'TCPROS']]
        return [[CAMERA, 'kept image', 'TCPROS'], [wires[ODOM], 'odometry', 'TCPROS'],
                [wires[TF], 'transforms', 'TCPROS'], *status]

    @property
    def came(self):
        """As `left`, on the operator's side."""
        kinds = WHOLE if self.robot is None else OURS
        return [[topic, kind, self.transport if self.robot is None else 'TCPROS'] for topic, kind in kinds.items()]

    @property
    def protected(self):
        """{name: (its topic where it leaves, its topic where it came)}"""
        came = 'whole/' if self.robot is None else 'operator/'
        return {name: (topic, came + name) for name, (topic, *_) in zip((ODOM, TF), self.left[1:])}


OURS = {'operator/thermal/image_raw': 'kept image', 'operator/odom': 'odometry', 'operator/tf': 'transforms',
        'operator/lidar/points': 'cloud', 'operator/scan': 'any', 'operator/map': 'any', REPORT: 'report',
        'operator/link': 'link'}
WHOLE = {'whole/thermal': 'kept jpeg', 'whole/camera': 'jpeg', 'whole/cloud': 'cloud', 'whole/scan': 'scan',
         'whole/odom': 'odometry', 'whole/tf': 'transforms'}
"""{topic: kind} on the operator's side"""

THERMAL_FIRST = '_thermal/weight:=4.0'
"""As in all profiles of focus.yaml."""

WAYS = {
    'ours, adapting': Way([THERMAL_FIRST]),
    'ours, fixed at 20 Mbit/s': Way([THERMAL_FIRST, '_adapt:=false', '_max_rate:=20']),
    'whole, over UDPROS': Way(None),
    'whole, over TCPROS, cubic': Way(None, 'TCPROS'),
    'whole, over TCPROS, bbr': Way(None, 'TCPROS', 'bbr'),
}


class Across:
    """A context manager: both sides and the link between them, in one way.

    :param folder: pathlib.Path; what is kept of pictures lies there while it lasts
    :raises LabError: where there can be no emulated link
    """

    def __init__(self, way, seed, folder, rate=RATES[0]):
        self.way = way
        self._files = {side: folder / ('%s.kept' % side) for side in ('robot', 'operator')}
        for file in self._files.values():
            file.write_bytes(b'')
        self.stack = Stack(seed, way.congestion_control, folder / 'nodes.log')
        try:
            self.link(rate, 0.0)
            self._start()
        except BaseException:
            self.stack.close()
            raise

    def _start(self):
        self.stack.start_node('robot', 'simulated_robot', '_width:=%d' % keeper.WIDTH, '_height:=%d' % keeper.HEIGHT)
        if self.way.robot is None:
            self.stack.start('robot', sys.executable, '-m', 'experiments.whole', cwd=str(TOP))
        else:
            self.sender = self.stack.start_node('robot', 'robot_sender', *self.way.robot)
            self.receiver = self.stack.start_node('operator', 'operator_receiver')
        self.robot, self.operator = (
            Listener(self.stack, side, ('experiments.keeper', str(self._files[side]))) for side in self._files)
        self.robot.subscribe(self.way.left)
        self.connect()

    def connect(self):
        """Connect anew over a link that is good, so that TCP does not remember what it was; until pictures come."""
        self.operator.subscribe(self.way.came)
        if not self.operator.first([self.way.picture], STARTED):
            raise RuntimeError('no picture comes over a good link: see nodes.log')

    def link(self, rate, loss):
        self.stack.lab.set({'rate': rate, 'loss': loss, 'delay': DELAY, 'queue': QUEUE})

    def hold(self, seconds):
        """[(when, Lab.counts()), ...] over a time, each EVERY."""
        begun, told = time.time(), []
        while time.time() < begun + seconds:
            time.sleep(EVERY)
            told.append((time.time(), self.stack.lab.counts()))
        return told

    def missed(self):
        """Packets that the lab itself lost."""
        told = self.stack.lab.statistics()
        return sum(told[side]['missed'] for side in ('robot', 'operator'))

    def kept(self, side):
        return keeper.load(self._files[side])

    def close(self):
        self.stack.close()
        for file in self._files.values():
            file.unlink()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


@dataclass
class Told:
    """What was measured of one step of the link: times are time.time() [s]."""
    rate: float
    begun: float
    ended: float
    counts: List


def walk(across, loss, seconds, rates=RATES):
    """Go through the steps: [Told, ...]."""
    steps = []
    for rate in rates:
        across.link(rate, loss)
        begun = time.time()
        counts = [(begun, across.stack.lab.counts()), *across.hold(seconds)]
        steps.append(Told(rate, begun, time.time(), counts))
    return steps


def walk_in_time(across, loss, seconds):
    """`walk` over new connections; again where the emulated link was late."""
    for _ in range(ATTEMPTS):
        across.link(RATES[0], 0.0)
        across.connect()
        steps = walk(across, loss, seconds)
        if max(map(late, steps)) < LATE:
            break
    return steps


def late(step):
    """So late packets left the emulated link: p99 of each EVERY, their median [s]."""
    return percentile([told['late'].get('p99', 0.0) for _, told in step.counts[1:]], 0.5)


def at(counts, when):
    """Of [(when, counts), ...] the first from a time on."""
    return next((told for told in counts if told[0] >= when), counts[-1])


def waited(before, after, share, side='robot'):
    """So long packets waited for the air that entered between two counts, that share of them less [ms]; None: none."""
    passed = {ms: count - before['waited'][side].get(ms, 0) for ms, count in after['waited'][side].items()}
    wanted, seen = share * sum(passed.values()), 0
    for ms in sorted(passed):
        seen += passed[ms]
        if passed[ms] and seen >= wanted:
            return ms
    return None


def of_link(step):
    """What the link carried and dropped of what the robot sent, for a row of a CSV file."""
    (first, steady), (_, settled), (last, end) = (
        at(step.counts, step.begun + STEADY), at(step.counts, step.begun + SETTLED), step.counts[-1])
    a, b = steady['robot'], end['robot']
    entered = b['offered'] - a['offered'] - (b['dropped'] - a['dropped'])
    return {'used [%]': round(100 * 8 * (b['carried'] - a['carried']) / (last - first) / step.rate, 1),
            'queue p50 [ms]': waited(steady, end, 0.5), 'queue p95 [ms]': waited(steady, end, 0.95),
            'dropped': b['dropped'] - settled['robot']['dropped'],
            'air lost [%]': round(100 * (b['lost'] - a['lost']) / max(1, entered), 2),
            'late p99 [ms]': round(1e3 * late(step), 1)}


def percentile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))] if values else None


def of_messages(left, came, step, names):
    """How much of what left of a topic came, and how old it was, for a row of a CSV file.

    :param left, came: [Heard, ...] of both sides
    :param names: the topic on both sides
    """
    since = step.begun + STEADY
    sent = {heard.stamp for heard in left if heard.topic == names[0] and since <= heard.arrival < step.ended - 0.5}
    ages = [heard.age for heard in came if heard.topic == names[1] and heard.stamp in sent]
    # a transform's stamp may come twice
    arrived = {heard.stamp for heard in came if heard.topic == names[1]} & sent
    p99 = percentile(ages, 0.99)
    return {'left': len(sent), 'lost [%]': round(100 * (1 - len(arrived) / len(sent)), 2) if sent else None,
            'age p99 [ms]': None if p99 is None else round(1e3 * p99)}


class Screen:
    """What the operator saw, and what the camera saw, at each instant.

    :param across: an Across, as far as it is by now
    """

    def __init__(self, across):
        left, came = list(across.robot.heard), list(across.operator.heard)
        # what is heard was kept before
        self._truths, self._pictures = across.kept('robot'), across.kept('operator')
        camera = [heard for heard in left if heard.topic == CAMERA]
        self._camera = [heard.stamp for heard in camera], [heard.amount for heard in camera]
        self._by_stamp = dict(zip(*self._camera))
        self.came = [heard for heard in came if heard.topic == across.way.picture]
        self._arrivals = [heard.arrival for heard in self.came]

    def true(self, when):
        """Counts of what the camera saw last."""
        at = bisect.bisect(self._camera[0], when) - 1
        return self._truths[self._camera[1][max(at, 0)]]

    def shown(self, when):
        """Counts of what the operator saw last; None before the first picture."""
        at = bisect.bisect(self._arrivals, when) - 1
        return self._pictures[self.came[at].amount] if at >= 0 else None

    def psnr(self, when):
        """Of what is shown to what is so, in greys [dB]; None before the first picture."""
        shown = self.shown(when)
        return None if shown is None else psnr(keeper.to_grey(self.true(when)), keeper.to_grey(shown))

    def exact(self, heard):
        """Whether a picture that came is what the camera saw, bit for bit."""
        at = self._by_stamp.get(heard.stamp)
        return at is not None and np.array_equal(self._truths[at], self._pictures[heard.amount])

    def during(self, begun, ended):
        """A row of a CSV file."""
        came = [heard for heard in self.came if begun <= heard.arrival < ended]
        ages = [heard.age for heard in came]
        qualities = [quality for quality in map(self.psnr, np.arange(begun, ended, 0.1)) if quality is not None]
        return {'pictures [Hz]': round(len(came) / (ended - begun), 2),
                'exact [%]': round(100 * np.mean([self.exact(heard) for heard in came]), 1) if came else None,
                'age p50 [ms]': round(1e3 * percentile(ages, 0.5)) if came else None,
                'age p99 [ms]': round(1e3 * percentile(ages, 0.99)) if came else None,
                'PSNR [dB]': round(float(np.mean(qualities)), 2) if qualities else None}
