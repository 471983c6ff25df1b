# SPDX-License-Identifier: BSD-3-Clause
"""How long an image is in each stage between the robot's topic and the operator's screen.

A source publishes images of 640 x 480 pixels and 16 bits, robot_sender and operator_receiver carry them over loopback,
a sink subscribes the images and their view. The last cases are of both nodes' default settings, where the operator's
side drops datagrams on arrival. Both nodes mark when an image passes a point (monitoring/stages.py).
"""
import contextlib
import json
import os
import pathlib
import sys
import tempfile
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from evaluation import TOP
from evaluation.processes import Master, Peer, end, start
from smokebot_udp.monitoring.stages import BUDGET, DRAWN, SEEN, STAMPED, Mark, Stages, read_marks
from smokebot_udp.nodes.trace import VARIABLE

from .end_to_end import NODES, PEER, TIMEOUT
from .end_to_end_peer import Entry

SECONDS, QUICK_SECONDS = 10.0, 4.0
RATE = 10.0
"""[Hz]"""

WARM_UP, SETTLING, CONNECT_TIMEOUT = 3.0, 14.0, 60.0
"""The codec is loaded, and compiled where it never was; with the default settings the link is measured, too [s]."""

SOURCE, SHOWN, VIEW = '/in/image', '/operator/image', '/view/image'
STREAM = 'image'

UNPACED = '_adapt:=false', '_max_rate:=0'


class Case(NamedTuple):
    """Settings of the stream and of robot_sender."""
    title: str
    coding: str
    arguments: Tuple[str, ...] = UNPACED
    goals: Mapping[str, Tuple[float, float]] = {}
    """{stage: (p50, p99) at most [s]}"""
    loss: float = 0.0
    """Packet-loss ratio that the operator's side emulates on reception, independent."""
    warm_up: float = WARM_UP
    """[s]"""


CASES = [Case('interleaved', 'interleaved', goals={'age': (8e-3, 15e-3)}), Case('layered', 'layered'),
         *(Case('default, %d %% lost' % (100 * loss), 'auto', (), {'age': goal}, loss, SETTLING)
           for loss, goal in ((0.0, (8e-3, 15e-3)), (0.5, (15e-3, 30e-3)), (0.9, (25e-3, 60e-3))))]


class Nodes:
    """Both nodes between a source and a sink, at a master of their own; a context manager.

    :param folder: where streams.yaml and the marks are written
    """

    def __init__(self, case: Case, folder: pathlib.Path) -> None:
        self._case, self._streams, self._trace = case, folder / 'streams.yaml', folder / 'marks'
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> 'Nodes':
        with contextlib.ExitStack() as stack:
            self._start(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: Any) -> None:
        self._stack.close()

    def _start(self, stack: contextlib.ExitStack) -> None:
        self._streams.write_text(json.dumps({'streams': {STREAM: {     # JSON is YAML
            'type': 'image', 'robot_topic': SOURCE, 'operator_topic': SHOWN, 'view_topic': VIEW, 'rate': 2 * RATE,
            'coding': self._case.coding}}}))
        stack.enter_context(Master())
        environment = {**os.environ, VARIABLE: str(self._trace)}     # with the master's address
        for node, arguments in zip(NODES, (self._case.arguments, ('_loss:=%g' % self._case.loss,))):
            process = start([sys.executable, str(TOP / 'scripts' / node), '_streams_file:=%s' % self._streams,
                             *arguments], env=environment)
            stack.callback(end, process)
        self._source, self._sink = (self._peer(stack, *arguments) for arguments in (
            ('source', SOURCE), ('sink', SHOWN, VIEW)))

    @staticmethod
    def _peer(stack: contextlib.ExitStack, *arguments: str) -> Peer:
        peer = Peer([*PEER, *arguments])
        stack.callback(peer.close)
        assert json.loads(peer.line()) == 'ready'
        return peer

    def measure(self, seconds: float) -> Mapping[str, List[float]]:
        """How long the images were in each stage [s]."""
        _ask(self._source, 'start', {SOURCE: RATE})
        _ask(self._sink, 'wait', {'topics': [SHOWN], 'timeout': CONNECT_TIMEOUT}, CONNECT_TIMEOUT + TIMEOUT)
        time.sleep(self._case.warm_up)
        since = time.monotonic()
        time.sleep(seconds)
        until = time.monotonic()
        _ask(self._source, 'stop', None)
        arrived = _ask(self._sink, 'report', None)
        with open(str(self._trace), encoding='utf-8') as lines:
            return joined(read_marks(lines), arrived, time.time() - time.monotonic()).durations(STREAM, since, until)


def joined(marks: Iterable[Mark], arrived: Mapping[str, Sequence[Entry]], offset: float) -> Stages:
    """The marks of the nodes beside what the sink saw of the same images.

    :param arrived: {topic: entries}, see Sink.report
    :param offset: of ROS time from the steady clock [s]
    """
    stages, stamps = Stages(), {}
    for mark in marks:
        stages.add(mark)
        stamps[mark.stamp // 10 ** 9 + mark.stamp % 10 ** 9 / 1e9] = mark.stamp     # as Time.to_sec
    for topic, point in ((SHOWN, SEEN), (VIEW, DRAWN)):
        for stamp, age, _ in arrived.get(topic, ()):
            if stamp in stamps:
                stages.add(Mark(STREAM, stamps[stamp], STAMPED, stamp - offset))
                stages.add(Mark(STREAM, stamps[stamp], point, stamp - offset + age))
    return stages


def _ask(peer: Peer, name: str, argument: Any, timeout: float = 60.0) -> Any:
    return json.loads(peer.ask('%s %s' % (name, json.dumps(argument)), timeout))


def run(log: Callable[[str], None], quick: bool = False) -> List[Dict[str, Any]]:
    """[{'case', 'images', 'goals', 'stages': {stage: {'p50', 'p99'} or None [s]}}, ...]"""
    results = []
    for case in CASES:
        log('stages: %s' % case.title)
        with tempfile.TemporaryDirectory() as folder, Nodes(case, pathlib.Path(folder)) as nodes:
            durations = nodes.measure(QUICK_SECONDS if quick else SECONDS)
        results.append({'case': case.title, 'images': len(durations['age']), 'goals': case.goals,
                        'stages': {stage: summary(times) for stage, times in durations.items()}})
    return results


def summary(times: Sequence[float]) -> Optional[Dict[str, float]]:
    """{'p50', 'p99'} of some times; None: there are none."""
    if not times:
        return None
    p50, p99 = np.asarray(np.percentile(times, (50, 99))).tolist()
    return {'p50': p50, 'p99': p99}


def table(results: Sequence[Mapping[str, Any]]) -> str:
    """The results as text."""
    lines = ['an image of 640 x 480 x 16 bits in each stage, %g Hz over loopback: p50, p99 [ms]' % RATE, '',
             _row('', ['%s, %d' % (result['case'], result['images']) for result in results])]
    for stage, _, _ in BUDGET:
        lines.append(_row(stage, [_cell(result['stages'][stage]) for result in results]))
        goals = [result['goals'].get(stage) for result in results]
        if any(goals):
            lines.append(_row('  goal, at most', [_cell(goal and dict(zip(('p50', 'p99'), goal))) for goal in goals]))
    return '\n'.join(lines)


def _cell(times: Optional[Mapping[str, float]]) -> str:
    return '-' if times is None else '%.1f %6.1f' % (1e3 * times['p50'], 1e3 * times['p99'])


def _row(title: str, cells: Iterable[str]) -> str:
    return ('%-22s' % title + ''.join('%24s' % cell for cell in cells)).rstrip()
