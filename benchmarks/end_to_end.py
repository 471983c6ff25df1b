# SPDX-License-Identifier: BSD-3-Clause
"""From the robot's topics to the operator's, through running nodes: CPU of each side, ages and losses.

A source publishes, a sink subscribes; between them are robot_sender and operator_receiver, or an alternative: relays of
roscpp by TCPROS and by UDPROS, and JPEG as compressed_image_transport makes it. All methods run all the time, but only
one at a time gets messages; they take turns, so that a busy moment of the machine affects them all.
"""
import contextlib
import json
import pathlib
import statistics
import sys
import tempfile
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np
import psutil

from evaluation import TOP
from evaluation.processes import Master, Peer, end, start
from smokebot_udp.codecs.perception.voxel import voxel_filter

from .end_to_end_peer import HEIGHT, WIDTH, Entry, points

NODES = 'robot_sender', 'operator_receiver'
LOST = 'lost', 'dropped, datagrams of replaced messages'
"""Keys of the numbers of lost datagrams in the diagnostics of NODES."""

PEER = [sys.executable, '-m', 'benchmarks.end_to_end_peer']

KINDS = 'image', 'cloud'

WIRE_TOPICS = ['link/report', 'clock/ask', 'clock/answer', 'reliable/to_robot', 'reliable/to_operator',
               *('%s/segments' % stream for stream in (*KINDS, 'link', 'status'))]
"""Topics between robot_sender and operator_receiver, in /smokebot_udp."""

ROUNDS, SECONDS = 3, 6.0
QUICK_ROUNDS, QUICK_SECONDS = 1, 3.0

CONNECT_TIMEOUT, TIMEOUT = 20.0, 3.0
"""A method that delivers nothing within this time, at first or in a later turn, is measured all the same: UDPROS may
lose every message [s]."""

LEAF_SIZE = 0.1
"""Leaf size of the voxel grid filter of the clouds that are decimated, as in config/streams.yaml [m]."""

PACED, UNPACED = ('_adapt:=false', '_max_rate:=400'), ('_adapt:=false', '_max_rate:=0')
"""Arguments for a rate of 400 Mbit/s, and for an unlimited one. Without either, the rate follows the link."""

LOADS: Dict[str, Dict[str, float]] = {
    'Table 1, raw: 640 x 480 mono16 at 50 Hz and 23 040 points at 10 Hz': {'image': 50.0, 'cloud': 10.0},
    '640 x 480 mono16 at 10 Hz': {'image': 10.0},
    '23 040 points at 10 Hz': {'cloud': 10.0},
}
"""{title: {kind: rate [Hz]}}"""

TABLE_1, IMAGES, CLOUDS = LOADS


class Method(NamedTuple):
    """What is between source and sink, in the namespace of its name."""
    name: str
    title: str
    robot: List[List[str]]
    """The commands of the robot's side."""
    operator: List[List[str]]
    """The commands of the operator's side."""
    points: int
    """Number of points of a cloud without loss."""
    output: str = 'out'
    counts: bool = False
    """Whether its nodes count what is lost."""

    @property
    def inputs(self) -> Dict[str, str]:
        """{kind: the source's topic}"""
        return {kind: '/%s/in/%s' % (self.name, kind) for kind in KINDS}

    @property
    def outputs(self) -> Dict[str, str]:
        """{kind: the sink's topic}"""
        return {kind: '/%s/%s/%s' % (self.name, self.output, kind) for kind in KINDS}


class Case(NamedTuple):
    """A method with a load."""
    load: str
    method: str
    goals: Dict[str, float] = {}
    """{measure: upper limit}"""


CASES = [
    Case(TABLE_1, 'paced', {'robot': 0.5, 'operator': 0.5, 'lost': 0}), Case(TABLE_1, 'adapted'),
    Case(TABLE_1, 'tcp'), Case(TABLE_1, 'udp'), Case(TABLE_1, 'jpeg'), Case(TABLE_1, 'direct'),
    Case(IMAGES, 'unpaced', {'image.p99': 15e-3, 'lost': 0}),
    Case(IMAGES, 'paced'), Case(IMAGES, 'adapted'), Case(IMAGES, 'tcp'), Case(IMAGES, 'udp'), Case(IMAGES, 'jpeg'),
    Case(IMAGES, 'direct'),
    Case(CLOUDS, 'thinned'), Case(CLOUDS, 'packed'), Case(CLOUDS, 'unpaced'), Case(CLOUDS, 'tcp'), Case(CLOUDS, 'udp'),
    Case(CLOUDS, 'direct'),
]

Commands = List[List[str]]
Sides = Tuple[Commands, Commands]
"""The commands of the robot's and of the operator's side."""


def methods(folder: pathlib.Path) -> List[Method]:
    """All methods; folder: where files of streams are written."""
    cloud = points()
    finite = np.stack([cloud[axis] for axis in 'xyz'], axis=1)
    finite = finite[np.isfinite(finite).all(axis=1)]
    decimated = len(voxel_filter(finite, LEAF_SIZE)[0])
    raw, thinned = {'leaf_size': 0.0, 'intensity': True}, {'leaf_size': LEAF_SIZE}
    clouds = _relays('cloud')
    return [
        _ours('paced', 'ours, at 400 Mbit/s', folder, raw, len(finite), *PACED),
        _ours('adapted', 'ours, rate adapted', folder, raw, len(finite)),
        _ours('unpaced', 'ours, unpaced', folder, raw, len(finite), *UNPACED),
        _ours('thinned', 'ours, thinned, float32, unpaced', folder, thinned, decimated, *UNPACED),
        _ours('packed', 'ours, thinned, packed, unpaced', folder, {**thinned, 'encoding': 'packed'}, decimated,
              *UNPACED),
        Method('tcp', 'roscpp relays, TCPROS', *_together(_relays('image'), clouds), len(cloud)),
        Method('udp', 'roscpp relays, UDPROS', *_together(*(_relays(kind, '_unreliable:=true') for kind in KINDS)),
               len(cloud)),
        Method('jpeg', 'JPEG, 8 bits; clouds by TCPROS', *_together(_jpeg(), clouds), len(cloud)),
        Method('direct', 'rospy TCPROS, nothing between', [], [], len(cloud), 'in'),
    ]


def _ours(name: str, title: str, folder: pathlib.Path, cloud_settings: Mapping[str, Any], cloud_size: int,
          *options: str) -> Method:
    streams: Dict[str, Dict[str, Any]] = {
        'image': {'type': 'image', 'rate': 100.0, 'coding': 'interleaved'},
        'cloud': {'type': 'cloud', 'rate': 100.0, **cloud_settings}}
    for kind, stream in streams.items():
        stream.update(robot_topic='in/' + kind, operator_topic='out/' + kind)
    path = folder / (name + '.yaml')
    path.write_text(json.dumps({'streams': streams}))    # JSON is YAML
    # several pairs run at one master
    remaps = ['/smokebot_udp/%s:=smokebot_udp/%s' % (topic, topic) for topic in WIRE_TOPICS]
    robot, operator = ([sys.executable, str(TOP / 'scripts' / node), '_streams_file:=%s' % path, *remaps]
                       for node in NODES)
    return Method(name, title, [[*robot, *options]], [operator], cloud_size, counts=True)


def _relays(kind: str, *options: str) -> Sides:
    robot, operator = (['rosrun', 'topic_tools', 'relay', '%s/%s' % (source, kind), '%s/%s' % (target, kind),
                        '__name:=%s_%s' % (side, kind)]
                       for side, source, target in (('robot', 'in', 'wire'), ('operator', 'wire', 'out')))
    return [robot], [[*operator, *options]]


def _jpeg() -> Sides:
    return [[*PEER, 'encode', 'in/image', 'wire/image']], [[*PEER, 'decode', 'wire/image', 'out/image']]


def _together(*sides: Sides) -> Sides:
    robot, operator = zip(*sides)
    return sum(robot, []), sum(operator, [])


class Bench:
    """All methods and their processes.

    :param stack: ends the processes
    """

    def __init__(self, methods: Iterable[Method], stack: contextlib.ExitStack) -> None:
        self.methods = {method.name: method for method in methods}
        self._sides: Dict[Tuple[str, str], List[psutil.Process]] = {}   # by method and side
        self._processes: List[Any] = []
        stack.callback(lambda: end(*self._processes))
        self._lost: Dict[str, int] = {}     # {method: its count at the end of its last turn}
        for method in self.methods.values():
            for side, commands in (('robot', method.robot), ('operator', method.operator)):
                self._sides[method.name, side] = [self._start(command, method.name) for command in commands]
        inputs = [topic for method in self.methods.values() for topic in method.inputs.values()]
        outputs = [topic for method in self.methods.values() for topic in method.outputs.values()]
        self._source, self._sink = self._peer(['source', *inputs], stack), self._peer(['sink', *outputs], stack)

    def _start(self, command: List[str], namespace: str) -> psutil.Process:
        self._processes.append(start([*command, '__ns:=/' + namespace]))
        return psutil.Process(self._processes[-1].pid)

    @staticmethod
    def _peer(arguments: List[str], stack: contextlib.ExitStack) -> Peer:
        peer = Peer(PEER + arguments)
        stack.callback(peer.close)
        assert json.loads(peer.line()) == 'ready'
        return peer

    def connect(self, method: Method) -> None:
        """Wait until a method delivers a message, or CONNECT_TIMEOUT is over."""
        self._begin(method, dict.fromkeys(KINDS, 5.0), CONNECT_TIMEOUT)
        self._ask(self._source, 'stop', None)
        self._ask(self._sink, 'report', None)
        self._newly_lost(method)

    def turn(self, case: Case, seconds: float) -> Dict[str, Any]:
        """Give a method messages, and measure once they arrive.

        :return: {measure: value}: the CPU of each side [cores], `KIND.` and what `stats` returns of it, and 'lost':
            datagrams by the nodes' own counts, None where the method has none
        """
        method, rates = self.methods[case.method], LOADS[case.load]
        self._begin(method, rates, TIMEOUT)
        before, begun = self._cpu_times(case.method), time.time()
        time.sleep(seconds)
        after, ended = self._cpu_times(case.method), time.time()
        sent = self._ask(self._source, 'stop', None)
        arrived = self._ask(self._sink, 'report', None)
        result: Dict[str, Any] = {side: (after[side] - before[side]) / (ended - begun) for side in before}
        for kind in rates:
            whole = {'image': WIDTH * HEIGHT, 'cloud': method.points}[kind]
            result.update(('%s.%s' % (kind, name), value) for name, value in stats(
                sent[method.inputs[kind]], arrived.get(method.outputs[kind], ()), whole, (begun, ended)).items())
        return {**result, 'lost': self._newly_lost(method)}

    def _begin(self, method: Method, rates: Mapping[str, float], timeout: float) -> None:
        self._ask(self._source, 'start', {method.inputs[kind]: rate for kind, rate in rates.items()})
        self._ask(self._sink, 'wait', {'topics': [method.outputs[kind] for kind in rates], 'timeout': timeout})

    @staticmethod
    def _ask(peer: Peer, name: str, argument: Any) -> Any:
        return json.loads(peer.ask('%s %s' % (name, json.dumps(argument))))

    def _cpu_times(self, method: str) -> Dict[str, float]:
        """{side: processor time so far [s]} of both sides, the source and the sink."""
        processes = {'robot': self._sides[method, 'robot'], 'operator': self._sides[method, 'operator'],
                     'source': [psutil.Process(self._source.pid)], 'sink': [psutil.Process(self._sink.pid)]}
        return {side: sum(sum(process.cpu_times()[:2]) for process in running) for side, running in processes.items()}

    def _newly_lost(self, method: Method) -> Optional[int]:
        """Datagrams lost since the last call."""
        if not method.counts:
            return None
        total = sum(lost_in(self._ask(self._sink, 'diagnostics', '/%s/%s' % (method.name, node))) for node in NODES)
        before, self._lost[method.name] = self._lost.get(method.name, 0), total
        return total - before


def stats(sent: Sequence[float], arrived: Iterable[Entry], whole: int, window: Tuple[float, float]) -> Dict[str, Any]:
    """What became of a topic's messages that were stamped within a window.

    :param sent: stamps [s]
    :param arrived: see Sink.report
    :param whole: the amount of a complete message
    :param window: (begin, end) [s]
    :return: {'sent', 'came': counts, 'rate': of arrivals [Hz], 'whole': the share of the amount sent that arrived,
        0..1, 'p50', 'p99': ages [s], None where nothing arrived}
    """
    begin, end_ = window
    count = sum(begin <= stamp < end_ for stamp in sent)
    seen = [entry for entry in arrived if begin <= entry[0] < end_]
    ages: Any = np.percentile([age for _, age, _ in seen], (50, 99)).tolist() if seen else (None, None)
    return {'sent': count, 'came': len(seen), 'rate': len(seen) / (end_ - begin),
            'whole': sum(amount for _, _, amount in seen) / (whole * count) if count else None,
            'p50': ages[0], 'p99': ages[1]}


def lost_in(statuses: Iterable[Tuple[str, Mapping[str, str]]]) -> int:
    """Datagrams that are missing on the operator's side, or that newer ones replaced on the robot's.

    :param statuses: [(name, {key: text}), ...] of a node's diagnostics; those of connections, which have a peer, repeat
        the counts of the streams
    """
    return sum(int(values.get(key, 0)) for _, values in statuses if 'peer' not in values for key in LOST)


def median(rounds: Sequence[Mapping[str, Optional[float]]]) -> Dict[str, Optional[float]]:
    """The median of each measure over the rounds; the sum of what was sent, arrived and was lost."""
    result: Dict[str, Optional[float]] = {}
    for name in rounds[0]:
        known = [value for value in (measures[name] for measures in rounds) if value is not None]
        combine: Callable[[List[float]], float] = (
            sum if name.rpartition('.')[2] in ('sent', 'came', 'lost') else statistics.median)
        result[name] = combine(known) if known else None
    return result


def run(log: Callable[[str], None], quick: bool = False) -> List[Dict[str, Any]]:
    """[{'load', 'way': the method's title, 'goals', 'measured': {measure: value}}, ...], see Bench.turn."""
    count, seconds = (QUICK_ROUNDS, QUICK_SECONDS) if quick else (ROUNDS, SECONDS)
    rounds: List[List[Dict[str, Any]]] = [[] for _ in CASES]
    with contextlib.ExitStack() as stack:
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(Master())
        log('starting the nodes')
        bench = Bench(methods(folder), stack)
        for method in bench.methods.values():
            bench.connect(method)
        for number in range(count):
            log('round %d of %d' % (number + 1, count))
            for case, turns in zip(CASES, rounds):
                turns.append(bench.turn(case, seconds))
    return [{'load': case.load, 'way': bench.methods[case.method].title, 'goals': case.goals,
             'measured': median(turns)} for case, turns in zip(CASES, rounds)]


Column = Tuple[str, float, str]
"""(heading, factor, format) of a column of the table."""

COLUMNS: Dict[str, Column] = {
    'robot': ('robot', 1, '%.2f'), 'operator': ('operator', 1, '%.2f'), 'source': ('source', 1, '%.2f'),
    'sink': ('sink', 1, '%.2f'), 'lost': ('lost', 1, '%d')}
"""{measure: Column} of a case."""
KIND_COLUMNS: Dict[str, Column] = {
    'rate': ('[1/s]', 1, '%.1f'), 'whole': ('came [%]', 100, '%.1f'), 'p50': ('p50 [ms]', 1e3, '%.1f'),
    'p99': ('p99 [ms]', 1e3, '%.1f')}
"""{measure: Column} of each kind of message in a case."""


def table(results: Sequence[Mapping[str, Any]]) -> str:
    """The results as text."""
    lines = ["from the robot's topic to the operator's: cores each, lost datagrams by the nodes' counts, ages"]
    for load, rates in LOADS.items():
        columns = {**COLUMNS, **{'%s.%s' % (kind, name): column for kind in rates
                                 for name, column in KIND_COLUMNS.items()}}
        lines += ['', load, _row('', ('' if name in COLUMNS else name.split('.')[0] for name in columns)),
                  _row('', (head for head, _, _ in columns.values()))]
        for result in results:
            if result['load'] == load:
                lines.append(_row(result['way'], _cells(columns, result['measured'])))
                if result['goals']:
                    lines.append(_row('  goal, at most', _cells(columns, result['goals'])))
    return '\n'.join(lines)


def _cells(columns: Mapping[str, Column], measures: Mapping[str, Optional[float]]) -> List[str]:
    cells = []
    for name, (_, factor, form) in columns.items():
        value = measures.get(name)
        cells.append('-' if value is None else form % (factor * value))
    return cells


def _row(title: str, cells: Iterable[str]) -> str:
    return ('%-34s' % title + ''.join('%10s' % cell for cell in cells)).rstrip()
