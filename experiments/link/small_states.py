# SPDX-License-Identifier: BSD-3-Clause
"""Small states through both nodes: which share of their messages comes, and how old."""
import pathlib
from typing import List, Sequence, Union

from evaluation.state_run import DELAY, StateRun
from evaluation.state_source import RATE

from .. import table
from ..goals import Goal, unmet
from ..runner import Figure, Run, Table

TITLE = 'Small states over loss'

EXPLANATION = """
An IMU, seven joints and odometry at 10 Hz, all settings as shipped, beside a camera that fills a link of 2 Mbit/s with
20 ms of delay each way. Each datagram repeats the message before, and is copied where much is lost; all of that takes
at most 3 % of the link. Without it, 80 % would come at 20 % loss, and 50 % at 50 %. Ages are of what came; their p95 is
to be at most a period, 100 ms, and the round trip: what the messages in time took, and 20 ms back.
"""

LOSSES = 0.0, 0.2, 0.5
SECONDS, QUICK_SECONDS = 60.0, 10.0
LEAST = {20.0: 95.0, 50.0: 75.0}
"""{packet loss: share of the messages} [%]"""

PERIOD = 1e3 / RATE
"""[ms]"""


def run(run: Run) -> None:
    """Write states.csv."""
    rows = []
    with StateRun(run.seed, run.folder / 'nodes.log') as link:
        for loss in run.steps(LOSSES, lambda loss: '%g %%' % (100 * loss)):
            rows += link.measure(loss, QUICK_SECONDS if run.quick else SECONDS)
            table.write(run.folder / 'states.csv', rows)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The table."""
    return [states_table(folder)]


def states_table(folder: pathlib.Path) -> Table:
    """Shares and ages by stream and loss."""
    rows = table.read(folder / 'states.csv')
    return Table('Messages of 10 Hz sources that come, once and in order, and their ages when published:',
                 ['stream', 'loss [%]', 'come [%]', 'age p50 [ms]', 'age p95 [ms]', 'link [Mbit/s]'],
                 [[row['stream'], '%g' % row['loss [%]'], '%.1f' % row['share [%]'], '%.0f' % row['age p50 [ms]'],
                   '%.0f' % row['age p95 [ms]'], '%.1f' % row['link [Mbit/s]']] for row in rows])


def missed(folder: pathlib.Path) -> List[str]:
    """The goals that were not reached, in words."""
    return ['%s at %g %% loss: %s %s' % (row['stream'], row['loss [%]'], goal.quantity, goal)
            for row in table.read(folder / 'states.csv')
            for goal in unmet(goals(row['loss [%]'], row['age p50 [ms]']), row)]


def goals(loss: float, usual: float) -> Sequence[Goal]:
    """At a packet loss [%].

    :param usual: age of most messages: the way of a datagram, the camera's queue included [ms]
    """
    found = [Goal('age p95 [ms]', PERIOD + usual + 1e3 * DELAY)]
    return [*found, Goal('share [%]', LEAST[loss], True)] if loss in LEAST else found


DOC_TABLES = {'states': states_table}
