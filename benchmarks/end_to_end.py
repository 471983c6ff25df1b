# SPDX-License-Identifier: BSD-3-Clause
"""From the robot's topics to the operator's, through running nodes: CPU a side, age, and what was lost on the way.

A source publishes, a sink subscribes; between them stand robot_sender and operator_receiver, or what one would use
instead: relays of roscpp by TCPROS and by UDPROS, and JPEG as compressed_image_transport makes it. All ways are up all
the time, but one at a time is given messages; they take turns, so that a busy moment of the machine meets them all.
"""
import contextlib
import json
import pathlib
import statistics
import sys
import tempfile
import time
from typing import Dict, List, NamedTuple

import numpy as np
import psutil

from smokebot_udp.codecs.perception.voxel import voxel_filter

from .end_to_end_peer import HEIGHT, WIDTH, points
from .processes import Master, Peer, end, start

HERE = pathlib.Path(__file__).resolve().parent
NODES = 'robot_sender', 'operator_receiver'
LOST = 'lost', 'dropped, datagrams of older ones'
"""In their diagnostics."""

SCRIPTS = HERE.parent / 'scripts'
PEER = [sys.executable, '-m', 'benchmarks.end_to_end_peer']

KINDS = 'image', 'cloud'

ROUNDS, SECONDS = 3, 6.0
QUICK_ROUNDS, QUICK_SECONDS = 1, 3.0

CONNECTED, PATIENCE = 20.0, 3.0
"""A way on which nothing comes for so long at first, and then in each turn, is measured all the same: UDPROS may lose
every message [s]."""

LEAF_SIZE = 0.1
"""Of the clouds that are thinned, as in config/streams.yaml [m]."""

PACED, UNPACED = ('_adapt:=false',), ('_adapt:=false', '_max_rate:=0')
"""At 400 Mbit/s, and as fast as it comes; without either, as fast as the link seems to carry."""

LOADS = {
    'Table 1, raw: 640 x 480 mono16 at 50 Hz and 23 040 points at 10 Hz': {'image': 50.0, 'cloud': 10.0},
    '640 x 480 mono16 at 10 Hz': {'image': 10.0},
    '23 040 points at 10 Hz': {'cloud': 10.0},
}
TABLE_1, PICTURES, CLOUDS = LOADS


class Way(NamedTuple):
    """What stands between source and sink, in the namespace of its name."""
    name: str
    title: str
    robot: List[List[str]]
    """Commands, whose processes are the robot's side."""
    operator: List[List[str]]
    points: int
    """So many come of a cloud where nothing is lost."""
    output: str = 'out'
    counts: bool = False
    """Whether its sides tell what was lost."""

    @property
    def inputs(self):
        """{kind: the source's topic}"""
        return {kind: '/%s/in/%s' % (self.name, kind) for kind in KINDS}

    @property
    def outputs(self):
        """{kind: the sink's topic}"""
        return {kind: '/%s/%s/%s' % (self.name, self.output, kind) for kind in KINDS}


class Case(NamedTuple):
    load: str
    way: str
    goals: Dict[str, float] = {}
    """{number of the result: at most so much}"""


CASES = [
    Case(TABLE_1, 'paced', {'robot': 0.5, 'operator': 0.5, 'lost': 0}), Case(TABLE_1, 'adapted'),
    Case(TABLE_1, 'tcp'), Case(TABLE_1, 'udp'), Case(TABLE_1, 'jpeg'), Case(TABLE_1, 'direct'),
    Case(PICTURES, 'unpaced', {'image.p99': 15e-3, 'lost': 0}),
    Case(PICTURES, 'paced'), Case(PICTURES, 'adapted'), Case(PICTURES, 'tcp'), Case(PICTURES, 'udp'),
    Case(PICTURES, 'jpeg'), Case(PICTURES, 'direct'),
    Case(CLOUDS, 'thinned'), Case(CLOUDS, 'packed'), Case(CLOUDS, 'unpaced'), Case(CLOUDS, 'tcp'), Case(CLOUDS, 'udp'),
    Case(CLOUDS, 'direct'),
]


def ways(folder):
    """[Way, ...]

    :param folder: pathlib.Path, where the streams' files are written
    """
    cloud = points()
    finite = np.stack([cloud[axis] for axis in 'xyz'], axis=1)
    finite = finite[np.isfinite(finite).all(axis=1)]
    thin = len(voxel_filter(finite, LEAF_SIZE)[0])
    raw, thinned = {'leaf_size': 0.0, 'intensity': True}, {'leaf_size': LEAF_SIZE}
    clouds = _relays('cloud')
    return [
        _ours('paced', 'ours, at 400 Mbit/s', folder, raw, len(finite), *PACED),
        _ours('adapted', 'ours, rate adapted', folder, raw, len(finite)),
        _ours('unpaced', 'ours, unpaced', folder, raw, len(finite), *UNPACED),
        _ours('thinned', 'ours, thinned, float32, unpaced', folder, thinned, thin, *UNPACED),
        _ours('packed', 'ours, thinned, packed, unpaced', folder, {**thinned, 'encoding': 'packed'}, thin, *UNPACED),
        Way('tcp', 'roscpp relays, TCPROS', *_together(_relays('image'), clouds), len(cloud)),
        Way('udp', 'roscpp relays, UDPROS', *_together(*(_relays(kind, '_unreliable:=true') for kind in KINDS)),
            len(cloud)),
        Way('jpeg', 'JPEG, 8 bits; clouds by TCPROS', *_together(_jpeg(), clouds), len(cloud)),
        Way('direct', 'rospy TCPROS, nothing between', [], [], len(cloud), 'in'),
    ]


def _ours(name, title, folder, cloud_settings, cloud_size, *options):
    streams = {'image': {'type': 'image', 'rate': 100.0},
               'cloud': {'type': 'cloud', 'rate': 100.0, **cloud_settings}}
    for kind, stream in streams.items():
        stream.update(robot_topic='in/' + kind, operator_topic='out/' + kind)
    path = folder / (name + '.yaml')
    path.write_text(json.dumps({'streams': streams}))    # which is YAML, too
    robot, operator = ([sys.executable, str(SCRIPTS / node), '_streams_file:=%s' % path]
                       for node in NODES)
    return Way(name, title, [robot + list(options)], [operator], cloud_size, counts=True)


def _relays(kind, *options):
    robot, operator = (['rosrun', 'topic_tools', 'relay', '%s/%s' % (source, kind), '%s/%s' % (target, kind),
                        '__name:=%s_%s' % (side, kind)]
                       for side, source, target in (('robot', 'in', 'wire'), ('operator', 'wire', 'out')))
    return [robot], [operator + list(options)]


def _jpeg():
    return [PEER + ['encode', 'in/image', 'wire/image']], [PEER + ['decode', 'wire/image', 'out/image']]


def _together(*sides):
    """Both sides of several ways: ([command of the robot's, ...], [command of the operator's, ...])."""
    return tuple(sum(commands, []) for commands in zip(*sides))


class Bench:
    """All ways and their processes, started."""

    def __init__(self, ways, stack):
        self.ways = {way.name: way for way in ways}
        self._sides = {}    # {(way, side): [psutil.Process, ...]}
        self._processes = []
        stack.callback(lambda: end(*self._processes))
        self._lost = {}     # {way: its count at the end of its last turn}
        for way in ways:
            for side, commands in (('robot', way.robot), ('operator', way.operator)):
                self._sides[way.name, side] = [self._start(command, way.name) for command in commands]
        self._source = self._peer(['source', *(topic for way in ways for topic in way.inputs.values())], stack)
        self._sink = self._peer(['sink', *(topic for way in ways for topic in way.outputs.values())], stack)

    def _start(self, command, namespace):
        self._processes.append(start(command + ['__ns:=/' + namespace]))
        return psutil.Process(self._processes[-1].pid)

    @staticmethod
    def _peer(arguments, stack):
        peer = Peer(PEER + arguments)
        stack.callback(peer.close)
        assert json.loads(peer.line()) == 'ready'
        return peer

    def connect(self, way):
        """Wait until something comes by a way, or it becomes clear that nothing does."""
        self._begin(way, dict.fromkeys(KINDS, 5.0), CONNECTED)
        self._ask(self._source, 'stop', None)
        self._ask(self._sink, 'report', None)
        self._lost_since(way)

    def turn(self, case, seconds):
        """Give a way messages, and measure once they come.

        :return: {number: value} as `figures` gives it, and 'lost': datagrams by the sides' own counts, None where the
            way has none
        """
        way, rates = self.ways[case.way], LOADS[case.load]
        self._begin(way, rates, PATIENCE)
        before, begun = self._cpu(case.way), time.time()
        time.sleep(seconds)
        after, ended = self._cpu(case.way), time.time()
        sent = self._ask(self._source, 'stop', None)
        came = self._ask(self._sink, 'report', None)
        result = {side: (after[side] - before[side]) / (ended - begun) for side in before}
        for kind in rates:
            whole = {'image': WIDTH * HEIGHT, 'cloud': way.points}[kind]
            result.update(('%s.%s' % (kind, name), value) for name, value in figures(
                sent[way.inputs[kind]], came.get(way.outputs[kind], ()), whole, (begun, ended)).items())
        return {**result, 'lost': self._lost_since(way)}

    def _begin(self, way, rates, patience):
        self._ask(self._source, 'start', {way.inputs[kind]: rate for kind, rate in rates.items()})
        self._ask(self._sink, 'wait', {'topics': [way.outputs[kind] for kind in rates], 'patience': patience})

    @staticmethod
    def _ask(peer, word, about):
        return json.loads(peer.ask('%s %s' % (word, json.dumps(about))))

    def _cpu(self, way):
        """{side: processor time used so far [s]}, of both sides and what is beside them."""
        processes = {'robot': self._sides[way, 'robot'], 'operator': self._sides[way, 'operator'],
                     'source': [psutil.Process(self._source.pid)], 'sink': [psutil.Process(self._sink.pid)]}
        return {side: sum(sum(process.cpu_times()[:2]) for process in running) for side, running in processes.items()}

    def _lost_since(self, way):
        if not way.counts:
            return None
        total = sum(lost_in(self._ask(self._sink, 'diagnostics', '/%s/%s' % (way.name, node))) for node in NODES)
        before, self._lost[way.name] = self._lost.get(way.name, 0), total
        return total - before


def figures(sent, came, whole, window):
    """What became of a topic's messages that were stamped within a window.

    :param sent: [stamp [s], ...]
    :param came: [(stamp [s], age [s], amount), ...]
    :param whole: the amount of a message of which nothing is missing
    :param window: (begin, end) [s]
    :return: {'sent', 'came': counts, 'rate': of what came [Hz], 'whole': which share of the amount sent came, 0..1,
        'p50', 'p99': ages [s], None where nothing came}
    """
    begin, end_ = window
    count = sum(begin <= stamp < end_ for stamp in sent)
    seen = [entry for entry in came if begin <= entry[0] < end_]
    ages = np.percentile([age for _, age, _ in seen], (50, 99)).tolist() if seen else (None, None)
    return {'sent': count, 'came': len(seen), 'rate': len(seen) / (end_ - begin),
            'whole': sum(amount for _, _, amount in seen) / (whole * count) if count else None,
            'p50': ages[0], 'p99': ages[1]}


def lost_in(statuses):
    """How many datagrams came to nothing: missing on the operator's side, or left behind on the robot's by newer ones.

    :param statuses: [(name, {key: text}), ...] of a node's diagnostics; a connection's have a peer, and say the same
    """
    return sum(int(values.get(key, 0)) for _, values in statuses if 'peer' not in values for key in LOST)


def median(rounds):
    """The rounds' medians; of what was sent, came and was lost, the sum."""
    result = {}
    for name in rounds[0]:
        known = [numbers[name] for numbers in rounds if numbers[name] is not None]
        together = sum if name.rpartition('.')[2] in ('sent', 'came', 'lost') else statistics.median
        result[name] = together(known) if known else None
    return result


def run(log, quick=False):
    """[{'load', 'way', 'goals', 'measured': {number: value}}, ...], see Bench.turn and figures."""
    count, seconds = (QUICK_ROUNDS, QUICK_SECONDS) if quick else (ROUNDS, SECONDS)
    rounds = [[] for _ in CASES]
    with contextlib.ExitStack() as stack:
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(Master())
        log('starting the nodes')
        bench = Bench(ways(folder), stack)
        for way in bench.ways.values():
            bench.connect(way)
        for number in range(count):
            log('round %d of %d' % (number + 1, count))
            for case, turns in zip(CASES, rounds):
                turns.append(bench.turn(case, seconds))
    return [{'load': case.load, 'way': bench.ways[case.way].title, 'goals': case.goals, 'measured': median(turns)}
            for case, turns in zip(CASES, rounds)]


COLUMNS = {'robot': ('robot', 1, '%.2f'), 'operator': ('operator', 1, '%.2f'), 'source': ('source', 1, '%.2f'),
           'sink': ('sink', 1, '%.2f'), 'lost': ('lost', 1, '%d')}
"""{number: (what the table calls it, factor, format)} of a case, and of each kind of message in it:"""
KIND_COLUMNS = {'rate': ('[1/s]', 1, '%.1f'), 'whole': ('came [%]', 100, '%.1f'), 'p50': ('p50 [ms]', 1e3, '%.1f'),
                'p99': ('p99 [ms]', 1e3, '%.1f')}


def table(results):
    lines = ["from the robot's topic to the operator's: cores each, datagrams lost by the sides' counts, ages"]
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


def _cells(columns, numbers):
    return ('-' if numbers.get(name) is None else form % (factor * numbers[name])
            for name, (_, factor, form) in columns.items())


def _row(title, cells):
    return ('%-34s' % title + ''.join('%10s' % cell for cell in cells)).rstrip()
