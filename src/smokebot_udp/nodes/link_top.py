# SPDX-License-Identifier: BSD-3-Clause
"""Shows the link's streams and connections live in a terminal, from what both sides publish on /diagnostics.

With a shared master the robot's diagnostics cross the link by TCP. What the operator's side relays of them, or else of
the robot's ~link and ~status, crosses by UDP, and replaces them where they do not come.
"""
import argparse
import contextlib
import curses
import json
import sys
import threading
import time
from dataclasses import fields
from typing import Any, Callable, Dict, List, Optional, Set, Tuple

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray

from .. import optional, udpros
from ..mission.parameters import EXCHANGES
from ..monitoring.control_status import control_text
from ..monitoring.link_board import LEVELS, STALE, Board, NodeStatus, printable
from ..monitoring.link_snapshot import Tree, snapshot
from ..monitoring.link_status import HOLE
from ..monitoring.link_table import Line, render
from ..monitoring.stats import PAUSED
from ..monitoring.status import OK, OPERATOR, ROBOT, WARN
from ..monitoring.wifi import WifiState, wifi_status
from ..msg import LinkStatus, RobotStatus
from ..udpros import rpc
from .terminal import fail, is_terminal, master_answers, run_node
from .worker import PeriodicWorker

VIEW = 'smokebot_udp.nodes.link_view'
"""The view for which rich must be installed."""

REFRESH_PERIOD = 0.25
"""How often the screen is drawn [s]."""

JSON_PERIOD = 1.0
"""How often --json prints an object; nodes report once a second [s]."""

SEARCH_PERIOD = 5.0
"""How often the master is asked for relayed topics [s]."""

MAX_RELAYED = 256
"""Streams and operators in a relayed RobotStatus that are shown."""


def as_status(message: Any) -> Optional[NodeStatus]:
    """The NodeStatus of a DiagnosticStatus; None if it is not this package's."""
    values = {printable(pair.key): printable(pair.value) for pair in message.values}
    if values.get('side') not in (ROBOT, OPERATOR):
        return None
    return NodeStatus(_node(message.name.split(': ')[0]), message.level if message.level in LEVELS else STALE,
                      printable(message.message), values)


def _node(name: str) -> str:
    """The full name of a node; diagnostics leave the first slash out."""
    return '/' + printable(name).lstrip('/')


def relayed_link(message: Any) -> List[NodeStatus]:
    """What a relayed LinkStatus reports, as link_status and wifi_status of monitoring/ do."""
    state = printable(message.state)
    wifi = wifi_status(WifiState(**{field.name: getattr(message.wifi, field.name) for field in fields(WifiState)}),
                       ROBOT)
    problems = [state] * state.startswith('no reports')
    problems += [HOLE % message.longest_datagram] if message.longest_datagram else []
    return [NodeStatus('', WARN if problems else OK, ', '.join(problems) or state, {
        'side': ROBOT, 'state': state,
        **{'%s [Mbit/s]' % name: str(getattr(message, name)) for name in ('sent', 'rate', 'wanted', 'capacity')},
        'loss [%]': str(100 * message.loss), 'queue delay [ms]': str(1e3 * message.queue_delay),
        'round trip [ms]': str(1e3 * message.round_trip)}),
        NodeStatus('', wifi.level, wifi.message, {key: printable(str(value)) for key, value in wifi.values.items()})]


def relayed_streams(message: Any) -> List[NodeStatus]:
    """What a relayed RobotStatus reports: who drives, and how often each stream may be sent at most."""
    operators = [printable(name) for name in message.operators[:MAX_RELAYED]]
    problems = {name: why for name, _, why in (printable(text).partition(': ')
                                               for text in message.problems[:MAX_RELAYED])}
    control = control_text(printable(message.driver), message.estop, operators)
    statuses = [NodeStatus('', WARN if message.estop else OK, control, {'side': ROBOT, 'control': control})]
    for stream in message.streams[:MAX_RELAYED]:
        if stream.type in EXCHANGES:
            continue
        problem = problems.pop(printable(stream.name), '')
        rate = min([stream.rate] + [limit.value for limit in stream.granted if limit.name == 'rate'])
        statuses.append(NodeStatus(
            '', WARN if stream.paused or problem else OK,
            problem or (PAUSED if stream.paused else 'fine'), {
                'side': ROBOT, 'stream': printable(stream.name), 'topic': '',
                'at most [Hz]': str(rate if stream.enabled and not stream.paused else 0.0)}))
    return statuses + [NodeStatus('', WARN, why, {'side': ROBOT, 'stream': name, 'topic': ''})
                       for name, why in problems.items()]


def relayed_diagnostics(message: Any) -> List[NodeStatus]:
    """The statuses of robots in relayed diagnostics; with a shared master those of operators are relayed, too."""
    return [status for status in map(as_status, message.status)
            if status is not None and status.values['side'] == ROBOT]


RELAYED = {LinkStatus: relayed_link, RobotStatus: relayed_streams, DiagnosticArray: relayed_diagnostics}
"""{message type: f(message) -> statuses}"""

NOT_RELAYED = '/diagnostics', '/diagnostics_agg'
"""Topics of these types that are not relays."""


class Listener:
    """Fills a board from /diagnostics and from relayed topics.

    :param only: see link_table.render
    """

    def __init__(self, only: str = '') -> None:
        self._only = only
        self._board, self._lock = Board(), threading.Lock()
        self._relays: Set[str] = set()      # topics
        with udpros.registered_together():      # in one call, for the sake of a bad link
            rospy.Subscriber('/diagnostics', DiagnosticArray, self._add, queue_size=20)
            for usual in {'/operator/', '/%s/operator/' % only.strip('/') if only else '/operator/'}:
                self._subscribe(usual + 'link', LinkStatus)
                self._subscribe(usual + 'status', RobotStatus)
                self._subscribe(usual + 'diagnostics', DiagnosticArray)
        # an error is not logged: the terminal shows the table, and the search is repeated
        self._search = PeriodicWorker('relays', self._find_relays, lambda error: None, SEARCH_PERIOD)
        self._search.wake()
        self._search.start()

    def _add(self, message: Any) -> None:
        statuses = [status for status in map(as_status, message.status) if status is not None]
        with self._lock:
            self._board.add(statuses, time.monotonic())

    def _find_relays(self) -> None:
        """Subscribe to the topics on which operators' nodes relay what robots report: robots publish private ones."""
        types = dict(rpc.call(rosgraph.get_master_uri(), 'getTopicTypes'))
        for topic, nodes in rpc.call(rosgraph.get_master_uri(), 'getSystemState')[0]:
            if topic not in NOT_RELAYED and any(not topic.startswith(node + '/') for node in nodes):
                for class_ in RELAYED:
                    if types.get(topic) == class_._type:
                        self._subscribe(topic, class_)

    def _subscribe(self, topic: str, class_: Any) -> None:
        if topic not in self._relays:
            self._relays.add(topic)
            rospy.Subscriber(topic, class_, self._add_relayed, RELAYED[class_], queue_size=5)

    def _add_relayed(self, message: Any, read: Callable[[Any], List[NodeStatus]]) -> None:
        statuses = read(message)
        if statuses:
            with self._lock:
                self._board.add_relayed(_node(message._connection_header['callerid']), message._type, statuses,
                                        time.monotonic())

    @property
    def sides(self) -> Set[str]:
        """The sides whose diagnostics came."""
        with self._lock:
            return self._board.sides

    def lines(self, short: bool = False) -> Tuple[List[Line], List[Line]]:
        """The table now, see link_table.render."""
        with self._lock:
            return render(self._board, time.monotonic(), self._only, short)

    def tree(self) -> Tree:
        """All values now, see link_snapshot.snapshot."""
        with self._lock:
            return snapshot(self._board, time.monotonic(), self._only)


def show(screen: Any, listener: Listener) -> None:
    """Draw until q is pressed.

    :param screen: a curses window
    """
    colours = _prepare(screen)
    scrolled = 0
    while True:
        rows, columns = screen.getmaxyx()
        top, body = listener.lines()
        page = max(1, rows - len(top))
        scrolled = max(0, min(scrolled, len(body) - page))
        screen.erase()
        for row, line in enumerate((top + body[scrolled:])[:rows]):
            # the last column stays free: writing the screen's last cell is an error in curses
            with contextlib.suppress(curses.error):
                screen.addnstr(row, 0, line.text, columns - 1)
                screen.chgat(row, 0, min(6, columns - 1), colours.get(line.level, 0))
        screen.refresh()
        key = screen.getch()
        if key == ord('q'):
            return
        scrolled += {curses.KEY_DOWN: 1, curses.KEY_UP: -1, curses.KEY_NPAGE: page, curses.KEY_PPAGE: -page}.get(key, 0)


def _prepare(screen: Any) -> Dict[Optional[int], int]:
    """Set the terminal up; returns {level: attribute}."""
    screen.timeout(int(1e3 * REFRESH_PERIOD))
    with contextlib.suppress(curses.error):     # not supported by every terminal
        curses.curs_set(0)
    with contextlib.suppress(curses.error):
        curses.use_default_colors()
        for level, colour in enumerate(('GREEN', 'YELLOW', 'RED', 'MAGENTA')):
            curses.init_pair(level + 1, getattr(curses, 'COLOR_' + colour), -1)
        return {level: curses.color_pair(level + 1) | curses.A_BOLD for level in LEVELS}
    return {1: curses.A_BOLD, 2: curses.A_REVERSE, STALE: curses.A_REVERSE}


def print_json(listener: Listener) -> None:
    """Print all values as an object of one line."""
    print(json.dumps({'time': round(time.time(), 3), **listener.tree()}, allow_nan=False), flush=True)


def print_objects(listener: Listener) -> int:
    """Print an object periodically, until nobody reads it."""
    while True:
        print_json(listener)
        time.sleep(JSON_PERIOD)


def print_once(listener: Listener, wait: float, as_json: bool, whole: bool) -> int:
    """Print the table or an object once, when both sides have reported or after `wait` [s]; returns the exit code.

    :param whole: whether the table has connections and streams that do nothing, too
    """
    deadline = time.monotonic() + wait
    while time.monotonic() < deadline and len(listener.sides) < 2:
        time.sleep(0.05)
    top, body = listener.lines(not whole)
    if as_json:
        print_json(listener)
    if not body:
        return fail('link_top', 'no report of robot_sender or operator_receiver on /diagnostics within %g s: '
                    'neither runs at this master, or it waits, and its log says why' % wait)
    if not as_json:
        print('\n'.join(line.text for line in top + body), flush=True)
    return 0


def show_live(listener: Listener, plain: bool) -> int:
    """Show the table until it is quit, by rich if it is installed; returns the exit code."""
    if not plain:
        view, problem = optional.attempt(VIEW, 'rich')  # Ubuntu 20.04 has none
        if view is not None:
            view.show(listener.tree, time.monotonic, REFRESH_PERIOD)
            return 0
        print('link_top: %s (python3-rich): the table is text, as with --plain' % problem, file=sys.stderr)
    try:
        curses.wrapper(show, listener)
    except curses.error as error:
        return fail('link_top', 'this terminal cannot show the table (%s); --once prints it' % error)
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Show or print the table; returns the exit code."""
    if not (arguments.once or arguments.json or is_terminal()):
        return fail('link_top', 'this is not a terminal; --once prints the table, --json its values')
    if not master_answers():
        return fail('link_top', 'no ROS master answers at %s' % rosgraph.get_master_uri())
    rospy.init_node('link_top', anonymous=True, disable_signals=True, log_level=rospy.FATAL)
    listener = Listener(arguments.operator)
    if arguments.once:
        return print_once(listener, arguments.wait, arguments.json, arguments.all)
    return print_objects(listener) if arguments.json else show_live(listener, arguments.plain)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='link_top', description="Show the link's streams and connections live.",
        epilog='The arrow and page keys scroll; q or Ctrl-C quits.')
    parser.add_argument('--once', action='store_true', help='print the table of streams once and exit')
    parser.add_argument('--all', action='store_true', help='with --once: all connections, too')
    parser.add_argument('--json', action='store_true',
                        help='print all values as a JSON object on a line of its own, once a second')
    parser.add_argument('--plain', action='store_true', help='the table of text, as without the Python module rich')
    parser.add_argument('--wait', type=float, default=3.0, metavar='SECONDS',
                        help='with --once: how long to wait for both sides (default: %(default)s)')
    parser.add_argument('--operator', default='', metavar='NAME',
                        help='show this operator only: the `name` of operator.launch, or the name of its node')
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    udpros.race_all_connections()
    run_node(lambda: run(arguments))
