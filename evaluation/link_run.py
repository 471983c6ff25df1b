# SPDX-License-Identifier: BSD-3-Clause
"""Images and clouds over an emulated link, by one of several methods at a time.

On the robot's side run sensor_source and robot_sender, on the operator's side operator_receiver and a listener. They
keep running while the link changes. Both sides have one clock, so a message's age is exact.
"""
import contextlib
import os
import pathlib
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Sequence, Set, Tuple, TypeVar

import numpy as np

from smokebot_udp.link_lab.channel import LinkConditions
from smokebot_udp.link_lab.lab import Lab
from smokebot_udp.link_lab.link_trace import SIDES

from . import TOP
from .listener import Heard, Listener, Subscription
from .one_of import percentile
from .stack import Stack
from .started import Started

Measured = TypeVar('Measured')

AIR = {'rate': 54e6, 'queue': 0.1}
"""Conditions of all links here, in both directions: 802.11g's nominal rate [bit/s], and its queue [s]."""

SETTLE, QUICK_SETTLE = 1.5, 0.8
"""What arrives within this time after a change of the link does not count: the sender adapts to it [s]."""

MAX_LATENESS = 0.02
"""Where p99 of the delay that the lab itself adds is higher, the machine was busy: the measurement is repeated [s]."""

ATTEMPTS = 3


@dataclass
class Method:
    """A way of sending."""
    source: str
    """Topic that sensor_source publishes."""
    subscriptions: List[Subscription]
    """Subscriptions on the operator's side."""
    warm_up: float = 0.0
    """Time that nodes need after their first message of this method until they send as it says [s]."""


LOAD_CODEC = 8.0
"""Both sides load the compiled codec of layered images with the first image; until then, images cross interleaved [s].
"""

IMAGE_METHODS = {
    'smokebot_udp, interleaved': Method('camera/image_raw', [['operator/camera/image_raw', 'image', 'TCPROS']]),
    'smokebot_udp, layered': Method('layered/image_raw', [['operator/layered/image_raw', 'image', 'TCPROS']],
                                    LOAD_CODEC),
    'JPEG over TCPROS': Method('whole/jpeg', [['whole/jpeg', 'jpeg', 'TCPROS']]),
    'JPEG over UDPROS': Method('whole/jpeg', [['whole/jpeg', 'jpeg', 'UDPROS']]),
    'raw over TCPROS': Method('whole/raw', [['whole/raw', 'image', 'TCPROS']]),
    'raw over UDPROS': Method('whole/raw', [['whole/raw', 'image', 'UDPROS']]),
}
"""{name: Method} of images of 640 x 480, mono8"""


class LabBusy(RuntimeError):
    """The lab itself lost packets, so that no measurement counts."""


class LabWatch:
    """Watches a lab and the machine."""

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self._missed = 0

    def state(self) -> Dict[str, float]:
        """Since the last call, for a row of a CSV file.

        :raises LabBusy: where the lab itself lost packets
        """
        statistics = self.lab.statistics()
        before, self._missed = self._missed, sum(statistics[side]['missed'] for side in SIDES)
        if self._missed > before:
            raise LabBusy('the lab itself lost %d packets: the machine is too busy' % (self._missed - before))
        return {'late p99 [ms]': round(1e3 * statistics['late'].get('p99', 0.0), 2),
                'load': round(os.getloadavg()[0], 1)}

    def forget(self) -> None:
        """What came before is no part of the next `state`."""
        with contextlib.suppress(LabBusy):
            self.state()


def lab_state(lab: Lab) -> Dict[str, float]:
    """The state of a lab since its start, but for `late`, which is since the last call.

    :raises LabBusy: where the lab itself lost packets
    """
    return LabWatch(lab).state()


def repeated(measure: Callable[[], Tuple[Measured, Dict[str, float]]],
             attempts: int = ATTEMPTS) -> Tuple[Measured, Dict[str, float]]:
    """What is measured, and the state of the lab with the number of attempts; repeated where the machine was busy.

    :param measure: what was measured, and lab_state
    :raises LabBusy: where the lab lost packets in the last attempt, too
    """
    attempt = 0
    while True:
        attempt += 1
        try:
            found, state = measure()
        except LabBusy:
            if attempt == attempts:
                raise
            continue
        if state['late p99 [ms]'] < 1e3 * MAX_LATENESS or attempt == attempts:
            return found, {**state, 'attempts': attempt}


class SensorSource:
    """The node sensor_source on the robot's side; it becomes a part of the stack."""

    def __init__(self, stack: Stack) -> None:
        process = stack.start('robot', sys.executable, '-m', 'evaluation.sensor_source', cwd=str(TOP),
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, universal_newlines=True)
        assert process.stdin is not None and process.stdout is not None
        self._stdin, self._stdout = process.stdin, process.stdout

    def wait(self) -> None:
        """Until it is ready.

        :raises RuntimeError: where it ends
        """
        if not self._stdout.readline():
            raise RuntimeError('the source ended: see nodes.log')

    def publish(self, topic: str) -> None:
        """Publish this topic only from now on; empty: none."""
        self._stdin.write(topic + '\n')
        self._stdin.flush()


class LinkRun(Started):
    """The link and the nodes; a context manager.

    :param seed: of the link
    :param log: file for the output of the nodes
    :param quick: whether to wait less after the link changed
    :param adapt: whether robot_sender's rate follows the link; otherwise it sends everything, as the other methods do
    :raises LabError: where there can be no emulated link
    """

    def __init__(self, seed: int, log: pathlib.Path, quick: bool = False, adapt: bool = False) -> None:
        super().__init__()
        self._settle = QUICK_SETTLE if quick else SETTLE
        self._warm: Set[str] = set()    # sources of the methods that were used
        self._stack = self.enter_context(Stack(seed, log=log))
        self.watch = LabWatch(self._stack.lab)
        with self.starting():
            self._start(adapt)

    def _start(self, adapt: bool) -> None:
        self._set_link({})
        streams = '_streams_file:=%s' % pathlib.Path(__file__).with_name('link_streams.yaml')
        self._source = SensorSource(self._stack)
        rate = [] if adapt else ['_adapt:=false', '_max_rate:=4000']
        self._stack.start_node('robot', 'robot_sender', streams, *rate)
        self._stack.start_node('operator', 'operator_receiver', streams)
        self.listener = Listener(self._stack)
        self._source.wait()

    def _set_link(self, conditions: Dict[str, float]) -> None:
        self._stack.lab.set({'loss': 0.0, 'burst': 0.0, 'delay': 0.0, **AIR, **conditions})

    def change(self, robot: LinkConditions, operator: LinkConditions) -> None:
        """Change both directions of the link, each named by its sender."""
        self._stack.lab.set(robot=vars(robot), operator=vars(operator))

    def use(self, method: Method, delay: float = 0.0, timeout: float = 30.0) -> None:
        """Send by this method only from now on, over a link without loss, and wait for its first messages.

        TCP connections are made again, so that they know nothing of the link before.

        :param delay: each way [s]
        :param timeout: [s]
        :raises RuntimeError: where a topic stays silent
        """
        self._set_link({'delay': delay})
        self._source.publish('')
        self.listener.subscribe(method.subscriptions)
        self._source.publish(method.source)
        topics = {topic for topic, *_ in method.subscriptions}
        missing = topics - set(self.listener.first(topics, timeout))
        if missing:
            raise RuntimeError('nothing arrives on %s over a good link: see nodes.log' % ', '.join(missing))
        if method.source not in self._warm:
            self._warm.add(method.source)
            time.sleep(method.warm_up)

    def measure(self, method: Method, seconds: float, loss: float,
                delay: float = 0.0) -> Tuple[List[Heard], Dict[str, float]]:
        """What arrives over a bad link, and the state of the lab, see `repeated`.

        :param loss: 0..1
        :param delay: each way [s]
        """
        def once() -> Tuple[List[Heard], Dict[str, float]]:
            self.use(method, delay)
            self._set_link({'delay': delay, 'loss': loss})
            time.sleep(self._settle)
            self.watch.forget()
            return self.listener.during(seconds), self.watch.state()
        return repeated(once)


def summary(heard: Sequence[Heard], seconds: float) -> Dict[str, Any]:
    """The rate and the ages of what arrived, for a row of a CSV file; without arrivals, the ages are None."""
    row: Dict[str, Any] = {'rate [Hz]': round(len(heard) / seconds, 2), 'age p50 [s]': None, 'age p99 [s]': None,
                           'amount': None}
    if heard:
        ages = [message.age for message in heard]
        row['age p50 [s]'] = round(float(np.median(ages)), 4)
        row['age p99 [s]'] = round(percentile(ages, 99), 4)
        row['amount'] = round(float(np.mean([message.amount for message in heard])), 4)
    return row
