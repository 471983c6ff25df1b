# SPDX-License-Identifier: BSD-3-Clause
"""How soon pictures come where both sides start, or one restarts, over a bad link."""
import functools
import math
import statistics
import subprocess
import time

import yaml

from smokebot_udp.link_lab.lab import environment
from smokebot_udp.link_lab.listener import Listener
from smokebot_udp.link_lab.stack import Stack

from . import drawing, table
from .crossing import AIR, lab_state
from .runner import TOP, Figure, Table, again

TITLE = 'Starting over a bad link'

EXPLANATION = """
A fifth of the packets is lost, and each way takes 50 ms, from before the nodes start. All streams of the package's
`config/streams.yaml` are sent: pictures, map, clouds, scans and small topics. Nobody does anything: how long does it
take until the operator has the first picture, and until something came of every stream? Three events: both sides start;
the robot's side is killed and started again; the operator's side is killed and started again. The time counts from the
start of the process, so that some two seconds are Python's.

Data come by UDP as soon as they are asked for; what takes its time is asking: by XML-RPC over TCP, through the master
on the robot's side. A lost first packet of a TCP connection costs 1 s, the second one in a row 2 s more.
"""

LOSS, DELAY = 0.2, 0.05
SEEDS, QUICK_SEEDS = 10, 1
PATIENCE = 120.0
"""[s]"""

UNCHANGED = 'tf_static', 'map'
"""The operator's side shows these again only where they changed: a robot's side that restarts may have the same."""

DOWN = 2.0
"""A side that is killed is down for so long [s]."""

QUICK_EVENTS = 1
"""The first of them."""

EVENTS = 'both start', 'robot restarts', 'operator restarts'
GOALS = {'first picture': 10, 'all streams': 20}
"""[s]"""


def streams():
    """{stream: its settings}, of the package's streams.yaml."""
    return yaml.safe_load((TOP / 'config' / 'streams.yaml').read_text())['streams']


def expected(names, event):
    """Those of the streams of which something new has to come."""
    return [name for name in names if event != 'robot restarts' or name not in UNCHANGED]


def one_run(run, seed, report):
    """Go through the events once.

    :param report: f(event, {stream: [s] until its first message, or None}, row of lab_state)
    """
    topics = {name: values['operator_topic'] for name, values in streams().items()}
    with Stack(seed, log=run.folder / ('nodes_%d.log' % seed)) as stack:
        stack.lab.set(AIR)
        stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
        listener = Listener(stack)
        listener.subscribe([[topic, 'any', 'TCPROS'] for topic in topics.values()])
        stack.lab.run('robot', ['rostopic', 'echo', '-n', '1', '/battery'], env=environment('robot'),
                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=60)
        stack.lab.set({'loss': LOSS, 'delay': DELAY})
        sides = {'robot': 'robot_sender', 'operator': 'operator_receiver'}
        nodes = {}
        events = EVENTS[:QUICK_EVENTS] if run.quick else EVENTS
        for event, started in zip(events, (tuple(sides), ('robot',), ('operator',))):
            for side in started:
                if side in nodes:
                    stack.end(nodes[side])
            time.sleep(DOWN)
            for side in started:
                nodes[side] = stack.start_node(side, sides[side])
            awaited = {name: topics[name] for name in expected(topics, event)}
            found = listener.first(awaited.values(), PATIENCE)
            report(event, {name: found.get(topic) for name, topic in awaited.items()}, lab_state(stack.lab))


def run(run):
    waits, states = [], []

    def report(seed, event, found, state):
        waits.extend({'seed': seed, 'event': event, 'stream': name, 'wait [s]': wait and round(wait, 2)}
                     for name, wait in found.items())
        states.append({'seed': seed, 'event': event, **state})
        table.write(run.folder / 'waits.csv', waits)
        table.write(run.folder / 'state.csv', states)

    for seed in run.steps(range(run.seed, run.seed + (QUICK_SEEDS if run.quick else SEEDS)), say='seed {}'.format):
        one_run(run, seed, functools.partial(report, seed))


def starts(waits):
    """{event: [(first picture [s], all streams [s]), ...]}, of each seed, inf where something never came.

    :param waits: rows of waits.csv
    """
    pictures = {name for name, values in streams().items() if values['type'] == 'image'}
    found = {event: [] for event in EVENTS}
    for event, seed in sorted({(row['event'], row['seed']) for row in waits}):
        of = {row['stream']: math.inf if row['wait [s]'] is None else row['wait [s]'] for row in waits
              if (row['event'], row['seed']) == (event, seed) and row['stream'] in expected(streams(), event)}
        found[event].append((min(of[name] for name in pictures), max(of.values())))
    return found


def plot(folder):
    found = starts(table.read(folder / 'waits.csv'))
    figure, axes = drawing.canvas(9, 3.8, columns=2, sharey=True)
    rows = []
    for i, (until, goal) in enumerate(GOALS.items()):
        for height, event in enumerate(EVENTS):
            times = sorted(run[i] for run in found[event])
            if not times:
                continue
            axes[i].plot(times, [height] * len(times), 'o', color=drawing.OURS, alpha=0.5)
            rows.append([event, until, len(times), statistics.median(times), times[-1], goal,
                         sum(time <= goal for time in times)])
        axes[i].axvline(goal, color='0.3', linestyle='--', linewidth=1)
        axes[i].text(goal, len(EVENTS) - 0.55, ' the goal', fontsize=9, color='0.3')
        axes[i].set(xlabel='[s] after the start', title=until, xlim=(0, None), ylim=(-0.5, len(EVENTS) - 0.4))
    axes[0].set_yticks(range(len(EVENTS)), EVENTS)
    drawing.save(figure, folder / 'starts.png')
    return [Figure('starts.png', 'Each dot is one run with another seed.'),
            Table('In seconds.', ['event', 'until', 'runs', 'median', 'worst', 'goal', 'runs within it'], rows)]


again(__name__, plot)
