# SPDX-License-Identifier: BSD-3-Clause
"""Emulate a bad link between a robot and an operator on this machine (as root).

    link_lab up [--seed N] [--course FILE] [--shared-air] [NAME=VALUE ...]
                                                               create the link and keep it until Ctrl-C
    link_lab run robot|operator -- COMMAND ...                 run a command on one side
    link_lab set [robot|operator] NAME=VALUE ...               change the conditions, of both directions or of one
    link_lab show                                              print the packet counters

A direction is named by the side that sends. NAME is one of
    loss       packet-loss ratio, 0..1
    burst      mean length of a run of lost packets; 0: independent losses
    delay      one-way delay [s]
    jitter     maximum deviation of the delay [s]
    rate       transmission rate [bit/s]; 0: unlimited
    queue      length of the queue at this rate [s]
    bucket     instead of a queue, a policer drops what exceeds this rate and a token bucket of this depth [byte]
    aggregate  mean time between the ends of Wi-Fi's aggregates: what was transmitted meanwhile arrives at once [s]
    ecn_threshold
               packets that would wait longer than this in the queue are marked (ECN), if their senders see marks [s];
               0: none are
    reorder    ratio of packets that overtake others, 0..1
    duplicate  ratio of packets that are delivered twice, 0..1
    longest    longer packets are lost, and nobody is told [byte]; 0: none are
With `up`, path2.NAME=VALUE, such as path2.rate=1e6, makes a second link between the same sides; its ends are 10.77.1.1
and 10.77.1.2. `set path2.loss=1` changes it in both directions.
FILE is a link trace: how these values change over time (see link_lab/link_trace.py).
The robot is 10.77.0.1, the operator 10.77.0.2. `run` sets ROS_IP and ROS_MASTER_URI for its side; the master runs
on the robot's.
"""
import argparse
import contextlib
import os
import signal
import sys
import time
from typing import Any, Dict, List, NoReturn, Sequence, Tuple

from .channel import LinkConditions
from .lab import Lab, LabError, environment
from .link_trace import CONDITIONS, SIDES, Step, load, number
from .second_link import second_lab
from .server import LabServer, request

SOCKET = '/run/smokebot_link_lab.sock'
"""Where the running link answers the other commands."""


PREFIX = 'path2.'
"""With it begin the conditions of a second link."""


def split(words: Sequence[str]) -> Tuple[List[str], List[str]]:
    """The words of the first link, and those of the second one, without their beginning."""
    return ([word for word in words if not word.startswith(PREFIX)],
            [word[len(PREFIX):] for word in words if word.startswith(PREFIX)])


def parse(words: Sequence[str]) -> Dict[str, Any]:
    """{name: value} of NAME=VALUE words.

    :raises ValueError: naming the word that is invalid
    """
    values = {}
    for word in words:
        name, equals, value = word.partition('=')
        if not equals or name not in CONDITIONS:
            raise ValueError('%r is not NAME=VALUE with one of %s' % (word, ', '.join(CONDITIONS)))
        values[name] = number(value)
    return values


def up(arguments: argparse.Namespace) -> None:
    """Create the link, serve the other commands and play the trace, until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())     # not before the link and the socket are removed
    seed = 0
    trace: Sequence[Step] = ()
    if arguments.course:
        with open(arguments.course) as file:
            seed, trace = load(file.read())
    first, second = map(parse, split(arguments.conditions))
    seed = seed if arguments.seed is None else arguments.seed
    with contextlib.ExitStack() as stack:
        lab = stack.enter_context(Lab(seed, arguments.congestion_control, arguments.shared_air))
        lab.set(first)
        other = stack.enter_context(second_lab(lab, seed + 1)) if second else None
        if other is not None:
            other.set(second)
        with LabServer(SOCKET, lab, other), contextlib.suppress(KeyboardInterrupt):
            print('the link is up; use it with link_lab run robot|operator -- COMMAND, end it with Ctrl-C', flush=True)
            _play(trace)


def _play(trace: Sequence[Step]) -> NoReturn:
    start = time.monotonic()
    for step in trace:
        time.sleep(max(0.0, start + step.at - time.monotonic()))
        request(SOCKET, {'set': {side: vars(getattr(step, side)) for side in SIDES}})
        print('%6.1f s: %s' % (step.at, '; '.join('%s %s' % (side, _summary(getattr(step, side))) for side in SIDES)),
              flush=True)
    while True:
        signal.pause()


def _summary(conditions: LinkConditions) -> str:
    """The values that differ from a perfect link."""
    perfect = LinkConditions()
    return ', '.join('%s %g' % (name, getattr(conditions, name)) for name in CONDITIONS
                     if getattr(conditions, name) != getattr(perfect, name)) or 'perfect'


def run(arguments: argparse.Namespace) -> NoReturn:
    """Replace this process by a command on a side."""
    command = arguments.arguments[arguments.arguments[:1] == ['--']:]
    if not command:
        raise ValueError('run needs a command: link_lab run robot -- COMMAND')
    command = request(SOCKET, {'side': arguments.side})['command'] + command
    os.execvpe(command[0], command, environment(arguments.side))


def set_conditions(arguments: argparse.Namespace) -> None:
    """Change the conditions of both directions or of one; of a second link in both."""
    one_side = arguments.words[0] in SIDES
    first, second = map(parse, split(arguments.words[one_side:]))
    if one_side and second:
        raise ValueError('the second link changes in both directions: set %s without a side' % PREFIX)
    if first:
        request(SOCKET, {'set': {side: first for side in (arguments.words[:1] if one_side else SIDES)}})
    if second:
        request(SOCKET, {'second': {side: second for side in SIDES}})


def show(_: argparse.Namespace) -> None:
    """Print the packet counters."""
    answer = request(SOCKET, {})
    for side in SIDES:
        print('%-9s %s' % (side, ', '.join('%s %d' % item for item in answer[side].items())))
    if answer['late']:
        print('packets left %.2f ms late (median), %.2f ms (p99)' % (
            1e3 * answer['late']['p50'], 1e3 * answer['late']['p99']))


def main() -> None:
    parser = argparse.ArgumentParser(prog='link_lab', description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(dest='command', metavar='up | run | set | show')
    commands.required = True
    command = commands.add_parser('up')
    command.add_argument('--seed', type=int, help='of the random effects (default: that of the link trace, or 0)')
    command.add_argument('--course', metavar='FILE', help='link trace to play')
    command.add_argument('--congestion-control', default='cubic', help='of TCP, on both sides (default: %(default)s)')
    command.add_argument('--shared-air', action='store_true', help='both directions wait for one air')
    command.add_argument('conditions', nargs='*', metavar='NAME=VALUE')
    command.set_defaults(function=up)
    command = commands.add_parser('run')
    command.add_argument('side', choices=SIDES)
    command.add_argument('arguments', nargs=argparse.REMAINDER, metavar='-- COMMAND')
    command.set_defaults(function=run)
    command = commands.add_parser('set')
    command.add_argument('words', nargs='+', metavar='[robot|operator] NAME=VALUE')
    command.set_defaults(function=set_conditions)
    commands.add_parser('show').set_defaults(function=show)
    arguments = parser.parse_args()
    try:
        arguments.function(arguments)
    except (ValueError, LabError, OSError) as error:
        sys.exit('link_lab: %s' % error)
