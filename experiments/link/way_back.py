# SPDX-License-Identifier: BSD-3-Clause
"""The way back over a bad link: commands, the emergency stop, calls and reliable messages."""
import json
import pathlib
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Sequence, Union

import numpy as np

from evaluation import way_back
from evaluation.way_back import NARROW, Raw
from evaluation.way_back_nodes import WayBackNodes
from evaluation.way_back_results import WITHIN, Result, judged, results, until_in_force

from .. import drawing
from ..runner import Figure, Run, Table

TITLE = 'The way back: commands, the emergency stop, calls and reliable messages'

EXPLANATION = """
An operator drives a robot over a link that takes 50 ms each way and loses packets in both directions: 20 commands a
second, each with a number, so that it is known when each one, or a newer one, takes effect on the robot. Then the link
is cut, 200 times, and operator_receiver is killed, while the operator drives on; the emergency stop is engaged and
released 1000 times while raw images fill the link; a service that counts is called 1000 times; 10 000 reliable messages
cross in each direction; commands cross an air that both directions share, idle and filled by images. Robot and operator
have a master each and a link with a key, but where it says *shared master*. All times are true ones: both sides are one
machine with one clock.
"""

MINUTES = 75.0
SECONDS, QUICK_SECONDS = 180.0, 15.0
COUNTS = {'cuts': (200, 5), 'kills': (20, 1), 'estops': (1000, 10), 'calls': (1000, 100), 'messages': (10000, 500)}
"""{what: (number in a full run, number in a quick run)}"""

AT_ONCE = 4
"""Number of calls that are made at the same time."""

DISORDER = {'loss': 0.2, 'jitter': 0.02, 'reorder': 0.1, 'duplicate': 0.1}
HALF = {'loss': 0.5}
LOST = 'commands, %.0f %% lost'
FILE, IMAGE = 'scenes.json', 'way_back.png'


class Goal(NamedTuple):
    """The goals for commands at a packet loss."""
    loss: float
    limits: Dict[str, float]
    """See way_back_results.commands."""


GOALS = (Goal(0.0, {'share': 0.999}), Goal(0.2, {'share': 0.999}), Goal(0.5, {'share': 0.99, 'age': 0.12}),
         Goal(0.8, {}))


class Scenes:
    """What is measured with the same nodes.

    :param name: goes before the names of the scenes
    """

    def __init__(self, run: Run, nodes: WayBackNodes, name: str) -> None:
        self._nodes, self.name = nodes, name
        part = min(1.0, (run.minutes or MINUTES) / MINUTES)     # of a whole run
        self._seconds = QUICK_SECONDS if run.quick else max(QUICK_SECONDS, part * SECONDS)
        self._counts = {what: quick if run.quick else max(quick, round(part * whole))
                        for what, (whole, quick) in COUNTS.items()}

    def _named(self, raw: Raw, scene: str, **more: Any) -> Raw:
        return {**raw, 'scene': self.name + scene, **more}

    def steady(self) -> Iterator[Raw]:
        """Commands at each loss."""
        return self._steady(GOALS)

    def lossy(self) -> Iterator[Raw]:
        """Commands where some are lost, but most can arrive."""
        return self._steady(GOALS[1:3])

    def _steady(self, goals: Sequence[Goal]) -> Iterator[Raw]:
        for goal in goals:
            yield self._named(way_back.commands(self._nodes, self._seconds, {'loss': goal.loss}),
                              LOST % (100 * goal.loss), **goal.limits)

    def unsteady(self) -> Iterator[Raw]:
        """Commands over links that do worse than to lose."""
        yield self._named(way_back.commands(self._nodes, self._seconds, {}, self._outages), 'cuts of 1 s')
        yield self._named(way_back.commands(self._nodes, self._seconds, DISORDER), 'reordered, repeated, with jitter')

    def _outages(self, seconds: float) -> None:
        way_back.outages(self._nodes, seconds)

    def stops(self) -> Iterator[Raw]:
        """Cuts and kills."""
        yield self._named(way_back.cuts(self._nodes, self._counts['cuts']), 'the link is cut')
        yield self._named(way_back.kills(self._nodes, self._counts['kills']), 'operator_receiver is killed')

    def calls(self) -> Iterator[Raw]:
        """Calls of a service."""
        yield self._named(way_back.calls(self._nodes, self._counts['calls'], AT_ONCE, HALF), 'calls, 50 % lost')

    def reliable(self) -> Iterator[Raw]:
        """Reliable messages, without and with an end to timeout."""
        for what, raws in (('reliable %s, 50 %% lost', way_back.reliable(self._nodes, self._counts['messages'], HALF)),
                           ('reliable %s, a cut', way_back.give_up(self._nodes))):
            for raw, way in zip(raws, ('to the robot', 'to the operator')):
                yield self._named(raw, what % way)

    def estops(self) -> Iterator[Raw]:
        """The emergency stop while images fill the link."""
        self._nodes.fill(True)
        yield self._named(way_back.estops(self._nodes, self._counts['estops'], {**HALF, **NARROW}),
                          'images, 50 % lost')
        self._nodes.fill(False)

    def air(self) -> Iterator[Raw]:
        """Commands on one air, idle and filled."""
        for name in ('idle', 'filled'):
            self._nodes.fill(name == 'filled')
            yield self._named(way_back.commands(self._nodes, self._seconds, NARROW), name, air=name)


class Stage(NamedTuple):
    """Nodes, and what is measured with them."""
    name: str
    options: Dict[str, Any]
    """Keyword arguments of WayBackNodes."""
    scenes: Sequence[Callable[[Scenes], Iterator[Raw]]]


STAGES = (Stage('', {}, (Scenes.steady, Scenes.unsteady, Scenes.stops, Scenes.calls, Scenes.reliable, Scenes.estops)),
          Stage('shared master: ', {'own_masters': False}, (Scenes.lossy,)),
          Stage('one air: ', {'shared_air': True}, (Scenes.air,)))


def run(run: Run) -> None:
    """Write scenes.json after each scene."""
    raws: List[Raw] = []
    for stage in run.steps(STAGES, lambda stage: stage.name):
        with WayBackNodes(run.folder, run.seed, **stage.options) as nodes:
            for scene in stage.scenes:
                for raw in measured(scene, Scenes(run, nodes, stage.name)):
                    raws.append(raw)
                    (run.folder / FILE).write_text(json.dumps(raws))


def measured(scene: Callable[[Scenes], Iterator[Raw]], scenes: Scenes) -> Iterator[Raw]:
    """What a scene yields; an error is a result: the others are measured all the same."""
    try:
        yield from scene(scenes)
    except (RuntimeError, OSError) as error:
        yield {'kind': 'failed', 'scene': scenes.name + scene.__name__, 'error': str(error)}


def load(folder: pathlib.Path) -> List[Raw]:
    """What was measured."""
    raws: List[Raw] = json.loads((folder / FILE).read_text())
    return raws


def missed(folder: pathlib.Path) -> List[str]:
    """Goals that were missed."""
    return ['%s: %s: %s, goal: %s' % (one.scene, one.what, one.found or in_words(one.times), one.goal)
            for one in results(load(folder)) if not one.met]


def in_words(times: Sequence[float]) -> str:
    """Median, p99 and worst."""
    return ' / '.join('%.0f' % (1e3 * time) for time in times) + ' ms'


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """A figure of the commands, and a table of all results."""
    raws = load(folder)
    figure, axes = drawing.canvas(8, 4)
    for raw in raws:
        if raw['kind'] == 'commands':
            times = np.sort(1e3 * until_in_force(judged(raw), raw['heard']))
            axes.plot(times, np.arange(1, len(times) + 1) / len(times), label=raw['scene'])
    axes.axvline(1e3 * WITHIN, color='0.5', linestyle=':')
    axes.set(xlabel='until a command, or a newer one, is in force [ms]', ylabel='share of the commands', xlim=(0, 500))
    drawing.legend_right(axes)
    drawing.save(figure, folder / IMAGE)
    return [Figure(IMAGE, 'How soon a command takes effect on the robot; dotted: the goal.'),
            results_table(folder)]


def results_table(folder: pathlib.Path) -> Table:
    """All results beside their goals."""
    return Table('Times [ms]; where no goal is given, a result is only reported.',
                 ['scene', 'result', 'of', 'median', 'p99', 'worst', 'found', 'goal', 'met'],
                 [row(one) for one in results(load(folder))])


DOC_TABLES = {'results': results_table}


def row(result: Result) -> List[Any]:
    """A line of the table."""
    times: Sequence[Any] = ['%.0f' % (1e3 * time) for time in result.times] or [None] * 3
    met = ('yes' if result.met else 'NO') if result.goal else None
    return [result.scene, result.what, result.tried, *times, result.found, result.goal, met]
