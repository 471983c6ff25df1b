# SPDX-License-Identifier: BSD-3-Clause
"""Pictures and clouds across an emulated link, in one of several ways at a time.

On the robot's side run source.py and robot_sender, on the operator's side operator_receiver and link_lab's listener.
None is restarted: the link changes while they run. Both sides have one clock, so a message's age is what it is.
"""
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import List, Sequence

from smokebot_udp.link_lab.course import SIDES
from smokebot_udp.link_lab.listener import Listener
from smokebot_udp.link_lab.stack import Stack

from .runner import TOP

AIR = {'rate': 54e6, 'queue': 0.1}
"""Of all links here, in both directions: 802.11g's nominal rate [bit/s], and what may wait for it [s]."""

SETTLE, QUICK_SETTLE = 1.5, 0.8
"""What came so soon after the link changed does not count: the sender finds what it carries [s]."""

LATE = 0.02
"""Where one packet of a hundred left the link later than this, the machine was too busy: it is measured again [s]."""

ATTEMPTS = 3


@dataclass
class Way:
    """A way of sending."""
    source: str
    """The topic that source.py publishes."""
    wanted: List[Sequence[str]]
    """What the operator's side subscribes, [topic, kind, transport] each."""


PICTURES = {
    'smokebot_udp': Way('camera/image_raw', [['operator/camera/image_raw', 'image', 'TCPROS']]),
    'JPEG over TCPROS': Way('whole/jpeg', [['whole/jpeg', 'jpeg', 'TCPROS']]),
    'JPEG over UDPROS': Way('whole/jpeg', [['whole/jpeg', 'jpeg', 'UDPROS']]),
    'raw over TCPROS': Way('whole/raw', [['whole/raw', 'image', 'TCPROS']]),
    'raw over UDPROS': Way('whole/raw', [['whole/raw', 'image', 'UDPROS']]),
}
"""{way: Way}: pictures of 640 x 480, mono8"""


def lab_state(lab):
    """How a lab and the machine were since the last call, for a row of a CSV file.

    :raises RuntimeError: where the lab itself lost packets: nothing that was measured counts
    """
    told = lab.statistics()
    missed = sum(told[side]['missed'] for side in SIDES)
    if missed:
        raise RuntimeError('the lab itself lost %d packets: the machine is too busy' % missed)
    return {'late p99 [ms]': round(1e3 * told['late'].get('p99', 0.0), 2), 'load': round(os.getloadavg()[0], 1)}


class Crossing:
    """A context manager.

    :param run: runner.Run
    :param adapt: whether robot_sender's rate follows the link; else it sends all, as the other ways do
    :raises LabError: where there can be no emulated link
    """

    def __init__(self, run, adapt=False):
        self._settle = QUICK_SETTLE if run.quick else SETTLE
        self._stack = Stack(run.seed, log=run.folder / 'nodes.log')
        try:
            self._start(adapt)
        except BaseException:
            self._stack.close()
            raise

    def _start(self, adapt):
        self._link({})
        streams = '_streams_file:=%s' % (TOP / 'experiments' / 'streams.yaml')
        self._source = self._stack.start('robot', sys.executable, '-m', 'experiments.source', cwd=str(TOP),
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, universal_newlines=True)
        self._stack.start_node('robot', 'robot_sender', streams, '_adapt:=%s' % str(adapt).lower())
        self._stack.start_node('operator', 'operator_receiver', streams)
        self.listener = Listener(self._stack)
        if not self._source.stdout.readline():
            raise RuntimeError('the source ended: see nodes.log')

    def _link(self, quality):
        self._stack.lab.set({'loss': 0.0, 'burst': 0.0, 'delay': 0.0, **AIR, **quality})

    def change(self, robot, operator):
        """Change the link to two channel.Quality: of what the robot sends, and the operator."""
        self._stack.lab.set(robot=vars(robot), operator=vars(operator))

    def _send(self, topic):
        self._source.stdin.write(topic + '\n')
        self._source.stdin.flush()

    def use(self, way, delay=0.0, seconds=30.0):
        """Send in a way from now on, and by no other, over a link that loses nothing; until its first messages came.

        A TCP connection is made anew, so that it does not remember what the link was before.
        """
        self._link({'delay': delay})
        self._send('')
        self.listener.subscribe(way.wanted)
        self._send(way.source)
        topics = {topic for topic, *_ in way.wanted}
        missing = topics - set(self.listener.first(topics, seconds))
        if missing:
            raise RuntimeError('nothing comes on %s over a good link: see nodes.log' % ', '.join(missing))

    def state(self):
        """lab_state of this link."""
        return lab_state(self._stack.lab)

    def measure(self, way, seconds, loss, delay=0.0):
        """What comes in a way over a bad link: ([Heard, ...], `state`); again where the machine was busy."""
        attempt = 0
        while True:
            attempt += 1
            self.use(way, delay)
            self._link({'delay': delay, 'loss': loss})
            time.sleep(self._settle)
            self.state()
            heard = self.listener.during(seconds)
            state = self.state()
            if state['late p99 [ms]'] < 1e3 * LATE or attempt == ATTEMPTS:
                return heard, {**state, 'attempts': attempt}

    def close(self):
        self._stack.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def summary(heard, seconds):
    """The rate and the ages of what came, for a row of a CSV file: no age where nothing came."""
    ages = sorted(message.age for message in heard)
    return {'rate [Hz]': round(len(heard) / seconds, 2),
            'age p50 [s]': round(statistics.median(ages), 4) if ages else None,
            'age p99 [s]': round(ages[min(len(ages) - 1, int(0.99 * len(ages)))], 4) if ages else None,
            'amount': round(statistics.mean(message.amount for message in heard), 4) if heard else None}
