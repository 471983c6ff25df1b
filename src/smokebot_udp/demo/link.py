# SPDX-License-Identifier: BSD-3-Clause
"""demo_link link:=bad [NAME:=VALUE ...]: the demo over a bad link (as root). The loss can be changed while looking.

A simulated robot and an operator, with a master each, run on the two sides of link_lab's emulated link. NAME is one of

    link      bad, or conditions of link_lab: link:=loss=0.5,rate=1e6; or two: the robot has an address on each of two
    rviz      whether to start rviz (default: true)
    seconds   duration, with a picture from the operator's first image; then the table of link_top is printed
              (default: 0, until Ctrl-C)
    picture   file for what the operator saw at five moments, beside the camera then and compressed image_transport over
              TCP on such a link; and a film beside it (default: none)
    streams   file that defines the streams
    seed      of the simulated building and of the link

In a terminal + and - change the loss, > and < the rate, q ends; with link:=two, 1 and 2 cut a link, and mend it again.
"""
import contextlib
import os
import pathlib
import select
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, Callable, Dict, Iterator, List, Mapping, Sequence

from ..link.keys import make_key
from ..link_lab.cli import SOCKET, parse
from ..link_lab.lab import ADDRESSES, Lab, LabError, environment
from ..link_lab.second_link import SECOND, second_lab
from ..link_lab.server import LabServer
from ..nodes.launches import Launch, keep_all
from ..nodes.operator_desk import QUIET
from ..nodes.terminal import is_terminal, single_keys
from .pictures import Pictures

BAD = {'loss': 0.2, 'delay': 0.02, 'jitter': 0.005, 'rate': 2e6, 'queue': 0.2}
"""The conditions of link:=bad, as link_lab has them: a Wi-Fi at the end of its range."""

FIRST_OF_TWO = {'delay': 0.01, 'rate': 2e6, 'queue': 0.2}
SECOND_OF_TWO = {'delay': 0.03, 'rate': 1e6, 'queue': 0.2}
"""The conditions of link:=two: a Wi-Fi, which is preferred, and an LTE modem."""

STEP, MOST = 0.1, 0.95
"""A key changes the loss by this much, up to this much."""

KEYS = ('; keys: + and - change the loss, > and < the rate, q ends',
        '; keys: 1 and 2 cut a link, + and - change the loss of the first, > and < its rate, q ends')
"""What a terminal says, for one link and for two."""

MIN_RATE, MAX_RATE = 1e5, 1e8
"""A key doubles or halves the rate within these bounds [bit/s]."""

FIRST_TIMEOUT = 60.0
"""With a picture it ends without an image after this time and its duration [s]."""

PORT = 17001
"""The link's, on the robot's side."""

DEFAULTS = {'link': 'bad', 'rviz': 'true', 'seconds': '0', 'picture': '', 'streams': '', 'seed': '1'}


def arguments(words: Sequence[str]) -> Dict[str, str]:
    """The values of NAME:=VALUE words, with the defaults of those that are not given.

    :raises ValueError: naming the word that is invalid
    """
    values = dict(DEFAULTS)
    for word in words:
        name, given, value = word.partition(':=')
        if not given or name not in DEFAULTS:
            raise ValueError('%r is not NAME:=VALUE with one of %s' % (word, ', '.join(DEFAULTS)))
        values[name] = value
    for name in ('seconds', 'seed'):
        if not values[name].replace('.', '', name == 'seconds').isdigit():
            raise ValueError('%s is %r, not a number' % (name, values[name]))
    return values


def conditions(link: str) -> Dict[str, Any]:
    """The conditions that `link` stands for.

    :raises ValueError: naming what is invalid
    """
    fixed = {'bad': BAD, 'two': FIRST_OF_TWO}.get(link)
    return parse(link.split(',')) if fixed is None else dict(fixed)


def changed(link: Dict[str, Any], key: str) -> Dict[str, Any]:
    """The conditions after a key."""
    loss, rate = link.get('loss', 0.0), link.get('rate', 0.0) or MAX_RATE
    if key in '+-':
        return {**link, 'loss': round(min(max(loss + (STEP if key == '+' else -STEP), 0.0), MOST), 2)}
    if key in '<>':
        return {**link, 'rate': min(max(rate * (2 if key == '>' else 0.5), MIN_RATE), MAX_RATE)}
    return link


def described(link: Dict[str, Any]) -> str:
    """The conditions in words, after the link's name."""
    rate = link.get('rate', 0.0)
    return ' loses %.0f %%, carries %s, and takes %.0f ms' % (
        100 * link.get('loss', 0.0), '%.3g Mbit/s' % (rate / 1e6) if rate else 'any rate', 1e3 * link.get('delay', 0.0))


def launches(lab: Lab, values: Dict[str, str], key_file: str) -> List[Launch]:
    """The roslaunch of each side, with a master of its own."""
    robot = ADDRESSES['robot'], SECOND['robot']
    addresses = ','.join('%s:%d' % (host, PORT) for host in (robot if values['link'] == 'two' else robot[:1]))
    streams = ['streams:=' + os.path.abspath(values['streams'])] if values['streams'] else []
    sides = {'robot': ['simulated_robot.launch', 'link_port:=%d' % PORT, 'seed:=' + values['seed']],
             'operator': ['operator.launch', 'robot:=' + addresses, 'rviz:=' + values['rviz']]}
    return [Launch("the %s's side" % side, lab.command(side, [
        'roslaunch', *QUIET, 'smokebot_udp', *words, 'key_file:=' + key_file, *streams]), own_master(side))
        for side, words in sides.items()]


def own_master(side: str) -> Dict[str, str]:
    """The environment of a side's nodes."""
    variables = {**environment(side), 'ROS_MASTER_URI': 'http://%s:11311' % ADDRESSES[side]}
    return {name: variables[name] for name in ('ROS_IP', 'ROS_MASTER_URI')}


@contextlib.contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """A function that returns the keys pressed since its last call; without a terminal none."""
    if not is_terminal():
        yield lambda: ''
        return
    with single_keys(sys.stdin.fileno()):
        yield lambda: os.read(sys.stdin.fileno(), 64).decode(errors='replace') if select.select(
            [sys.stdin], [], [], 0)[0] else ''


class Path:
    """A link of the demo.

    :param name: in words
    :param labs: which have its conditions
    :param conditions: as link_lab has them
    """

    def __init__(self, name: str, labs: Sequence[Lab], conditions: Mapping[str, Any]) -> None:
        self._name, self._labs, self._conditions, self._cut = name, labs, dict(conditions), False
        self._set()

    def press(self, key: str) -> bool:
        """Change the conditions; returns whether the key does that."""
        before, self._conditions = self._conditions, changed(self._conditions, key)
        self._set()
        return before != self._conditions

    def cut(self) -> None:
        """Let nothing pass; the next time all that the conditions let pass."""
        self._cut = not self._cut
        self._set()

    def _set(self) -> None:
        for lab in self._labs:
            lab.set({**self._conditions, 'loss': 1.0} if self._cut else self._conditions)

    def __str__(self) -> str:
        return self._name + (' is cut' if self._cut else described(self._conditions))


def pressed_any(paths: Sequence[Path], key: str) -> bool:
    """Do what a key says; returns whether it says anything."""
    if len(paths) > 1 and key in '12':
        paths[int(key) - 1].cut()
        return True
    return paths[0].press(key)


def paths_of(values: Mapping[str, str], first: Mapping[str, Any], labs: Sequence[Lab],
             stack: contextlib.ExitStack) -> List[Path]:
    """The links between the sides of the first lab; the other labs are like the first link.

    :param first: conditions of the first link
    :param stack: what they need ends with it
    """
    if values['link'] != 'two':
        return [Path('the link', labs, first)]
    second = stack.enter_context(second_lab(labs[0], int(values['seed']) + 1))
    return [Path('the first link', labs, first), Path('the second one', [second], SECOND_OF_TWO)]


def run(values: Dict[str, str]) -> None:
    """Run both sides until the end; print the conditions when they change."""
    first, seconds, picture = conditions(values['link']), float(values['seconds']), values['picture']
    with tempfile.TemporaryDirectory(prefix='demo_link_') as folder, contextlib.ExitStack() as stack:
        labs = [stack.enter_context(Lab(int(values['seed']))) for _ in range(2 if picture else 1)]
        paths = paths_of(values, first, labs, stack)
        stack.enter_context(LabServer(SOCKET, labs[0]))
        key_file = str(pathlib.Path(folder, 'demo.key'))
        make_key(key_file)
        pressed = stack.enter_context(keys())
        print('; '.join(map(str, paths)) + (KEYS[len(paths) > 1] if is_terminal() else ''), flush=True)
        pictures = stack.enter_context(Pictures(labs[0], labs[1], folder, own_master)) if picture else None
        begun, times = time.monotonic(), []     # type: float, List[float]

        def is_over() -> bool:
            nonlocal begun
            for key in pressed():
                if key in 'qQ':
                    return True
                if pressed_any(paths, key):
                    print('; '.join(map(str, paths)), flush=True)
            now = time.monotonic()
            if pictures is not None and not times:
                shown = pictures.first()
                if shown is None and now - begun < FIRST_TIMEOUT:
                    return False
                times.append(shown or time.time())
                begun = now
            if seconds and now - begun > seconds:
                times.append(time.time())
                report(labs[0])
                return True
            return False

        keep_all(launches(labs[0], values, key_file), is_over)
        if pictures is not None and len(times) > 1:
            pictures.end()
            print('\n'.join(pictures.draw(picture, *times[:2])), flush=True)


def report(lab: Lab) -> None:
    """Print what the operator's side knows."""
    subprocess.run(lab.command('operator', ['rosrun', 'smokebot_udp', 'link_top', '--once']),
                   env={**os.environ, **own_master('operator')}, timeout=60, check=False)


def main() -> None:
    words = sys.argv[1:]
    if {'-h', '--help'} & set(words):
        print(__doc__)
        return
    os.environ.pop('ROS_HOSTNAME', None)     # it would take precedence over ROS_IP
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            run(arguments(words))
    except (ValueError, LabError) as error:
        sys.exit('demo_link: %s' % error)
