# SPDX-License-Identifier: BSD-3-Clause
"""Shows the link's streams and connections live in a terminal, from what both sides publish on /diagnostics.

With a shared master the robot's diagnostics cross the link by TCP. What the operator's side relays of them, or else of
the robot's ~link and ~status, crosses by UDP, and replaces them where they do not come.
"""
import argparse
import curses
import json
import sys
import threading
import time
from typing import Any, List, Optional, Set

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray

from .. import udpros
from ..monitoring.link_board import Board
from ..monitoring.link_snapshot import Tree, snapshot
from ..monitoring.link_table import render
from ..monitoring.plots import Plots
from ..msg import LinkStatus, RobotStatus
from ..udpros import rpc
from .link_view import show
from .status_messages import RELAYED, full_name, statuses_of
from .terminal import fail, is_terminal, master_answers, run_node
from .worker import PeriodicWorker

JSON_PERIOD = 1.0
"""How often --json prints an object; nodes report once a second [s]."""

SEARCH_PERIOD = 5.0
"""How often the master is asked for relayed topics [s]."""

NOT_RELAYED = '/diagnostics', '/diagnostics_agg'
"""Topics of these types that are not relays."""


class BoardListener:
    """Fills a board from /diagnostics and from relayed topics.

    :param only: as of link_snapshot.snapshot
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
        with self._lock:
            self._board.add(statuses_of(message.status), time.monotonic())

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
            rospy.Subscriber(topic, class_, self._add_relayed, queue_size=5)

    def _add_relayed(self, message: Any) -> None:
        statuses, operator = RELAYED[type(message)](message), full_name(message._connection_header['callerid'])
        if statuses:
            with self._lock:
                self._board.add_relayed(operator, message._type, statuses, time.monotonic())

    @property
    def sides(self) -> Set[str]:
        """The sides whose diagnostics came."""
        with self._lock:
            return self._board.sides

    def tree(self) -> Tree:
        """All values now, see link_snapshot.snapshot."""
        with self._lock:
            return snapshot(self._board, time.monotonic(), self._only)

    def table(self, plots: Optional[Plots] = None, short: bool = False) -> List[str]:
        """The table now, see link_table.render."""
        return render(self.tree(), self._only, short, plots)


def print_json(tree: Tree) -> None:
    """Print all values as an object of one line."""
    print(json.dumps({'time': round(time.time(), 3), **tree}, allow_nan=False), flush=True)


def print_objects(listener: BoardListener) -> int:
    """Print an object periodically, until nobody reads it."""
    while True:
        print_json(listener.tree())
        time.sleep(JSON_PERIOD)


def print_once(listener: BoardListener, wait: float, as_json: bool, whole: bool) -> int:
    """Print the table or an object once, when both sides have reported or after `wait` [s]; returns the exit code.

    :param whole: whether the table has connections that are fine, too
    """
    deadline = time.monotonic() + wait
    while time.monotonic() < deadline and len(listener.sides) < 2:
        time.sleep(0.05)
    tree = listener.tree()
    if as_json:
        print_json(tree)
    if tree['last_report_age'] is None:
        return fail('link_top', 'no report of robot_sender or operator_receiver on /diagnostics within %g s: '
                    'neither runs at this master, or it waits, and its log says why' % wait)
    if not as_json:
        print('\n'.join(listener.table(short=not whole)), flush=True)
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Show or print the table or its values; returns the exit code."""
    if not (arguments.once or arguments.json or is_terminal()):
        return fail('link_top', 'this is not a terminal; --once prints the table, --json its values')
    if not master_answers():
        return fail('link_top', 'no ROS master answers at %s' % rosgraph.get_master_uri())
    rospy.init_node('link_top', anonymous=True, disable_signals=True, log_level=rospy.FATAL)
    listener = BoardListener(arguments.operator)
    if arguments.once:
        return print_once(listener, arguments.wait, arguments.json, arguments.all)
    if arguments.json:
        return print_objects(listener)
    try:
        curses.wrapper(show, listener.table, arguments.plain)
    except curses.error as error:
        return fail('link_top', 'this terminal cannot show the table (%s); --once prints it' % error)
    return 0


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='link_top', description="Show the link's streams and connections live.",
        epilog='The arrow and page keys scroll; q or Ctrl-C quits.')
    parser.add_argument('--once', action='store_true', help='print the table of streams once and exit')
    parser.add_argument('--all', action='store_true', help='with --once: all connections, too')
    parser.add_argument('--json', action='store_true',
                        help='print all values as a JSON object on a line of its own, once a second')
    parser.add_argument('--plain', action='store_true', help='the live view without sparklines')
    parser.add_argument('--wait', type=float, default=3.0, metavar='SECONDS',
                        help='with --once: how long to wait for both sides (default: %(default)s)')
    parser.add_argument('--operator', default='', metavar='NAME',
                        help='show this operator only: the `name` of operator.launch, or the name of its node')
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    udpros.race_all_connections()
    run_node(lambda: run(arguments))
