# SPDX-License-Identifier: BSD-3-Clause
"""A soak over the link lab: the nodes of both sides, the faults that hit them, and what the operators see of them.

The parts: master, source (the simulated robot) and robot_sender on the robot's side; operator_receiver and, at times,
a second operator on the other one. A listener beside the operators reports what they show. Nothing is relaunched but
what the fault itself ended; only where a stream does not come back, all parts are started anew for the next round.
"""
import contextlib
import os
import pathlib
import subprocess
import sys
import threading
import time
import urllib.parse
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple

import psutil
import yaml

from smokebot_udp.link_lab.lab import MASTER
from smokebot_udp.streams import classified

from . import TOP
from .listener import Listener
from .named_stack import NamedStack
from .process_usage import Resources, lasting, resources
from .registrations import Registrations
from .robot_clock import RobotClock
from .soak import (
    GOES,
    KINDS,
    REBOOTS,
    SECOND_OPERATOR,
    SPARE,
    Fault,
    Stream,
    Usage,
    awaited,
    fresh,
    streams_of,
    surplus,
    usual,
)
from .started import Started

LINK = {'loss': 0.05, 'delay': 0.01, 'rate': 54e6, 'queue': 0.1}
"""5 % of the packets are lost in either direction; the rest is 802.11g's nominal rate."""

STREAMS = TOP / 'config' / 'streams.yaml'

SOURCE = '_width:=160', '_height:=120', '_lidar_rate:=5'
"""Small images: a soak tests what comes back, not how much."""

OURS = 'robot_sender', 'operator_receiver', SECOND_OPERATOR
"""The package's nodes, which are judged."""

NODES = ('source', *OURS)
"""All nodes. The source stands for the drivers of the robot: it is plain rospy, where a subscriber that connects before
its publisher has a queue_size gets a connection without a thread."""

START, RECOVERY = 120.0, 40.0
"""A part registers within the first time after it was started, and a stream that is not fresh within the second after
that does not come back [s]."""

SETTLING = 20.0
"""Time within which threads and descriptors have to be as before, counted from when all streams are fresh [s]."""

WINDOW, WINDOW_INTERVAL = 10, 0.2
"""Number of samples; what is in all of them counts. And the interval between them [s]."""

GOODBYE = 15.0
"""A node that is asked to end is killed after this time [s]."""

SAMPLING = 2.0
"""Interval between samples of the resources [s]."""

FLOOD = 'evaluation.hostile_flood'
"""The program of a stranger."""

CALL_RATE = 170.0
"""Hostile calls a second."""

DESK = '/desk2'
"""Goes before the topics of the second operator."""


class Round(NamedTuple):
    """What one fault did."""
    fault: Fault
    at: float
    """When it began, from the start of the soak [s]."""
    registered: Optional[float]
    """From the fault's end to the registration of the last part that was started; None: it did not register [s]."""
    waits: Dict[str, Optional[float]]
    """{stream: from the last part's registration (without one, the fault's end) until it is fresh; None: never} [s]"""
    unequal: str
    """Nodes that have more threads or descriptors than usually with these parts, see soak.surplus."""
    died: List[str]
    """Parts that ended by themselves."""
    load: float

    @property
    def wait(self) -> Optional[float]:
        """Until every stream was fresh; None: one did not come back [s]."""
        waits = [wait for wait in self.waits.values() if wait is not None]
        return max(waits) if len(waits) == len(self.waits) else None

    @property
    def slowest(self) -> str:
        """The streams that did not come back, else the one that came last."""
        missing = [stream for stream, wait in self.waits.items() if wait is None]
        return ' '.join(missing) or max(self.waits, key=lambda stream: self.waits[stream] or 0.0)


class Sample(NamedTuple):
    """A node's resources at a time."""
    at: float
    """From the start of the soak [s]."""
    node: str
    process: int
    usage: Usage


class Soak(Started):
    """The parts, and what they do; a context manager.

    :param folder: for files and the nodes' output
    :param seed: of the link
    :raises LabError: where there can be no emulated link
    :raises FileNotFoundError: without libfaketime
    """

    def __init__(self, folder: pathlib.Path, seed: int) -> None:
        super().__init__()
        self._clock = RobotClock(folder / 'clock')
        self._stack = self.enter_context(NamedStack(folder, seed, folder / 'nodes.log'))
        self._begun = time.time()
        self.samples: List[Sample] = []
        self._parts: Dict[str, Any] = {'master': self._stack.masters['robot']}
        self._listener: Optional[Listener] = None
        self._settled: Dict[Tuple[str, ...], List[Dict[str, Usage]]] = {}       # by the parts that ran
        self._gone: Set[str] = set()            # addresses that the operator's machine had
        self._ended = threading.Event()
        self.callback(self._ended.set)
        with self.starting():
            self._start(folder)

    def _start(self, folder: pathlib.Path) -> None:
        config = classified(yaml.safe_load(STREAMS.read_text())['streams']).streams
        second = {name: {**settings, 'operator_topic': DESK + settings['operator_topic']}
                  for name, settings in config.items()}
        self._second_file = folder / 'second_streams.yaml'
        self._second_file.write_text(yaml.safe_dump({'streams': second}))
        self._streams = streams_of(config, 'operator_receiver') + streams_of(second, SECOND_OPERATOR)
        self._stack.lab.set(LINK)
        self._registrations = Registrations(self._stack, NODES)
        missing = self._relaunch(['source', 'robot_sender', 'operator_receiver'])
        if missing:
            raise RuntimeError('nothing arrives on %s: see nodes.log' % ', '.join(missing))
        self._settle()
        threading.Thread(target=self._sample, daemon=True).start()

    def _command(self, part: str) -> Tuple[str, List[str], Dict[str, str]]:
        """(side, what is started by rosrun, environment) of a node."""
        return {
            'source': ('robot', ['simulated_robot', *SOURCE], self._clock.environment),
            'robot_sender': ('robot', ['robot_sender', '_streams_file:=%s' % STREAMS], self._clock.environment),
            'operator_receiver': ('operator', ['operator_receiver', '_streams_file:=%s' % STREAMS], {}),
            SECOND_OPERATOR: ('operator', [
                'operator_receiver', '_streams_file:=%s' % self._second_file, '_odom_topic:=%s/operator/odom' % DESK,
                '_stale_topic:=%s/operator/stale' % DESK], {}),
        }[part]

    def _start_part(self, part: str) -> None:
        if part == 'master':
            self._parts[part] = self._stack.start_master()
            return
        side, command, variables = self._command(part)
        self._parts[part] = self._stack.start(side, 'env', *('%s=%s' % item for item in variables.items()), 'rosrun',
                                              'smokebot_udp', *command, '__name:=' + part)

    def _kill(self, part: str) -> None:
        self._stack.end(self._parts.pop(part))

    def _relaunch(self, parts: Sequence[str]) -> List[str]:
        """Start parts and the listener, those that run from anew; the topics of the streams that do not come."""
        for part in parts:
            if part in self._parts:
                self._kill(part)
        if self._listener is not None:
            self._stack.end(self._listener.process)
        end = time.time()
        if 'master' in parts:
            self._start_part('master')
        self._listener = Listener(self._stack)
        self._listener.subscribe([[stream.topic, 'any', 'TCPROS'] for stream in self._streams], timeout=60)
        for part in parts:
            if part != 'master':
                self._start_part(part)
        return [stream.topic for stream, arrival in self._await(parts, end).items() if arrival is None]

    def _await(self, restarted: Sequence[str], end: float) -> Dict[Stream, Optional[float]]:
        """When each awaited stream is fresh after a fault that ended at this time."""
        wanted = awaited((stream for stream in self._streams if stream.operator in self._parts), restarted)
        assert self._listener is not None
        while True:
            found = fresh(list(self._listener.heard), wanted, end, self._clock.offset)
            registered = self._registrations.last(restarted, end)
            late = time.time() > (end + START if registered is None else registered + RECOVERY)
            if late or (len(found) == len(wanted) and registered is not None):
                return {stream: found.get(stream) for stream in wanted}
            time.sleep(0.1)

    def _resources(self) -> Dict[str, Resources]:
        """{node: its resources}, of those that run."""
        states = self._registrations.states
        nodes = states[-1].nodes if states else {}
        master = urllib.parse.urlparse(MASTER).port
        found = {}
        for part in NODES:
            process = self._parts.get(part)
            if process is not None:
                port = urllib.parse.urlparse(nodes[part].uri).port if part in nodes else None
                with contextlib.suppress(OSError, psutil.Error):    # killed meanwhile
                    found[part] = resources(process.pid, port, master, self._gone)
        return found

    def _sample(self) -> None:
        while not self._ended.wait(SAMPLING):
            for part, found in self._resources().items():
                process = self._parts.get(part)
                if process is not None:
                    self.samples.append(Sample(time.time() - self._begun, part, process.pid, lasting([found])))

    def _settle(self) -> str:
        """Wait until threads and descriptors of our nodes are as they usually are with these parts; see soak.surplus.

        The first time with these parts, those numbers are usual that stay from one window to the next.
        """
        rounds = self._settled.setdefault(tuple(sorted(self._parts)), [])
        end = time.time() + SETTLING
        found: Dict[str, Usage] = {}
        while True:
            samples = []
            for _ in range(WINDOW):
                time.sleep(WINDOW_INTERVAL)
                samples.append(self._resources())
            before, found = found, {node: lasting([sample[node] for sample in samples]) for node in OURS
                                    if all(node in sample for sample in samples)}
            expected = usual(rounds) or before
            if (expected and not surplus(expected, found) and not surplus(found, expected)) or time.time() > end:
                rounds.append(found)
                return surplus(expected, found, SPARE)

    def round(self, fault: Fault) -> Round:
        """Let a fault happen, and wait for what comes back."""
        assert self._listener is not None
        del self._listener.heard[:len(self._listener.heard)]
        begun = time.time()
        actions: Dict[str, Callable[[Fault], None]] = {
            'link cut': self._cut, 'address changed': self._change_address,
            GOES: self._say_goodbye,
            'clock stepped': lambda fault: self._clock.step(fault.step), 'hostile flood': self._flood}
        restarted = KINDS[fault.kind].restarts
        if restarted:
            end = self._restart(fault, restarted)
        else:
            actions[fault.kind](fault)
            end = time.time()
        arrivals = self._await(restarted, end)
        registered = self._registrations.last(restarted, end)
        counted = end if registered is None else registered
        names = {stream: stream.name if stream.operator == 'operator_receiver' else 'desk2 ' + stream.name
                 for stream in arrivals}
        waits = {names[stream]: None if arrival is None else max(0.0, arrival - counted)
                 for stream, arrival in arrivals.items()}
        result = Round(fault, begun - self._begun, None if registered is None else registered - end, waits,
                       self._settle(), self._died(), os.getloadavg()[0])
        if result.wait is None or result.died:
            self._relaunch(list(self._parts))
        return result

    def _restart(self, fault: Fault, parts: Sequence[str]) -> float:
        """Kill parts and start them again; the time of their start.

        A robot that reboots says goodbye to nobody: the link is cut meanwhile, so that no TCP connection is closed.
        """
        if fault.kind == REBOOTS:
            self._stack.lab.set({**LINK, 'loss': 1.0})
        for part in parts:
            if part in self._parts:     # the second operator comes
                self._kill(part)
        time.sleep(fault.seconds)
        self._stack.lab.set(LINK)
        end = time.time()
        for part in parts:
            self._start_part(part)
        return end

    def _died(self) -> List[str]:
        return [part for part, process in self._parts.items() if process.poll() is not None]

    def _say_goodbye(self, _: Fault) -> None:
        """The second operator's node is ended in order: it unregisters."""
        process = self._parts[SECOND_OPERATOR]
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GOODBYE)
        self._kill(SECOND_OPERATOR)

    def _change_address(self, _: Fault) -> None:
        self._gone.add(self._stack.operator_address)
        self._stack.change_address()
        self._gone.discard(self._stack.operator_address)

    def _cut(self, fault: Fault) -> None:
        self._stack.lab.set({**LINK, 'loss': 1.0})
        time.sleep(fault.seconds)
        self._stack.lab.set(LINK)

    def _flood(self, fault: Fault) -> None:
        """Hostile calls to the nodes of both sides, from the operator's side."""
        nodes = ['/' + node for node in NODES if node in self._parts and node != 'source']
        flood = self._stack.start('operator', sys.executable, '-m', FLOOD, '--seconds', str(fault.seconds), '--calls',
                                  str(int(fault.seconds * CALL_RATE)), *nodes, cwd=str(TOP))
        with contextlib.suppress(subprocess.TimeoutExpired):
            flood.wait(fault.seconds + 10)
        self._stack.end(flood)
