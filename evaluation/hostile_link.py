# SPDX-License-Identifier: BSD-3-Clause
"""A sealed link between own masters under attack: what the operator sees meanwhile, and what it costs the nodes.

The robot has two addresses, over two links at once. A stranger at each end of both hears everything that crosses, and
sends to that end, see link_attack. Beside it, an operator with
another key tries to join. Memory grows where nodes keep more of it than ever before, see kept_memory.
"""
import functools
import json
import pathlib
import sys
import threading
import time
from dataclasses import dataclass
from typing import Callable, Dict, List, Mapping, Tuple

import numpy as np

from smokebot_udp.link.keys import make_key
from smokebot_udp.link_lab.lab import ADDRESSES as HOSTS
from smokebot_udp.link_lab.lab import DEVICE
from smokebot_udp.link_lab.second_link import SECOND, SECOND_DEVICE, second_lab

from . import TOP
from .kept_memory import KEPT, KeptMemory
from .link_run import AIR
from .listener import Listener
from .own_masters import RECEIVER, ROBOT, OwnMasters
from .path_cuts import ADDRESSES
from .polling import wait_for
from .processes import Peer
from .started import Started

SIDES = 'robot', 'operator'
DEVICES = DEVICE, SECOND_DEVICE
LINK = {**AIR, 'delay': 0.01}
IMAGE = '/operator/thermal/image_raw'
IMAGE_RATE = 10.0
"""Rate of the source's images [Hz]."""

STARTING = 60.0
RECORDING = 15.0
"""Time for which a stranger keeps what it hears, from before the handshake on [s]."""

SLOWEST = 1000.0
"""Minimum rate of an attack. An attack that takes longer than at this rate is given up [1/s]."""


FLOODS = {'flood of the %s, %s link' % (side, name): (side, device)
          for side in SIDES for name, device in zip(('first', 'second'), DEVICES)}
"""{name: side and device}."""

QUIET = 5.0
"""[s]"""

REFUSAL = 'refused: wrong key'
"""Reason that the robot's node reports."""


@dataclass
class Phase:
    """One attack, or none."""
    name: str
    seconds: float
    rate: float
    """Rate of the images that arrived [Hz]."""
    age: float
    """Age of images at p99; NaN: none came [s]."""
    growth: Dict[str, float]
    """{side: memory that its node keeps, more than ever before [byte]}"""
    sent: Dict[str, int]
    """{kind: number of datagrams of the stranger}"""
    dropped: Dict[str, int]
    """{reason: number of datagrams, more than before} of the side that was attacked."""


class HostileLink(Started):
    """Both sides and the stranger; a context manager.

    :param folder: for files
    :param count, rate: of bad datagrams to each side, and a second
    :param half_open: number of handshakes that are not ended
    :param kept: see kept_memory [s]
    :raises LabError: as Lab
    """

    def __init__(self, folder: pathlib.Path, count: int, rate: float, half_open: int, seed: int = 1,
                 kept: float = KEPT) -> None:
        super().__init__()
        self._folder, self._kept, self._timeout = folder, kept, max(count, half_open) / SLOWEST + STARTING
        self.stack = self.enter_context(OwnMasters(seed, folder / 'nodes.log'))
        self._options = ['--count', str(count), '--rate', str(rate), '--half-open', str(half_open)]
        self.second = self.enter_context(second_lab(self.stack.lab, seed + 1))
        self._strangers: Dict[Tuple[str, str], Peer] = {}       # by side and device
        with self.starting():
            self._start()

    def _start(self) -> None:
        for link in (self.stack.lab, self.second):
            link.set(LINK)
        self.stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
        self._listener = Listener(self.stack)
        self._listener.subscribe([[IMAGE, 'any', 'TCPROS']])
        self._listeners = {'robot': Listener(self.stack, 'robot'), 'operator': Listener(self.stack)}
        for listener in self._listeners.values():
            listener.subscribe([['/diagnostics', 'link transport', 'TCPROS']])
        for device, address in zip(DEVICES, ADDRESSES):
            self._strangers['robot', device] = self._stranger('robot', device, address)
        recordings = self._record('robot', RECORDING)
        nodes = {'robot': self.stack.start_sender(), 'operator': self.stack.start_receiver(robot=','.join(ADDRESSES))}
        if not self._listener.first([IMAGE], STARTING):
            raise RuntimeError('no image comes: see nodes.log')
        self._memory = KeptMemory({side: node.pid for side, node in nodes.items()}, self._kept)
        for recording in recordings:
            recording.join()
        self.replayed = self._replay()
        """What the robot dropped when it got the recorded handshake again: soon, as its cookie is good for a minute."""
        for device, host in zip(DEVICES, (HOSTS['operator'], SECOND['operator'])):
            self._strangers['operator', device] = self._stranger('operator', device, '%s:%d' % (host, self._port()))
        for recording in self._record('operator', 5.0):
            recording.join()

    def _record(self, side: str, seconds: float) -> List[threading.Thread]:
        """Let a side's strangers keep what they hear."""
        threads = [threading.Thread(target=self._strangers[side, device].ask, args=('record %g' % seconds,))
                   for device in DEVICES]
        for thread in threads:
            thread.start()
        return threads

    def _stranger(self, side: str, device: str, to: str) -> Peer:
        command = [sys.executable, '-m', 'evaluation.link_attack', '--to', to, '--device', device, *self._options]
        with (self._folder / 'stranger.log').open('ab') as log:
            peer = Peer(self.stack.lab.command(side, command), cwd=str(TOP), stderr=log)
        self.callback(peer.close)
        assert peer.line() == 'ready'
        return peer

    def _port(self) -> int:
        """The operator's UDP port."""
        table = pathlib.Path('/proc/%d/net/udp' % self.stack.masters['operator'].pid).read_text().splitlines()[1:]
        ports = [int(line.split()[1].split(':')[1], 16) for line in table]
        if len(ports) != 1:
            raise RuntimeError('the operator has the UDP ports %s, must be one' % ports)
        return ports[0]

    def _dropped(self, side: str) -> Dict[str, int]:
        """What a side's node reports to have dropped, by reason."""
        heard = self._listeners[side].heard
        values: Dict[str, str] = next((each.amount for each in heard[::-1] if each.amount), {})
        return {key.split(', ', 1)[1]: int(value) for key, value in values.items() if key.startswith('dropped, ')}

    def _newly_dropped(self, side: str, before: Mapping[str, int]) -> Dict[str, int]:
        return {reason: count - before.get(reason, 0) for reason, count in self._dropped(side).items()
                if count > before.get(reason, 0)}

    def watch(self, name: str, side: str, attack: Callable[[], Dict[str, int]]) -> Phase:
        """Watch while a side is attacked.

        :param attack: returns what was sent, as of Phase
        """
        began = time.monotonic()
        before, heard = self._dropped(side), len(self._listener.heard)
        memory = self._memory.since(0.0)
        sent = attack()
        took, images = time.monotonic() - began, self._listener.heard[heard:]
        time.sleep(self._memory.kept)   # diagnostics come, too
        growth = {each: after - memory[each] for each, after in self._memory.since(began).items()}
        age = float(np.percentile([image.age for image in images], 99)) if images else float('nan')
        return Phase(name, took, len(images) / took, age, growth, sent, self._newly_dropped(side, before))

    def phases(self) -> List[Phase]:
        """All attacks, one after the other, with quiet before and after."""
        self._memory.await_steady()     # nodes load codecs and fill caches at first: that is no growth
        return [self.watch('quiet', 'robot', quiet), self.watch('half-open handshakes', 'robot', self._half_open),
                *(self.watch(name, side, functools.partial(self._ask, side, 'flood', device))
                  for name, (side, device) in FLOODS.items()),
                self.watch('uninvited operator', 'robot', self._uninvited), self.watch('quiet again', 'robot', quiet)]

    def _half_open(self) -> Dict[str, int]:
        return self._ask('robot', 'half-open', DEVICE)

    def _ask(self, side: str, command: str, device: str) -> Dict[str, int]:
        sent: Dict[str, int] = json.loads(self._strangers[side, device].ask(command, self._timeout))
        return sent

    def _replay(self) -> Dict[str, int]:
        before = self._dropped('robot')
        for device in DEVICES:      # an INIT goes where the COOKIE came from last
            self._ask('robot', 'replay', device)
        return wait_for(lambda: self._newly_dropped('robot', before), STARTING) or {}

    def _uninvited(self) -> Dict[str, int]:
        """An operator with another key, until it was refused."""
        other, before = self._folder / 'other.key', self._dropped('robot')
        make_key(str(other))
        heard = Listener(self.stack)
        heard.subscribe([['/other' + IMAGE, 'any', 'TCPROS']])
        node = self.stack.start_node('operator', RECEIVER, '_robot:=' + ROBOT, '__ns:=/other', '_key_file:=%s' % other)
        wait_for(lambda: REFUSAL in self._newly_dropped('robot', before), STARTING)
        time.sleep(QUIET)
        self.stack.end(node)
        if heard.heard:
            raise RuntimeError('an uninvited operator sees images')
        return {}


def quiet() -> Dict[str, int]:
    """No attack."""
    time.sleep(QUIET)
    return {}
