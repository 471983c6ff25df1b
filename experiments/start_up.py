# SPDX-License-Identifier: BSD-3-Clause
"""How soon pictures come where both sides start, or one restarts, over a bad link."""
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

UNCHANGED = '/operator/tf_static'
"""The operator's side shows it again only where it changed; a robot that restarts has the same."""

DOWN = 2.0
"""A side that is killed is down for so long [s]."""

EVENTS = 'both start', 'robot restarts', 'operator restarts'
GOALS = {'first picture [s]': 10, 'all streams [s]': 20}


def streams():
    """{stream: its settings}, of the package's streams.yaml."""
    return yaml.safe_load((TOP / 'config' / 'streams.yaml').read_text())['streams']


def expected(topics, event):
    """Those of the topics on which something new has to come."""
    return {topic for topic in topics if event != 'robot restarts' or topic != UNCHANGED}


def one_run(run, seed, report):
    """Go through the events once.

    :param report: f(event, {topic: [s] until its first message}, row of lab_state)
    """
    topics = {values['operator_topic'] for values in streams().values()}
    with Stack(seed, log=run.folder / ('nodes_%d.log' % seed)) as stack:
        stack.lab.set(AIR)
        stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
        listener = Listener(stack)
        listener.subscribe([[topic, 'any', 'TCPROS'] for topic in topics])
        stack.lab.run('robot', ['rostopic', 'echo', '-n', '1', '/battery'], env=environment('robot'),
                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=60)
        stack.lab.set({'loss': LOSS, 'delay': DELAY})
        sides = {'robot': 'robot_sender', 'operator': 'operator_receiver'}
        nodes = {}
        for event, started in zip(EVENTS, (tuple(sides), ('robot',), ('operator',))):
            for side in started:
                if side in nodes:
                    stack.end(nodes[side])
            time.sleep(DOWN)
            for side in started:
                nodes[side] = stack.start_node(side, sides[side])
            report(event, listener.first(expected(topics, event), PATIENCE), lab_state(stack.lab))


def run(run):
    names = {values['operator_topic']: name for name, values in streams().items()}
    pictures = [values['operator_topic'] for values in streams().values() if values['type'] == 'image']
    rows, waits = [], []
    for seed in run.steps(range(run.seed, run.seed + (QUICK_SEEDS if run.quick else SEEDS)), say='seed {}'.format):
        def report(event, found, state, seed=seed):
            rows.append({'seed': seed, 'event': event,
                         'first picture [s]': _latest([min([found[p] for p in pictures if p in found], default=None)]),
                         'all streams [s]': _latest([found.get(topic) for topic in expected(names, event)]), **state})
            waits.extend({'seed': seed, 'event': event, 'stream': name, 'wait [s]': _latest([found.get(topic)])}
                         for topic, name in names.items() if topic in expected(names, event))
            table.write(run.folder / 'starts.csv', rows)
            table.write(run.folder / 'waits.csv', waits)
        one_run(run, seed, report)


def _latest(waits):
    """The longest; None where one of them never ended."""
    return None if None in waits else round(max(waits), 2)


def plot(folder):
    rows = table.read(folder / 'starts.csv')
    figure, axes = drawing.canvas(9, 3.8, columns=2, sharey=True)
    summary = []
    for (key, goal), ax in zip(GOALS.items(), axes):
        for i, event in enumerate(EVENTS):
            times = sorted(row[key] for row in rows if row['event'] == event and row[key] is not None)
            count = sum(row['event'] == event for row in rows)
            ax.plot(times, [i] * len(times), 'o', color=drawing.OURS, alpha=0.5)
            if times:
                summary.append([event, key[:-4], count, statistics.median(times), times[-1] if len(times) == count else
                                'never', goal, sum(time <= goal for time in times)])
        ax.axvline(goal, color='0.3', linestyle='--', linewidth=1)
        ax.text(goal, len(EVENTS) - 0.55, ' the goal', fontsize=9, color='0.3')
        ax.set(xlabel='[s] after the start', title=key[:-4], xlim=(0, None), ylim=(-0.5, len(EVENTS) - 0.4))
    axes[0].set_yticks(range(len(EVENTS)), EVENTS)
    drawing.save(figure, folder / 'starts.png')
    return [Figure('starts.png', 'Each dot is one run with another seed.'),
            Table('In seconds.', ['event', 'until', 'runs', 'median', 'worst', 'goal', 'runs within it'], summary)]


again(__name__, plot)
