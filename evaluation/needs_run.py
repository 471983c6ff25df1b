# SPDX-License-Identifier: BSD-3-Clause
"""What single streams take of the processors and of the link: both nodes as shipped, own masters, a sealed link lab."""
import contextlib
import pathlib
import tempfile
import time
from typing import Any, Dict, List, Mapping, NamedTuple, Sequence

import psutil
import yaml

from smokebot_udp.link_lab.lab import DEVICE

from . import TOP
from .listener import Listener
from .own_masters import OwnMasters
from .started import Started

LINKS: Mapping[str, Dict[str, float]] = {
    'bad': {'loss': 0.2, 'delay': 0.02, 'rate': 2e6, 'queue': 0.2},
    'good': {'loss': 0.0, 'delay': 0.005, 'rate': 20e6, 'queue': 0.2}}
"""{name: conditions of link_lab, each way}: a Wi-Fi at the end of its range, and one nearby."""

SETTLE = 4.0
"""Time until the link is known [s]."""

START_TIMEOUT = 60.0
"""[s]"""

SENSORS = 'thermal', 'camera', 'lidar', 'scan', 'map', 'gas', 'battery'
"""Sensors of simulated_robot that can be switched off. Odometry and tf are always on."""


class Case(NamedTuple):
    """Streams of config/streams.yaml that run together."""
    title: str
    names: Sequence[str]
    sensors: Sequence[str] = ()
    """Sensors of SENSORS that the streams need."""
    arguments: Sequence[str] = ()
    """Further arguments of simulated_robot."""

    @property
    def robot(self) -> List[str]:
        """The arguments of simulated_robot."""
        return ['_%s_rate:=0' % name for name in SENSORS if name not in self.sensors] + list(self.arguments)


def stream_settings(names: Sequence[str]) -> Dict[str, Any]:
    """The settings of streams in the package's streams.yaml."""
    shipped = yaml.safe_load((TOP / 'config' / 'streams.yaml').read_text())['streams']
    return {name: shipped[name] for name in names}


def processor_time(process: int) -> float:
    """The processor time of a process and its children [s]."""
    total = 0.0
    for one in [psutil.Process(process), *psutil.Process(process).children(recursive=True)]:
        with contextlib.suppress(psutil.NoSuchProcess):
            times = one.cpu_times()
            total += times.user + times.system
    return total


def sent_bytes(text: str, device: str) -> int:
    """Bytes that a device has sent.

    :param text: of /proc/net/dev
    """
    return int(text.split(device + ':')[1].split()[8])


class NeedsRun(Started):
    """Both nodes and the simulated robot, started; a context manager.

    :param log: of the nodes
    :raises LabError: as Lab
    """

    def __init__(self, case: Case, seed: int, log: pathlib.Path) -> None:
        super().__init__()
        self._case = case
        with self.starting():
            self._start(seed, log)

    def _start(self, seed: int, log: pathlib.Path) -> None:
        folder = pathlib.Path(self.enter_context(tempfile.TemporaryDirectory()))
        self._stack = self.enter_context(OwnMasters(seed, log))
        settings = stream_settings(self._case.names)
        (folder / 'streams.yaml').write_text(yaml.safe_dump({'streams': settings}))
        file = '_streams_file:=%s' % (folder / 'streams.yaml')
        self._stack.start_node('robot', 'simulated_robot', '_seed:=%d' % seed, *self._case.robot)
        self._nodes = {'robot': self._stack.start_sender(file).pid, 'desk': self._stack.start_receiver(file).pid}
        # what a screen subscribes to: of images the views
        topics = [one.get('view_topic', one['operator_topic']) for one in settings.values()]
        self._shown, self._first = Listener(self._stack), topics[0]
        self._shown.subscribe([[topic, 'any', 'TCPROS'] for topic in topics])
        if not self._shown.first([self._first], START_TIMEOUT):
            raise RuntimeError('nothing comes of %s: see %s' % (self._case.title, log))

    def measure(self, link: str, seconds: float) -> Dict[str, Any]:
        """A row: what is taken on one of LINKS."""
        self._stack.lab.set(LINKS[link])
        time.sleep(SETTLE)
        begun, before, sent = time.monotonic(), self._times(), self._sent()
        heard = self._shown.during(seconds)
        elapsed = time.monotonic() - begun
        after, now = self._times(), self._sent()
        return {'stream': self._case.title, 'link': link,
                'sent [kbit/s]': 8e-3 * (now - sent) / elapsed,
                **{'%s [%%]' % side: 100 * (after[side] - before[side]) / elapsed for side in before},
                'shown [Hz]': sum(one.topic == self._first for one in heard) / elapsed}

    def _times(self) -> Dict[str, float]:
        return {side: processor_time(pid) for side, pid in self._nodes.items()}

    def _sent(self) -> int:
        """Bytes from the robot until now, with all headers."""
        done = self._stack.lab.run('robot', ['cat', '/proc/net/dev'], capture_output=True, text=True, check=True)
        return sent_bytes(done.stdout, DEVICE)
