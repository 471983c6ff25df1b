# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot's data over a link whose rate changes in steps, by one of several methods."""
import bisect
import math
import pathlib
import sys
import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from smokebot_udp.arrays import Array
from smokebot_udp.link_lab.channel import LinkConditions

from . import TOP, one_of, recorder
from .link_run import LOAD_CODEC, LabWatch, repeated
from .listener import Heard, Listener, Subscription
from .quality import psnr
from .stack import Stack
from .started import Started

RATES = 20e6, 5e6, 1e6, 0.3e6, 20e6
"""Rates of the link, one after the other [bit/s]."""

DELAY, QUEUE = 0.02, 0.2
"""Delay and queue of the link, each way [s]."""

SAMPLE_PERIOD = 0.25
"""Time between samples of the link's counts [s]."""

SAMPLED = 0.017
"""The display is judged this often: no part of the time between two images, so that each part of it counts [s]."""

ATTEMPTS = 2

START_TIMEOUT = 60.0
"""Nodes that have not delivered an image by then never will [s]."""

COURSE = 10.0
"""The robot has driven for this long when the first step begins, so that all methods show the same course [s]."""

STEADY, SETTLED = 2.0, 1.0
"""What the link carries counts from this time after a step on, what it drops from this one on [s]."""

CAMERA, ODOM, TF = 'thermal/image_raw', 'odom', 'tf'
REPORT = '/smokebot_udp/link/report'

OPERATOR_KINDS = {
    'operator/thermal/image_raw': 'recorded image', 'operator/odom': 'odometry', 'operator/tf': 'transforms',
    'operator/lidar/points': 'cloud', 'operator/scan': 'any', 'operator/map': 'any', REPORT: 'report',
    'operator/link': 'link'}
BASELINE_KINDS = {
    'whole/thermal': 'recorded jpeg', 'whole/camera': 'jpeg', 'whole/cloud': 'cloud', 'whole/scan': 'scan',
    'whole/odom': 'odometry', 'whole/tf': 'transforms'}
"""{topic: kind, see listener.KINDS} on the operator's side"""

Row = Dict[str, Any]
"""A row of a CSV file."""

Counts = Dict[str, Any]
"""See Lab.counts."""


@dataclass
class Method:
    """A way of sending."""
    robot: Optional[Sequence[str]]
    """robot_sender's arguments; None: the baseline."""
    transport: str = 'UDPROS'
    """Transport of the baseline's topics."""
    congestion_control: str = 'cubic'
    warm_up: float = 0.0
    """How long the nodes need after their first image until they send as the method says [s]."""

    @property
    def image_topic(self) -> str:
        """What the operator sees."""
        return 'whole/thermal' if self.robot is None else 'operator/thermal/image_raw'

    @property
    def robot_subscriptions(self) -> List[Subscription]:
        """What to listen to on the robot's side: the camera, and the protected topics as they are sent."""
        wires = {name: 'whole/' + name if self.robot is None else '/smokebot_udp/%s/segments' % name
                 for name in (ODOM, TF)}
        status = [] if self.robot is None else [['robot_sender/status', 'status', 'TCPROS']]
        relayed = '' if self.robot is None else 'relayed '
        return [[CAMERA, 'recorded image', 'TCPROS'], [wires[ODOM], relayed + 'odometry', 'TCPROS'],
                [wires[TF], relayed + 'transforms', 'TCPROS'], *status]

    @property
    def operator_subscriptions(self) -> List[Subscription]:
        """What to listen to on the operator's side."""
        kinds = BASELINE_KINDS if self.robot is None else OPERATOR_KINDS
        transport = self.transport if self.robot is None else 'TCPROS'
        return [[topic, kind, transport] for topic, kind in kinds.items()]

    @property
    def protected(self) -> Dict[str, Tuple[str, str]]:
        """{name: (its topic on the robot's side, its topic on the operator's side)}"""
        prefix = 'whole/' if self.robot is None else 'operator/'
        topics = [topic for topic, *_ in self.robot_subscriptions]
        return {ODOM: (topics[1], prefix + ODOM), TF: (topics[2], prefix + TF)}


THERMAL_FIRST = '_thermal/weight:=4.0'
"""As in all profiles of focus.yaml."""

INTERLEAVED, LAYERED = (['_thermal/coding:=' + coding, '_camera/coding:=' + coding]
                        for coding in ('interleaved', 'layered'))
METHODS = {
    'ours, adapting': Method([THERMAL_FIRST, *INTERLEAVED]),
    'ours, layered': Method([THERMAL_FIRST, *LAYERED], warm_up=LOAD_CODEC),
    'ours, fixed at 20 Mbit/s': Method([THERMAL_FIRST, *INTERLEAVED, '_adapt:=false', '_max_rate:=20']),
    'whole, over UDPROS': Method(None),
    'whole, over TCPROS, cubic': Method(None, 'TCPROS'),
    'whole, over TCPROS, bbr': Method(None, 'TCPROS', 'bbr'),
}


@dataclass
class Step:
    """A measured step of the link: times by time.time() [s]."""
    rate: float
    """[bit/s]"""
    begun: float
    ended: float
    counts: List[Tuple[float, Counts]]
    """(time, Lab.counts()), each SAMPLE_PERIOD."""

    @property
    def lateness(self) -> float:
        """How late the emulated link itself was: the median of each sample's p99 [s]."""
        return one_of.percentile([counts['late'].get('p99', 0.0) for _, counts in self.counts[1:]], 50)

    def sample(self, after: float) -> Tuple[float, Counts]:
        """The first sample from this time after the step on [s]."""
        return next((sample for sample in self.counts if sample[0] >= self.begun + after), self.counts[-1])


class RateStepRun(Started):
    """Both sides and the link between them, with one method; a context manager.

    :param folder: where images are recorded while it lasts, and nodes.log is written
    :param rate: of the link at the start [bit/s]
    :raises LabError: where there can be no emulated link
    """

    def __init__(self, method: Method, seed: int, folder: pathlib.Path, rate: float = RATES[0]) -> None:
        super().__init__()
        self.method = method
        self._files = {side: folder / ('%s.recorded' % side) for side in ('robot', 'operator')}
        for file in self._files.values():
            file.write_bytes(b'')
            self.callback(file.unlink)
        self.stack = self.enter_context(Stack(seed, method.congestion_control, folder / 'nodes.log'))
        self._watch = LabWatch(self.stack.lab)
        with self.starting():
            self.set_link(rate, 0.0)
            self._start()

    def _start_robot(self) -> None:
        self._robot = self.stack.start_node('robot', 'simulated_robot', '_width:=%d' % recorder.WIDTH,
                                            '_height:=%d' % recorder.HEIGHT)

    def _start(self) -> None:
        self._start_robot()
        if self.method.robot is None:
            self.stack.start('robot', sys.executable, '-m', 'evaluation.baseline', cwd=str(TOP))
        else:
            self._sender = self.stack.start_node('robot', 'robot_sender', *self.method.robot)
            self.stack.start_node('operator', 'operator_receiver')
        self.robot, self.operator = (
            Listener(self.stack, side, ('evaluation.recorder', str(file))) for side, file in self._files.items())
        self.robot.subscribe(self.method.robot_subscriptions)
        self.connect()
        time.sleep(self.method.warm_up)

    def connect(self) -> None:
        """Reconnect over a good link, so that TCP knows nothing of the link before, and wait for an image."""
        self.operator.subscribe(self.method.operator_subscriptions)
        if not self.operator.first([self.method.image_topic], START_TIMEOUT):
            raise RuntimeError('no image arrives over a good link: see nodes.log')

    def restart_robot(self) -> float:
        """Let the simulated robot begin its course again; when its first image came, by time.time() [s]."""
        self.stack.end(self._robot)
        heard = len(self.robot.heard)
        self._start_robot()
        if not self.robot.first([CAMERA], START_TIMEOUT):
            raise RuntimeError('the simulated robot sends no images: see nodes.log')
        return next(one.stamp for one in self.robot.heard[heard:] if one.topic == CAMERA and one.stamp)

    def restart_sender(self) -> None:
        """Start robot_sender again over a good link, so that it knows nothing of the link before, and wait for an
        image. Of our own methods only.
        """
        self.stack.end(self._sender)
        self.set_link(RATES[0], 0.0)
        begun = time.time()
        self._sender = self.stack.start_node('robot', 'robot_sender', *(self.method.robot or ()))
        if not self.operator.first([self.method.image_topic], START_TIMEOUT,
                                   lambda heard: heard.stamp is not None and heard.stamp > begun):
            raise RuntimeError('no image arrives of a new robot_sender: see nodes.log')

    def set_link(self, rate: float, loss: float, **conditions: float) -> None:
        """Change the link; rate [bit/s], loss 0..1, and other values of LinkConditions."""
        self.stack.lab.set(vars(LinkConditions(**{
            'rate': rate, 'loss': loss, 'delay': DELAY, 'queue': QUEUE, **conditions})))

    def measure(self, loss: float, seconds: float, rates: Sequence[float] = RATES,
                **conditions: float) -> List[Step]:
        """Go through steps of the rate [bit/s]; other parameters: see set_link."""
        steps = []
        for rate in rates:
            self.set_link(rate, loss, **conditions)
            begun = time.time()
            counts = [(begun, self.stack.lab.counts())]
            started = time.time()
            while time.time() < started + seconds:
                time.sleep(SAMPLE_PERIOD)
                counts.append((time.time(), self.stack.lab.counts()))
            steps.append(Step(rate, begun, time.time(), counts))
        return steps

    def measure_in_time(self, loss: float, seconds: float) -> List[Step]:
        """`measure` over new connections, from a place of the robot's course on; see on_time."""
        def prepare() -> None:
            self.set_link(RATES[0], 0.0)
            began = self.restart_robot()
            self.connect()
            time.sleep(max(0.0, began + COURSE - time.time()))
        return self.on_time(prepare, lambda: self.measure(loss, seconds))

    def on_time(self, prepare: Callable[[], None], measure: Callable[[], List[Step]]) -> List[Step]:
        """What is measured after some preparation; both are repeated where the emulated link itself was late, or lost
        packets.

        :raises LabBusy: where it lost some in the last attempt, too
        """
        def once() -> Tuple[List[Step], Dict[str, float]]:
            prepare()
            self._watch.forget()
            steps = measure()
            return steps, {**self._watch.state(), 'late p99 [ms]': 1e3 * max(step.lateness for step in steps)}
        return repeated(once, ATTEMPTS)[0]

    def recorded(self, side: str) -> Array:
        """The images that were heard on a side, see recorder.load."""
        return recorder.load(self._files[side])


def queue_delay(before: Counts, after: Counts, share: float, side: str = 'robot') -> Optional[int]:
    """A quantile of the time that packets waited for the air between two samples [ms]; None: there were no packets."""
    waits = {ms: count - before['waited'][side].get(ms, 0) for ms, count in after['waited'][side].items()}
    each = np.repeat(list(waits), list(waits.values()))
    return int(np.sort(each)[max(0, math.ceil(share * len(each)) - 1)]) if len(each) else None


def link_row(step: Step) -> Row:
    """What the link carried and dropped of what the robot sent, for a row of a CSV file."""
    (first, steady), (_, settled), (last, end) = step.sample(STEADY), step.sample(SETTLED), step.counts[-1]
    a, b = steady['robot'], end['robot']
    entered = b['offered'] - a['offered'] - (b['dropped'] - a['dropped'])
    return {'used [%]': round(100 * 8 * (b['carried'] - a['carried']) / (last - first) / step.rate, 1),
            'queue p50 [ms]': queue_delay(steady, end, 0.5), 'queue p95 [ms]': queue_delay(steady, end, 0.95),
            'dropped': b['dropped'] - settled['robot']['dropped'],
            'air lost [%]': round(100 * (b['lost'] - a['lost']) / max(1, entered), 2),
            'late p99 [ms]': round(1e3 * step.lateness, 1)}


def flow_row(step: Step) -> Row:
    """How the robot's datagrams (UDP) and its TCP connections shared the link, for a row of a CSV file."""
    (first, before), (last, after) = step.sample(STEADY), step.counts[-1]

    def growth(flow: str, key: str) -> int:
        a, b = (counts['flows']['robot'].get(flow, {}).get(key, 0) for counts in (before, after))
        return int(b - a)
    ours, theirs = (8 * growth(flow, 'carried') / (last - first) for flow in ('udp', 'tcp'))
    return {'used [%]': round(100 * ours / step.rate, 1), 'share [%]': round(100 * ours / max(1.0, ours + theirs), 1),
            'TCP [Mbit/s]': round(theirs / 1e6, 2),
            'own loss [%]': round(100 * growth('udp', 'dropped') / max(1, growth('udp', 'offered')), 2)}


def message_row(sent: Sequence[Heard], arrived: Sequence[Heard], step: Step, topics: Tuple[str, str]) -> Row:
    """How many messages of a topic were lost, and how old those were that arrived, for a row of a CSV file.

    :param sent, arrived: heard on the robot's and on the operator's side
    :param topics: on the two sides
    """
    since = step.begun + STEADY
    stamps = {heard.stamp for heard in sent if heard.topic == topics[0] and since <= heard.arrival < step.ended - 0.5}
    found = [heard for heard in arrived if heard.topic == topics[1] and heard.stamp in stamps]
    count = len({heard.stamp for heard in found})   # a transform's stamp may come twice
    p99 = percentile([heard.age for heard in found], 99)
    return {'left': len(stamps), 'lost [%]': round(100 * (1 - count / len(stamps)), 2) if stamps else None,
            'age p99 [ms]': None if p99 is None else round(1e3 * p99)}


def percentile(values: Sequence[float], percent: float) -> Optional[float]:
    """A percentile that is one of the values; None: there are none."""
    return one_of.percentile(values, percent) if values else None


class DisplayHistory:
    """What the operator saw, and what the camera saw, at any time until now; times by time.time() [s]."""

    def __init__(self, run: RateStepRun) -> None:
        sent, arrived = list(run.robot.heard), list(run.operator.heard)
        # after that: an image is recorded before it is heard
        self._truths, self._images = run.recorded('robot'), run.recorded('operator')
        camera = [heard for heard in sent if heard.topic == CAMERA]
        self._camera_stamps = [heard.stamp or 0.0 for heard in camera]
        self._camera_indexes = [int(heard.amount) for heard in camera]
        self._index_of: Mapping[Optional[float], int] = dict(zip(self._camera_stamps, self._camera_indexes))
        self.arrived = [heard for heard in arrived if heard.topic == run.method.image_topic]
        self._arrivals = [heard.arrival for heard in self.arrived]

    def truth(self, when: float) -> Array:
        """The last image of the camera [count]."""
        at = bisect.bisect(self._camera_stamps, when) - 1
        image: Array = self._truths[self._camera_indexes[max(at, 0)]]
        return image

    def shown(self, when: float) -> Optional[Array]:
        """The last image that arrived [count]; None before the first one."""
        at = bisect.bisect(self._arrivals, when) - 1
        return self._images[self.arrived[at].amount] if at >= 0 else None

    def age(self, when: float) -> Optional[float]:
        """The age of the image that is shown; None before the first image [s]."""
        at = bisect.bisect(self._arrivals, when) - 1
        stamp = self.arrived[at].stamp if at >= 0 else None
        return None if stamp is None else when - stamp

    def psnr(self, when: float) -> Optional[float]:
        """The PSNR of the image that is shown, compared with what the camera sees, in grey levels; None before the
        first image [dB]."""
        shown = self.shown(when)
        return None if shown is None else psnr(recorder.to_grey(self.truth(when)), recorder.to_grey(shown))

    def exact(self, heard: Heard) -> bool:
        """Whether an image that arrived is what the camera saw, bit for bit."""
        at = self._index_of.get(heard.stamp)
        return at is not None and np.array_equal(self._truths[at], self._images[heard.amount])

    def error(self, heard: Heard) -> float:
        """The rms error of an image that arrived, compared with the camera's of its stamp [count]; NaN: that was not
        heard."""
        at = self._index_of.get(heard.stamp)
        difference = np.nan if at is None else self._images[heard.amount].astype(float) - self._truths[at]
        return float(np.sqrt(np.square(difference).mean()))

    def row(self, begun: float, ended: float) -> Row:
        """Rate, ages and quality within a time, for a row of a CSV file."""
        arrived = [heard for heard in self.arrived if begun <= heard.arrival < ended]
        ages = [heard.age for heard in arrived]
        p50, p99 = percentile(ages, 50), percentile(ages, 99)
        qualities = [quality for quality in map(self.psnr, np.arange(begun, ended, SAMPLED)) if quality is not None]
        return {'pictures [Hz]': round(len(arrived) / (ended - begun), 2),
                'exact [%]': round(100 * float(np.mean([self.exact(heard) for heard in arrived])), 1) if arrived
                else None,
                'rms error [count]': round(float(np.nanmedian([self.error(heard) for heard in arrived])), 1) if arrived
                else None,
                'age p50 [ms]': None if p50 is None else round(1e3 * p50),
                'age p99 [ms]': None if p99 is None else round(1e3 * p99),
                'PSNR [dB]': round(float(np.mean(qualities)), 2) if qualities else None}
