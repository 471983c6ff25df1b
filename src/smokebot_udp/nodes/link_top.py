# SPDX-License-Identifier: BSD-3-Clause
"""The link's streams and connections live in a terminal, of what both sides tell on /diagnostics."""
import argparse
import collections
import contextlib
import curses
import math
import os
import signal
import socket
import sys
import threading
import time
from typing import NamedTuple

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray

LEVELS = {0: 'OK', 1: 'WARN', 2: 'ERROR', 3: 'STALE'}
STALE = 3
SILENT = 3.0
"""A node that has not reported for so long is shown as STALE [s]; it reports once a second."""

MAX_NODES = 32
"""Of so many nodes reports are kept, the newest."""

DRAWN = 0.25
"""How often the screen is drawn [s]."""

PATIENCE = 3.0
"""For the master, at the start and at the end: over a link that is cut it would be minutes [s]."""

HEADS = (
    ('LEVEL', -6), ('STREAM', -18), ('SOURCE', 7), ('SENT', 6), ('CAME', 6), ('SHOWN', 6), ('LOSS %', 7),
    ('COMPL %', 8), ('AGE ms', 8), ('p99', 7), ('kB/s', 8))
"""The streams' columns: rates [Hz] of the source, of what the robot sends, of what comes, of what the operator sees."""

CONNECTION_HEADS = (
    ('LEVEL', -6), ('STREAM', -18), ('SIDE', -9), ('PEER', -24), ('ADDRESS', -22), ('DATAGRAMS', 11), ('LOSS %', 7),
    ('kB/s', 8), ('DROPS', 7))
"""The connections' columns; drops are the kernel's, where the socket's buffer was full."""


class Status(NamedTuple):
    """What one diagnostic_msgs/DiagnosticStatus says."""
    node: str
    level: int
    message: str
    values: dict
    """{key: text}"""


class Line(NamedTuple):
    """A line of the screen, and the level whose colour its first word has; None: no colour."""
    text: str
    level: object = None


def as_status(message):
    """The Status of a DiagnosticStatus, or None where it is none of this package's."""
    values = {clean(pair.key): clean(pair.value) for pair in message.values}
    if values.get('side') not in ('robot', 'operator'):
        return None
    return Status(clean(message.name.split(': ')[0]), message.level if message.level in LEVELS else STALE,
                  clean(message.message), values)


def clean(text):
    """Text that does nothing to a terminal: what comes from the network may be anything."""
    return ''.join(sign if sign.isascii() and sign.isprintable() else '?' for sign in text)


class Board:
    """The last report of each node; time is an argument [s]."""

    def __init__(self):
        self._reports = collections.OrderedDict()   # {node: (when, [Status, ...])}, the newest last

    def take(self, statuses, now):
        """Take what one DiagnosticArray says; a node says all it has in one."""
        for node in {status.node for status in statuses}:
            self._reports[node] = now, [status for status in statuses if status.node == node]
            self._reports.move_to_end(node)
        while len(self._reports) > MAX_NODES:
            self._reports.popitem(last=False)

    @property
    def sides(self):
        """The sides that have reported: a set of robot, operator."""
        return {status.values['side'] for _, statuses in self._reports.values() for status in statuses}

    def age(self, now):
        """How long ago the last report came; None: none did [s]."""
        return min((now - when for when, _ in self._reports.values()), default=None)

    def statuses(self, now):
        """All there is, in the order of the nodes' names; what is too old is STALE."""
        for _, (when, statuses) in sorted(self._reports.items()):
            for status in statuses:
                if now - when > SILENT:
                    yield status._replace(level=STALE, message='silent for %.0f s' % (now - when))
                else:
                    yield status


def lines(board, now):
    """What is shown.

    :return: ([Line, ...] that stay at the top, [Line, ...] that may scroll)
    """
    age = board.age(now)
    if age is None:
        return [Line('smokebot_udp link: no report on /diagnostics yet')], []
    statuses = list(board.statuses(now))
    streams, connections, clocks, links, settings = ([status for status in statuses if key in status.values]
                                                     for key in ('topic', 'peer', 'jumps', 'state', 'problems'))
    top = [Line('smokebot_udp link: last report %.1f s ago%s' % (
        age, ''.join(', no report of the %s' % side for side in ('robot', 'operator') if side not in board.sides)))]
    top += [_link_line(link) for link in links] + [_clock_line(clock) for clock in clocks]
    top += [Line('%-6s %s: %s' % (LEVELS[status.level], status.node, status.message), status.level)
            for status in settings if status.level]
    body = [Line(_row(HEADS, [head for head, _ in HEADS]))] + _stream_lines(streams)
    if connections:
        body += [Line(''), Line(_row(CONNECTION_HEADS, [head for head, _ in CONNECTION_HEADS]))]
        body += [_connection_line(connection) for connection in connections]
    return top, body


def _link_line(status):
    values = status.values
    told = [_number(values, '%s [Mbit/s]' % name, 1) for name in ('sent', 'rate', 'wanted', 'capacity')]
    told += [_number(values, name, 0) for name in ('queue delay [ms]', 'loss [%]', 'round trip [ms]')]
    told.append(status.message if status.level == STALE else values['state'])
    return Line('%-6s link: %s of %s Mbit/s sent, %s wanted, %s carried; queue %s ms, loss %s %%, round trip %s ms; '
                '%s' % (LEVELS[status.level], *told), status.level)


def _clock_line(status):
    values = status.values
    if 'offset [ms]' not in values or status.level == STALE:
        return Line('%-6s clock: %s' % (LEVELS[status.level], status.message), status.level)
    return Line('%-6s clock: the robot\'s is ahead by %s ms +- %s, round trip %s ms' % (
        LEVELS[status.level], _number(values, 'offset [ms]', 1), _number(values, 'uncertainty [ms]', 1),
        _number(values, 'round_trip [ms]', 1)), status.level)


def _stream_lines(streams):
    """A line for each stream and operator: what the robot tells of it stands beside."""
    names = dict.fromkeys(status.values.get('stream', '') for status in streams)
    operators = {status.node for status in streams if status.values['side'] == 'operator'}
    found = []
    for name in names:
        same = [status for status in streams if status.values.get('stream', '') == name]
        robot = next((status for status in same if status.values['side'] == 'robot'), None)
        for operator in [status for status in same if status.values['side'] == 'operator'] or [None]:
            found.append(_stream_line(name, robot, operator, len(operators) > 1))
    return found


def _stream_line(name, robot, operator, many):
    sent, came = robot.values if robot else {}, operator.values if operator else {}
    level = max(status.level for status in (robot, operator) if status)
    rates = [_number(sent, 'rate in [Hz]', 1), _number(sent, 'rate out [Hz]', 1),
             _number(came, 'rate in [Hz]', 1), _number(came, 'rate out [Hz]', 1)]
    told = ['%s: %s' % (status.values['side'], status.message) for status in (robot, operator)
            if status and status.level]
    if many and operator:
        told.insert(0, 'at ' + operator.node)
    return Line(_row(HEADS, [LEVELS[level], name] + rates + [
        _number(came, 'loss [%]', 1), _number(came, 'completeness [%]', 0), _number(came, 'age p50 [ms]', 0),
        _number(came, 'age p99 [ms]', 0), _number(came or sent, 'bytes/s', 1, 1e-3)], *told), level)


def _connection_line(status):
    values = status.values
    return Line(_row(CONNECTION_HEADS, [
        LEVELS[status.level], values.get('stream', ''), values['side'], values['peer'], values.get('address', ''),
        _number(values, 'datagrams', 0), _number(values, 'loss [%]', 1), _number(values, 'bytes/s', 1, 1e-3),
        _number(values, 'kernel drops', 0)], *[status.message] * bool(status.level)), status.level)


def _row(heads, cells, *told):
    """Cells in their columns, and what is told beside; a width below 0 aligns a text to the left, and cuts it."""
    columns = ['%-*s' % (-width, cell[:-width]) if width < 0 else '%*s' % (width, cell)
               for (_, width), cell in zip(heads, cells)]
    return '  '.join([' '.join(columns), *told]).rstrip()


def _number(values, key, digits, factor=1.0):
    """A value's number as text; - where there is none."""
    try:
        number = float(values[key]) * factor
    except (KeyError, ValueError):
        return '-'
    return '%.*f' % (digits, number) if math.isfinite(number) else '-'


class Listener:
    """Fills a board from /diagnostics."""

    def __init__(self):
        self.board, self.lock = Board(), threading.Lock()
        rospy.Subscriber('/diagnostics', DiagnosticArray, self._take, queue_size=20)

    def _take(self, message):
        statuses = [status for status in map(as_status, message.status) if status is not None]
        with self.lock:
            self.board.take(statuses, time.monotonic())

    @property
    def sides(self):
        with self.lock:
            return self.board.sides

    def lines(self):
        with self.lock:
            return lines(self.board, time.monotonic())


def show(screen, listener):
    """Draw until q is pressed."""
    colours = _prepare(screen)
    scrolled = 0
    while True:
        rows, columns = screen.getmaxyx()
        top, body = listener.lines()
        page = max(1, rows - len(top))
        scrolled = max(0, min(scrolled, len(body) - page))
        screen.erase()
        for row, line in enumerate((top + body[scrolled:])[:rows]):
            # the last column stays free: writing to the last cell of all is an error to curses
            with contextlib.suppress(curses.error):
                screen.addnstr(row, 0, line.text, columns - 1)
                screen.chgat(row, 0, min(6, columns - 1), colours.get(line.level, 0))
        screen.refresh()
        key = screen.getch()
        if key == ord('q'):
            return
        scrolled += {curses.KEY_DOWN: 1, curses.KEY_UP: -1, curses.KEY_NPAGE: page, curses.KEY_PPAGE: -page}.get(key, 0)


def _prepare(screen):
    """{level: attribute}"""
    screen.timeout(int(1e3 * DRAWN))
    with contextlib.suppress(curses.error):     # not every terminal can
        curses.curs_set(0)
    with contextlib.suppress(curses.error):
        curses.use_default_colors()
        for level, colour in enumerate(('GREEN', 'YELLOW', 'RED', 'MAGENTA')):
            curses.init_pair(level + 1, getattr(curses, 'COLOR_' + colour), -1)
        return {level: curses.color_pair(level + 1) | curses.A_BOLD for level in LEVELS}
    return {1: curses.A_BOLD, 2: curses.A_REVERSE, STALE: curses.A_REVERSE}


def print_once(listener, wait):
    """Print one table when both sides have reported, or what there is after `wait` [s]; returns the exit code."""
    deadline = time.monotonic() + wait
    while time.monotonic() < deadline and len(listener.sides) < 2:
        time.sleep(0.05)
    if not listener.sides:
        return _fail('no report of robot_sender or operator_receiver came on /diagnostics in %g s' % wait)
    top, body = listener.lines()
    print('\n'.join(line.text for line in top + body))
    return 0


def _fail(problem):
    print('link_top: ' + problem, file=sys.stderr)
    return 1


def run(arguments):
    """The exit code."""
    if not arguments.once and not (sys.stdin.isatty() and sys.stdout.isatty()):
        return _fail('this is no terminal; --once prints the table')
    socket.setdefaulttimeout(PATIENCE)
    if not rosgraph.is_master_online():     # rospy would wait for one for ever
        return _fail('no ROS master answers at %s' % rosgraph.get_master_uri())
    socket.setdefaulttimeout(None)
    rospy.init_node('link_top', anonymous=True, disable_signals=True, log_level=rospy.FATAL)
    if arguments.once:
        return print_once(Listener(), arguments.wait)
    try:
        curses.wrapper(show, Listener())
    except curses.error as error:
        return _fail('this terminal cannot show it (%s); --once prints the table' % error)
    return 0


def main():
    parser = argparse.ArgumentParser(prog='link_top', description="The link's streams and connections, live.",
                                     epilog='Arrows and page keys scroll; q or Ctrl-C ends it.')
    parser.add_argument('--once', action='store_true', help='print one table, and end')
    parser.add_argument('--wait', type=float, default=3.0, metavar='SECONDS',
                        help='so long --once waits for both sides (default: %(default)s)')
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    # a terminal is restored whichever way it ends
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = run(arguments)
    except KeyboardInterrupt:
        code = 0
    _end(code)


def _end(code):
    """Leave the master, and end even where it does not answer: that may be why one looks at the link."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    leaving = threading.Thread(target=rospy.signal_shutdown, args=('ended',), daemon=True)
    leaving.start()
    leaving.join(PATIENCE)
    sys.stdout.flush()
    os._exit(code)
