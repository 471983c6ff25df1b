# SPDX-License-Identifier: BSD-3-Clause
"""How soon images arrive after both sides start, or one restarts, over a bad link."""
import functools
import itertools
import math
import pathlib
import statistics
import subprocess
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

import yaml

from evaluation import TOP
from evaluation.link_run import AIR, lab_state
from evaluation.listener import Listener
from evaluation.stack import Stack
from smokebot_udp.streams import classified

from .. import drawing, table
from ..runner import Figure, Run, Table

TITLE = 'Starting over a bad link'

EXPLANATION = """
From before the nodes start, a fifth of the packets is lost, and each way takes 50 ms. All streams of the package's
`config/streams.yaml` are sent: images, map, clouds, scans and small topics. How long does it take, without
intervention, until the operator has the first image, and until something of every stream has arrived? Three events:
both sides start; the robot's side is killed and started again; the operator's side is killed and started again. The
time counts from the start of the process; Python itself needs some two seconds of it.

Data come by UDP as soon as they are requested; requesting takes time: by XML-RPC over TCP, through the master on the
robot's side. A lost first packet of a TCP connection costs 1 s, a second one in a row another 2 s.
"""

LOSS, DELAY = 0.2, 0.05
SEEDS, QUICK_SEEDS = 5, 1
TIMEOUT = 120.0
"""[s]"""

UNCHANGED = 'tf_static', 'map'
"""The operator's side publishes these only where they changed: of a lasting operator they need not come again."""

NEW_OPERATOR = 'both start', 'operator restarts'
"""Events after which the operator's side has nothing yet."""

DOWN_TIME = 2.0
"""Between the end of a side and its restart [s]."""

NODES = {'robot': 'robot_sender', 'operator': 'operator_receiver'}
EVENTS: Dict[str, Sequence[str]] = {
    'both start': ('robot', 'operator'), 'robot restarts': ('robot',), 'operator restarts': ('operator',)}
"""{event: sides that are started}"""

QUICK_EVENTS = ('both start',)
GOALS = {'first image': 10, 'all streams': 20}
"""[s]"""


def streams() -> Dict[str, Dict[str, Any]]:
    """{stream: its settings}, of the package's streams.yaml: of those with an encoder."""
    loaded: Dict[str, Dict[str, Any]] = yaml.safe_load((TOP / 'config' / 'streams.yaml').read_text())['streams']
    return classified(loaded).streams


def expected(names: Iterable[str], event: str) -> List[str]:
    """The streams that have to deliver something new."""
    return [name for name in names if event in NEW_OPERATOR or name not in UNCHANGED]


Report = Callable[[str, Dict[str, Optional[float]], Dict[str, float]], None]
"""f(event, {stream: [s] until its first message, None: none arrived}, row of lab_state)"""


def wait_for_source(stack: Stack) -> None:
    """Until the simulated robot publishes."""
    stack.lab.run('robot', ['rostopic', 'echo', '-n', '1', '/battery'], env=stack.environment('robot'),
                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=60)


def one_run(run: Run, seed: int, report: Report) -> None:
    """Go through the events once."""
    topics = {name: values['operator_topic'] for name, values in streams().items()}
    with Stack(seed, log=run.folder / ('nodes_%d.log' % seed)) as stack:
        stack.lab.set(AIR)
        stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
        listener = Listener(stack)
        listener.subscribe([[topic, 'any', 'TCPROS'] for topic in topics.values()])
        wait_for_source(stack)
        stack.lab.set({'loss': LOSS, 'delay': DELAY})
        nodes: Dict[str, Any] = {}
        for event in QUICK_EVENTS if run.quick else EVENTS:
            started = EVENTS[event]
            for side in started:
                if side in nodes:
                    stack.end(nodes[side])
            time.sleep(DOWN_TIME)
            for side in started:
                nodes[side] = stack.start_node(side, NODES[side])
            awaited = {name: topics[name] for name in expected(topics, event)}
            found = listener.first(awaited.values(), TIMEOUT)
            report(event, {name: found.get(topic) for name, topic in awaited.items()}, lab_state(stack.lab))


def run(run: Run) -> None:
    """Write waits.csv and state.csv."""
    waits: List[table.Row] = []
    states: List[table.Row] = []

    def report(seed: int, event: str, found: Mapping[str, Optional[float]], state: Mapping[str, float]) -> None:
        waits.extend({'seed': seed, 'event': event, 'stream': name, 'wait [s]': wait and round(wait, 2)}
                     for name, wait in found.items())
        states.append({'seed': seed, 'event': event, **state})
        table.write(run.folder / 'waits.csv', waits)
        table.write(run.folder / 'state.csv', states)

    for seed in run.steps(range(run.seed, run.seed + (QUICK_SEEDS if run.quick else SEEDS)), 'seed {}'.format):
        one_run(run, seed, functools.partial(report, seed))


def starts(waits: Sequence[table.Row], events: Iterable[str] = EVENTS) -> Dict[str, List[Tuple[float, float]]]:
    """{event: [(first image [s], all streams [s]), ...]} of each seed; inf where something never arrived.

    :param waits: rows of waits.csv
    :param events: in their order
    """
    images = {name for name, values in streams().items() if values['type'] == 'image'}
    found: Dict[str, List[Tuple[float, float]]] = {event: [] for event in events}
    for event, seed in sorted({(row['event'], row['seed']) for row in waits}):
        times = {row['stream']: math.inf if row['wait [s]'] is None else row['wait [s]'] for row in waits
                 if (row['event'], row['seed']) == (event, seed) and row['stream'] in expected(streams(), event)}
        found[event].append((min(times[name] for name in images), max(times.values())))
    return found


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and a table of the times."""
    found = starts(table.read(folder / 'waits.csv'))
    figure, axes = drawing.canvas(9, 3.8, columns=2, sharey=True)
    for i, (until, goal) in enumerate(GOALS.items()):
        for height, event in enumerate(EVENTS):
            times = sorted(each[i] for each in found[event])
            if not times:
                continue
            axes[i].plot(times, [height] * len(times), 'o', color=drawing.OURS, alpha=0.5)
        axes[i].axvline(goal, color='0.3', linestyle='--', linewidth=1)
        axes[i].text(goal, len(EVENTS) - 0.55, ' the goal', fontsize=9, color='0.3')
        axes[i].set(xlabel='[s] after the start', title=until, xlim=(0, None), ylim=(-0.5, len(EVENTS) - 0.4))
    axes[0].set_yticks(range(len(EVENTS)))
    axes[0].set_yticklabels(list(EVENTS))
    drawing.save(figure, folder / 'starts.png')
    return [Figure('starts.png', 'Each dot is one run with another seed.'),
            times_table(folder)]


def times_table(folder: pathlib.Path) -> Table:
    """Until the first image, and until all streams."""
    found = starts(table.read(folder / 'waits.csv'))
    rows = []
    for (i, (until, goal)), event in itertools.product(enumerate(GOALS.items()), EVENTS):
        times = sorted(each[i] for each in found[event])
        if times:
            rows.append([event, until, '%.1f' % statistics.median(times), '%.1f' % times[-1], goal,
                         '%d of %d' % (sum(time <= goal for time in times), len(times))])
    return Table('Times [s]; each run has another seed:',
                 ['event', 'until', 'median', 'worst', 'goal', 'runs within it'], rows)


DOC_TABLES = {'times': times_table}
