# SPDX-License-Identifier: BSD-3-Clause
"""link_lab: a bad link between a robot and an operator on this machine.

    link_lab up [--seed N] [--course FILE] [NAME=VALUE ...]    build it, and hold it until Ctrl-C
    link_lab run robot|operator -- COMMAND ...                 run a command on one side
    link_lab set [robot|operator] NAME=VALUE ...               change it, or what one side sends
    link_lab show                                              what its packets met so far

NAME is one of loss, burst, delay, jitter, rate, queue, reorder, duplicate.
The robot is 10.77.0.1, the operator 10.77.0.2. `run` sets ROS_IP and ROS_MASTER_URI for its side: the master is
the robot's. Times are seconds, rates bit/s, shares 0..1.
"""
import argparse
import contextlib
import json
import os
import signal
import socket
import sys
import threading
import time

from . import course as courses
from .lab import Lab, LabError, environment

SOCKET = '/run/smokebot_link_lab.sock'


def parse(words):
    """{name: value} of NAME=VALUE words.

    :raises ValueError: naming the word that is none
    """
    values = {}
    for word in words:
        name, equals, value = word.partition('=')
        if not equals or name not in courses.QUALITIES:
            raise ValueError('%r is no NAME=VALUE with one of %s' % (word, ', '.join(courses.QUALITIES)))
        values[name] = courses.number(value)
    return values


def up(lab, course):
    """Serve the lab's users, and follow the course, until Ctrl-C."""
    with socket.socket(socket.AF_UNIX) as server:
        _bind(server)
        threading.Thread(target=_accept, args=(server, lab), daemon=True).start()
        print('the link is up; link_lab run robot|operator -- COMMAND uses it, Ctrl-C ends it', flush=True)
        begun = time.monotonic()
        for step in course:
            time.sleep(max(0.0, begun + step.at - time.monotonic()))
            _ask({'set': {side: vars(getattr(step, side)) for side in courses.SIDES}})
            print('%6.1f s: %s' % (step.at, '; '.join('%s %s' % (side, _changes(getattr(step, side)))
                                                     for side in courses.SIDES)), flush=True)
        while True:
            signal.pause()


def _bind(server):
    with contextlib.suppress(FileNotFoundError):
        os.unlink(SOCKET)
    server.bind(SOCKET)
    server.listen(5)


def _changes(quality):
    plain = type(quality)()
    return ', '.join('%s %g' % (name, getattr(quality, name)) for name in courses.QUALITIES
                     if getattr(quality, name) != getattr(plain, name)) or 'perfect'


def _accept(server, lab):
    while True:
        with server.accept()[0] as user, user.makefile('rw') as lines:
            try:
                asked = json.loads(lines.readline())
                if 'set' in asked:
                    lab.set(**asked['set'])
                answer = {'command': lab.command(asked['side'], [])} if 'side' in asked else lab.statistics()
            except (ValueError, LabError) as error:
                answer = {'error': str(error)}
            lines.write(json.dumps(answer) + '\n')
            lines.flush()


def _ask(message):
    """What the link that is up answers; SystemExit where there is none, or it refuses."""
    with socket.socket(socket.AF_UNIX) as user:
        try:
            user.connect(SOCKET)
        except OSError as error:
            sys.exit('link_lab: no link is up (%s): start one with link_lab up' % error.strerror)
        with user.makefile('rw') as lines:
            lines.write(json.dumps(message) + '\n')
            lines.flush()
            answer = json.loads(lines.readline())
    if 'error' in answer:
        sys.exit('link_lab: ' + answer['error'])
    return answer


def run(side, command):
    """Become a command on a side."""
    arguments = _ask({'side': side})['command'] + command
    os.execvpe(arguments[0], arguments, environment(side))


def show():
    answer = _ask({})
    for side in courses.SIDES:
        print('%-9s %s' % (side, ', '.join('%s %d' % item for item in answer[side].items())))
    if answer['late']:
        print('packets left %.2f ms late (median), %.2f ms (p99)' % (
            1e3 * answer['late']['p50'], 1e3 * answer['late']['p99']))


def main():
    parser = argparse.ArgumentParser(prog='link_lab', description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(dest='command', metavar='up | run | set | show')
    commands.required = True
    one = commands.add_parser('up')
    one.add_argument('--seed', type=int)
    one.add_argument('--course')
    one.add_argument('--congestion-control', default='cubic')
    one.add_argument('quality', nargs='*', metavar='NAME=VALUE')
    one = commands.add_parser('run')
    one.add_argument('side', choices=courses.SIDES)
    one.add_argument('arguments', nargs=argparse.REMAINDER, metavar='-- COMMAND')
    one = commands.add_parser('set')
    one.add_argument('words', nargs='+', metavar='[robot|operator] NAME=VALUE')
    commands.add_parser('show')
    arguments = parser.parse_args()
    try:
        obey(arguments)
    except (ValueError, LabError, OSError) as error:
        sys.exit('link_lab: %s' % error)


def obey(arguments):
    if arguments.command == 'run':
        command = [word for i, word in enumerate(arguments.arguments) if i or word != '--']
        if not command:
            raise ValueError('run needs a command: link_lab run robot -- COMMAND')
        run(arguments.side, command)
    elif arguments.command == 'set':
        sides = [arguments.words[0]] if arguments.words[0] in courses.SIDES else courses.SIDES
        values = parse(arguments.words[arguments.words[0] in courses.SIDES:])
        _ask({'set': {side: values for side in sides}})
    elif arguments.command == 'show':
        show()
    else:
        seed, course = 0, []
        if arguments.course:
            with open(arguments.course) as file:
                seed, course = courses.load(file.read())
        quality = parse(arguments.quality)
        with Lab(seed if arguments.seed is None else arguments.seed, arguments.congestion_control) as lab:
            lab.set(quality)
            try:
                up(lab, course)
            except KeyboardInterrupt:
                pass
            finally:
                os.unlink(SOCKET)
