# SPDX-License-Identifier: BSD-3-Clause
"""Small states through both nodes: which share of their messages comes, how old, and what that costs."""
import pathlib
from typing import List, Sequence, Union

from evaluation.state_run import RATE_LIMIT, StateRun
from evaluation.state_source import RATE

from .. import table
from ..goals import Goal, unmet
from ..runner import Figure, Run, Table

TITLE = 'Small states over loss'

EXPLANATION = """
An IMU, seven joints and odometry at 10 Hz, all settings as shipped, over a link of 2 Mbit/s with 20 ms of delay each
way: alone, and beside a camera that fills the link. Each datagram repeats the message before, and is copied where much
is lost; all of that is to take at most 3 % of the link. Without it, 80 % would come at 20 % loss, and 50 % at 50 %.
Ages are of what came; their p95 is to be at most a period, 100 ms, and the round trip that the link reports in the same
minute, its median. `left` is p95 of the time from a message's stamp until its datagram has left the robot's node:
whether it waits there for the camera's. The rest is in the queue of the link, whose median stands beside it.
"""

LOSSES = 0.0, 0.2, 0.5
SECONDS, QUICK_SECONDS = 30.0, 10.0
LEAST = {20.0: 95.0, 50.0: 75.0}
"""{packet loss: share of the messages} [%]"""

PERIOD = 1e3 / RATE
"""[ms]"""

MOST_OF_THE_LINK = 3.0
"""For repetitions [%]."""


def run(run: Run) -> None:
    """Write states.csv."""
    rows = []
    with StateRun(run.seed, run.folder / 'nodes.log') as link:
        steps = [(camera, loss) for camera in (False, True) for loss in LOSSES]
        for camera, loss in run.steps(steps, lambda step: '%g %%' % (100 * step[1])):
            rows += link.measure(loss, QUICK_SECONDS if run.quick else SECONDS, camera)
            table.write(run.folder / 'states.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The table."""
    return [states_table(folder)]


COLUMNS = {'share [%]': '%.1f', 'age p50 [ms]': '%.0f', 'age p95 [ms]': '%.0f', 'round trip p50 [ms]': '%.0f',
           'left p95 [ms]': '%.0f', 'queue p50 [ms]': '%.0f', 'repetitions [%]': '%.1f', 'link [Mbit/s]': '%.1f'}
"""{column: format}"""


def states_table(folder: pathlib.Path) -> Table:
    """Shares and ages by stream and loss."""
    rows = table.read(folder / 'states.csv')
    return Table('Messages of 10 Hz sources that come, once and in order, and their ages when published; `link` is the '
                 'rate as the robot estimates it, repetitions are in %% of %g Mbit/s:' % (1e-6 * RATE_LIMIT),
                 ['beside', 'loss [%]', 'stream', 'come [%]', *list(COLUMNS)[1:]],
                 [['camera' if row['camera'] else 'nothing', '%g' % row['loss [%]'], row['stream'],
                   *(format_ % row[name] for name, format_ in COLUMNS.items())] for row in rows])


def missed(folder: pathlib.Path) -> List[str]:
    """The goals that were not reached, in words."""
    return ['%s beside %s at %g %% loss: %s %s' % (
        row['stream'], 'a camera' if row['camera'] else 'nothing', row['loss [%]'], goal.quantity, goal)
            for row in table.read(folder / 'states.csv')
            for goal in unmet(goals(row['loss [%]'], row['round trip p50 [ms]']), row)]


def goals(loss: float, round_trip: float) -> Sequence[Goal]:
    """At a packet loss [%].

    :param round_trip: as the link reported meanwhile, its median [ms]
    """
    found = [Goal('age p95 [ms]', PERIOD + round_trip), Goal('repetitions [%]', MOST_OF_THE_LINK)]
    return [*found, Goal('share [%]', LEAST[loss], True)] if loss in LEAST else found


DOC_TABLES = {'states': states_table}
