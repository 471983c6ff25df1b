# SPDX-License-Identifier: BSD-3-Clause
"""A robot is driven through a building by what its operator sees, and what rviz shows over several links."""
import json
import math
import os
import pathlib
import sys
import time
from typing import Any, Dict, List, Mapping, NamedTuple, Tuple, Union

from evaluation import TOP
from evaluation.link_run import lab_state
from evaluation.own_masters import OwnMasters
from evaluation.processes import Peer
from evaluation.screen import RVIZ_SIZE, Screen, operator_rviz
from smokebot_udp.simulation.drive import CORRIDOR
from smokebot_udp.simulation.world import DOORS, room_centre

from .. import table
from ..runner import Figure, Run, Skipped, Table

TITLE = 'Driving by what crosses a bad link'

EXPLANATION = """
The simulated robot is driven through four rooms of its building over a link of 2 Mbit/s that loses a fifth of the
packets and takes 20 ms. The driver is a program that has the operator's topics only: it steers by the transforms and
the scan that cross, and stands still while they are older than half a second. Beside it runs rviz with operator.rviz.

The screenshots show the same rviz: on the way, then over links that lose 0, 20 and 80 % of the packets, in a cut of 5 s
and 3 s after it, and in each mission focus over the first link. The machine draws without a graphics processor and runs
both sides, so rviz draws 5 frames a second, and ages are higher than on a robot.
"""

LINK = {'loss': 0.2, 'delay': 0.02, 'jitter': 0.005, 'rate': 2e6, 'queue': 0.2}

ROUTE = [point for column, row in ((0, 1), (1, 0), (2, 1), (2, 0))
         for point in ((DOORS[column], CORRIDOR), room_centre((column, row)), (DOORS[column], CORRIDOR))]
QUICK_ROUTE = ROUTE[:2]

LEG_TIMEOUT = 60.0
"""[s]"""

SETTLE, QUICK_SETTLE = 15.0, 8.0
"""From a change until the screenshot [s]."""

CUT, AFTER = 5.0, 3.0
"""[s]"""

START = 60.0
"""For rviz to draw its first frames [s]."""

FOCUSES = 'navigation', 'inspection', 'mapping', 'localization', 'standby'


class Scene:
    """Both sides, and the operator's screen; a context manager."""

    def __init__(self, run: Run) -> None:
        try:
            self._screen = Screen(RVIZ_SIZE)
        except OSError as error:
            raise Skipped(str(error)) from None
        self._folder = run.folder
        self.stack = OwnMasters(run.seed, run.folder / 'nodes.log')
        self.lab = self.stack.lab
        self.lab.set(LINK)
        streams = '_streams_file:=%s' % (TOP / 'config' / 'streams.yaml')
        self.stack.start_node('robot', 'simulated_robot')
        self.stack.start_sender(streams, '_focus_file:=%s' % (TOP / 'config' / 'focus.yaml'))
        self.stack.start_receiver(streams)
        self.stack.start('operator', *operator_rviz(run.folder),
                         env={**self.stack.environment('operator'), **self._screen.environment})
        self._driver = Peer(self.lab.command('operator', [
            sys.executable, '-m', 'evaluation.blind_driver', '/tf:=operator/tf', '/tf_static:=operator/tf_static']),
            cwd=str(TOP), env=self.stack.environment('operator'), stderr=(run.folder / 'driver.log').open('wb'))
        assert self._driver.line() == 'ready'

    def drive(self, target: Tuple[float, float]) -> Dict[str, Any]:
        """Drive to a point; a blind_driver.Leg as a dict."""
        leg: Dict[str, Any] = json.loads(self._driver.ask(json.dumps([*target, LEG_TIMEOUT]), 2 * LEG_TIMEOUT))
        return leg

    def focus(self, name: str) -> None:
        """Request a mission focus from the operator's side."""
        self.lab.run('operator', ['rosservice', 'call', '/operator_receiver/set_focus', name], check=True,
                     env=self.stack.environment('operator'), stdout=(self._folder / 'focus.log').open('ab'))

    def shot(self, name: str) -> None:
        """Keep what the screen shows."""
        self._screen.save(str(self._folder / (name + '.png')))

    def __enter__(self) -> 'Scene':
        return self

    def __exit__(self, *_: Any) -> None:
        self._driver.close()
        self.stack.close()
        self._screen.close()


def run(run: Run) -> None:
    """Drive, and take the screenshots."""
    with Scene(run) as scene:
        time.sleep(QUICK_SETTLE if run.quick else START)
        rows, route = [], QUICK_ROUTE if run.quick else ROUTE
        for number, target in enumerate(run.steps(route, lambda target: 'to (%.1f, %.1f)' % target)):
            scene.lab.statistics()
            rows.append(_row(target, scene.drive(target), lab_state(scene.lab)))
            if target not in ((x, CORRIDOR) for x in DOORS):
                scene.shot('way_%d' % number)
        table.write(run.folder / 'legs.csv', rows)
        for look in run.steps(_looks(QUICK_SETTLE if run.quick else SETTLE), lambda look: look.name):
            _take(look, scene)


def _row(target: Tuple[float, float], leg: Mapping[str, Any], state: Mapping[str, Any]) -> Dict[str, Any]:
    ages = {'%s age %s [ms]' % (what, rank): round(1e3 * age) if math.isfinite(age) else None
            for what in ('scan', 'pose', 'image') for rank, age in zip(('p50', 'p99'), leg[what + '_age'])}
    return {'x [m]': target[0], 'y [m]': target[1], 'reached': int(leg['reached']),
            'time [s]': round(leg['seconds'], 1), 'blind [s]': round(leg['blind'], 2),
            'nearest [m]': round(leg['least'], 2), **ages, **state}


class _Look(NamedTuple):
    """A screenshot."""
    name: str
    link: Mapping[str, float]
    """Conditions."""
    seconds: float
    """From a change until then."""
    focus: str = ''
    """That is requested before; empty: none."""


def _looks(settle: float) -> List[_Look]:
    return [*(_Look('loss_%.0f' % (100 * loss), {**LINK, 'loss': loss}, settle) for loss in (0.0, 0.2, 0.8)),
            _Look('cut', {**LINK, 'loss': 1.0}, CUT), _Look('after_cut', LINK, AFTER),
            *(_Look('focus_' + focus, LINK, settle, focus) for focus in FOCUSES)]


def _take(look: _Look, scene: Scene) -> None:
    scene.lab.set(look.link)
    if look.focus:
        scene.focus(look.focus)
    time.sleep(look.seconds)
    scene.shot(look.name)


def plot(folder: pathlib.Path) -> List[Union[Figure, Table]]:
    """The legs, and the screenshots."""
    legs = table.read(folder / 'legs.csv')
    shots = sorted(folder.glob('*.png'), key=os.path.getmtime)
    return [Table('The way, leg by leg. Blind: how long the driver stood still for old data. Nearest: in any scan.',
                  list(legs[0]), [list(leg.values()) for leg in legs]),
            *(Figure(shot.name, shot.stem.replace('_', ' ')) for shot in shots)]


def missed(folder: pathlib.Path) -> List[str]:
    """The points that were not reached."""
    return ['(%.1f, %.1f) is not reached' % (leg['x [m]'], leg['y [m]'])
            for leg in table.read(folder / 'legs.csv') if not leg['reached']]
