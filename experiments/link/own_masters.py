# SPDX-License-Identifier: BSD-3-Clause
"""How soon an operator with a master of its own sees the present over a bad link, after each kind of event."""
import math
import pathlib
import statistics
import time
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Union

from evaluation.link_run import AIR, lab_state
from evaluation.listener import Listener
from evaluation.own_masters import PORT, OwnMasters
from evaluation.started import Started
from evaluation.tap import Tap
from smokebot_udp.link.packets import Kind

from .. import drawing, table
from ..runner import Figure, Run, Table
from .start_up import DELAY, DOWN_TIME, LOSS, TIMEOUT, expected, starts, streams, wait_for_source

TITLE = 'Own masters over a bad link'

EXPLANATION = """
As in *Starting over a bad link*, but each side has a master of its own, and one UDP port of the robot joins them, with
a key. A fifth of the packets is lost, and each way takes 50 ms. How long does it take until the operator has an image
that shows the present, and something new of every stream? At a start, the time counts from the operator's first
datagram to a robot that listens; at a restart of the robot's side, from when it listens again; after a cut or a new
address, from when packets can cross again; at a restart of a master, which nobody waits for, from when it is started.
"""

SEEDS, QUICK_SEEDS = 20, 1
CUT, QUICK_CUT = 30.0, 5.0
"""[s]"""

FRESH = 1.0
"""A younger image shows the present [s]."""

BAD = {'loss': LOSS, 'delay': DELAY}


class Goal(NamedTuple):
    """Times to meet [s]."""
    median: float
    worst: float
    all_streams: float
    """Median."""


START, RETURN = Goal(1.0, 2.5, 2.0), Goal(1.0, math.inf, math.inf)
GOALS = {'both start': START, "robot's master restarts": RETURN, "operator's master restarts": RETURN,
         'robot restarts': RETURN, 'operator restarts': START, 'cut': RETURN, 'address changes': RETURN}
"""{event: Goal}, in the order of events."""


SETTLE = 3.0
"""Between events [s]."""


class Times(NamedTuple):
    """After an event, ascending [s]."""
    event: str
    images: Sequence[float]
    all_streams: Sequence[float]


class Scene(Started):
    """Both sides, and what happens to them; a context manager.

    :param run: gives the folder, and how long a cut is
    :param seed: of the link
    """

    def __init__(self, run: Run, seed: int) -> None:
        super().__init__()
        self._cut = QUICK_CUT if run.quick else CUT
        self.stack = self.enter_context(OwnMasters(seed, run.folder / ('nodes_%d.log' % seed)))
        self.topics = {name: values['operator_topic'] for name, values in streams().items()}
        self._images = {values['operator_topic'] for values in streams().values() if values['type'] == 'image'}
        self._nodes: Dict[str, Any] = {}
        with self.starting():
            self.stack.lab.set(AIR)
            self.stack.start_node('robot', 'simulated_robot', '_width:=320', '_height:=240')
            self.listener = Listener(self.stack)
            self.listener.subscribe([[topic, 'any', 'TCPROS'] for topic in self.topics.values()])
            self._tap = Tap(self.stack, PORT)
            wait_for_source(self.stack)
            self.stack.lab.set(BAD)

    def events(self) -> Dict[str, Callable[[], float]]:
        """{event: make it happen, and return when packets can cross again}, in the order of GOALS."""
        return {'both start': lambda: max(self._start_robot(), self._start_operator()),
                "robot's master restarts": lambda: self._restart_master('robot'),
                "operator's master restarts": lambda: self._restart_master('operator'),
                'robot restarts': self._start_robot, 'operator restarts': self._start_operator,
                'cut': self._cut_link, 'address changes': self._change_address}

    def _start(self, side: str, start: Callable[[], Any]) -> float:
        """Kill a side's node, if it runs, and start it again; when it was started."""
        if side in self._nodes:
            self.stack.end(self._nodes[side])
            time.sleep(DOWN_TIME)
        begun = time.time()
        self._nodes[side] = start()
        return begun

    def _start_robot(self) -> float:
        self._start('robot', self.stack.start_sender)
        return self.stack.wait_for_port()

    def _start_operator(self) -> float:
        return self._tap.first(Kind.HELLO, self._start('operator', self.stack.start_receiver)).time

    def _restart_master(self, side: str) -> float:
        self.stack.end(self.stack.masters[side])
        time.sleep(DOWN_TIME)
        self.stack.masters[side] = self.stack.start_master(side)
        return time.time()

    def _cut_link(self) -> float:
        self.stack.lab.set({**BAD, 'loss': 1.0})
        time.sleep(self._cut)
        self.stack.lab.set(BAD)
        return time.time()

    def _change_address(self) -> float:
        self.stack.change_address()
        return time.time()

    def waits(self, event: str, since: float) -> Dict[str, Any]:
        """{stream: from a time to its first message that shows the present [s]; None: none came}"""
        awaited = {name: self.topics[name] for name in expected(self.topics, event)}
        begun = time.time()
        found = self.listener.first(
            awaited.values(), TIMEOUT, lambda heard: heard.topic not in self._images or heard.age < FRESH)
        return {name: round(begun + found[topic] - since, 2) if topic in found else None
                for name, topic in awaited.items()}


def run(run: Run) -> None:
    """Write waits.csv and state.csv."""
    waits: List[table.Row] = []
    states: List[table.Row] = []
    for seed in run.steps(range(run.seed, run.seed + (QUICK_SEEDS if run.quick else SEEDS)), 'seed {}'.format):
        with Scene(run, seed) as scene:
            for event, happen in scene.events().items():
                found = scene.waits(event, happen())
                waits.extend({'seed': seed, 'event': event, 'stream': name, 'wait [s]': wait}
                             for name, wait in found.items())
                states.append({'seed': seed, 'event': event, **lab_state(scene.stack.lab)})
                table.write(run.folder / 'waits.csv', waits)
                table.write(run.folder / 'state.csv', states)
                time.sleep(SETTLE)


def times(folder: pathlib.Path) -> List[Times]:
    """The times after each event that was measured."""
    found = starts(table.read(folder / 'waits.csv'), GOALS)
    return [Times(event, *(sorted(column) for column in zip(*found[event]))) for event in GOALS if found[event]]


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    texts = []
    for event, images, all_streams in times(folder):
        goal = GOALS[event]
        for what, value, limit in (('first image, median', statistics.median(images), goal.median),
                                   ('first image, worst', images[-1], goal.worst),
                                   ('all streams, median', statistics.median(all_streams), goal.all_streams)):
            if value > limit:
                texts.append('%s: %s %.2f s, at most %g s' % (event, what, value, limit))
    return texts


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure and a table of the times."""
    figure, axes = drawing.canvas(9, 4.2, columns=2, sharey=True)
    found = times(folder)
    for height, (_, images, all_streams) in enumerate(found):
        for panel, values in zip(axes, (images, all_streams)):
            panel.plot(values, [height] * len(values), 'o', color=drawing.OURS, alpha=0.5)
    for panel, title in zip(axes, ('first image', 'all streams')):
        panel.set(xlabel='[s] after packets can cross', title=title, xlim=(0, None))
    axes[0].set_yticks(range(len(found)))
    axes[0].set_yticklabels([one.event for one in found])
    drawing.save(figure, folder / 'own_masters.png')
    return [Figure('own_masters.png', 'Each dot is one run with another seed.'),
            times_table(folder)]


def times_table(folder: pathlib.Path) -> Table:
    """Until the first image that shows the present, and until all streams."""
    rows = [[event, len(images), *('%.2f' % time for time in (
        statistics.median(images), images[-1], statistics.median(all_streams), all_streams[-1]))]
            for event, images, all_streams in times(folder)]
    return Table('Times [s]. Goals after a start: first image 1 s median, 2.5 s worst, all streams 2 s median; '
                 'after the other events: an image that shows the present 1 s median.',
                 ['event', 'runs', 'image, median', 'image, worst', 'all streams, median', 'all streams, worst'], rows)


DOC_TABLES = {'times': times_table}
