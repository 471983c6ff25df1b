# SPDX-License-Identifier: BSD-3-Clause
"""The table of link_top: the tree of link_snapshot as lines of text, with sparklines where they are wanted."""
import re
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence

from .link_snapshot import Tree
from .plots import Plots
from .status import OPERATOR, ROBOT, Kind

UNITS = ('days', 86400.0, 1), ('h', 3600.0, 2), ('min', 60.0, 1), ('s', 1.0, 2), ('ms', 1e-3, 1)
"""(name, [s], digits) of an offset: a clock of another epoch is off by years."""


class Column(NamedTuple):
    """A column of a table."""
    heading: str
    width: int
    """Width [characters]; negative: left-aligned."""
    name: str
    """Name of the value in the tree. The value is a number, or a text, which is truncated to the width."""
    digits: int = 0
    factor: float = 1.0
    plotted: bool = False


STREAM_COLUMNS = (
    Column('LEVEL', -6, 'level'), Column('STREAM', -18, 'stream'), Column('SOURCE', 7, 'source_hz', 1),
    Column('SENT', 6, 'sent_hz', 1), Column('CAME', 6, 'received_hz', 1), Column('SHOWN', 6, 'shown_hz', 1, 1.0, True),
    Column('LOSS %', 7, 'loss', 1, 100.0, True), Column('COMPL %', 8, 'completeness', 0, 100.0),
    Column('ERROR', 13, 'error'), Column('AGE ms', 8, 'age_median', 0, 1e3, True), Column('p99', 7, 'age_p99', 0, 1e3),
    Column('kB/s', 8, 'bytes_per_second', 1, 1e-3))
"""The rates [Hz] are those of the source, of the messages sent (<= the most that may be, where only that is known), of
those received, and of those published. The source of commands is at the operator's side, all others are at the robot.
The error is that of layered images, the median."""

CONNECTION_COLUMNS = (
    Column('LEVEL', -6, 'level'), Column('STREAM', -18, 'stream'), Column('SIDE', -9, 'side'),
    Column('PEER', -24, 'peer'), Column('ADDRESS', -22, 'address'), Column('DATAGRAMS', 11, 'datagrams'),
    Column('LOSS %', 7, 'loss', 1, 100.0), Column('kB/s', 8, 'bytes_per_second', 1, 1e-3),
    Column('DROPS', 7, 'kernel_drops'))
"""Drops are the kernel's: the socket's receive buffer was full. With own masters all streams have one socket, and these
are shares of its drops."""

MAX_NAME = 40
"""A longer name of a stream is cut [characters]."""


def render(tree: Tree, only: str = '', short: bool = False, plots: Optional[Plots] = None) -> List[str]:
    """The whole table. The first word of a line with a level is that.

    :param only: as of link_snapshot.snapshot
    :param short: without connections that are fine
    """
    plots = plots or Plots()
    age, robots, operators = tree['last_report_age'], tree['robots'], tree['operators']
    if age is None:
        return ['smokebot_udp link: no report on /diagnostics yet']
    missing = [side for side, nodes in ((ROBOT, robots), ((OPERATOR + ' ' + only).rstrip(), operators)) if not nodes]
    lines = ['smokebot_udp link: last report %.1f s ago' % age + ''.join(
        ', no report of the %s' % side for side in missing)]
    lines += _node_lines(tree['statuses'], {node['node']: node for node in robots + operators},
                         {Kind.LINK: len(robots) > 1, Kind.CLOCK: len(operators) > 1}, plots)
    received = {robot for operator in operators for robot in operator['receives_from']}
    sections = {operator['node']: '%s receives from %s' % (
        operator['node'], ', '.join(operator['receives_from']) or 'no robot that reports') for operator in operators}
    sections.update((robot['node'], robot['node']) for robot in robots if robot['node'] not in received)
    columns = _fitted(STREAM_COLUMNS, tree['streams'])
    for owner, title in sections.items():
        lines += ['', title] if len(sections) > 1 else []
        lines += [_headings(columns, plots)] + [
            _row(columns, _with_limit(stream), plots, owner) for stream in tree['streams']
            if owner == (stream['operator'] or stream['robots'][0])]
    columns = _fitted(CONNECTION_COLUMNS, tree['connections'])
    connections = [_row(columns, one, plots) for one in tree['connections'] if one['level'] != 'OK' or not short]
    return lines + (['', _headings(columns, plots), *connections] if connections else [])


def _fitted(columns: Sequence[Column], items: Sequence[Tree]) -> Sequence[Column]:
    """The columns, the one of the streams' names wide enough for the longest."""
    longest = max((len(item['stream'] or '') for item in items), default=0)
    return [column._replace(width=min(column.width, -min(longest, MAX_NAME))) if column.name == 'stream' else column
            for column in columns]


def _node_lines(statuses: Sequence[Tree], nodes: Dict[str, Tree], several: Dict[str, bool], plots: Plots) -> List[str]:
    """A line for each status of a node as a whole, by kind: those that have a text of their own, then the others.

    :param several: {kind: whether several nodes have it, so that their names are needed}
    """
    lines = []
    for kind, text in TEXTS.items():
        for status in statuses:
            if status['kind'] == kind:
                whose = ' of ' + status['node'] if several.get(kind) else ''
                lines.append('%-6s %s' % (status['level'], text(status, nodes[status['node']].get(kind), whose, plots)))
    for status in statuses:
        if status['kind'] in (Kind.SETTINGS, Kind.REQUESTS, Kind.REFUSED, Kind.COMPUTER):
            if status['level'] != 'OK':
                subject = "%s's computer" if status['kind'] == Kind.COMPUTER else '%s'
                lines.append('%-6s %s: %s' % (status['level'], subject % status['node'], status['message']))
        elif status['kind'] not in TEXTS:   # of another release
            lines.append('%-6s %s: %s: %s' % (status['level'], status['node'], status['name'], status['message']))
    return list(dict.fromkeys(lines))


def _link(status: Tree, link: Optional[Tree], whose: str, plots: Plots) -> str:
    values, message = link or {}, status['message']

    def plotted(name: str, digits: int, factor: float = 1.0) -> str:
        return number(values.get(name), digits, factor) + plots.line((status['node'], '', name), values.get(name))
    state = values.get('state') or message
    if status['level'] != 'OK':
        state = message if state in message else '; '.join((state, message))
    return 'link%s: %s of %s Mbit/s sent, %s wanted, %s carried; queue %s ms, loss %s %%, round trip %s ms%s; %s' % (
        whose, plotted('sent_mbit', 1), number(values.get('rate_mbit'), 1), number(values.get('wanted_mbit'), 1),
        plotted('capacity_mbit', 1), plotted('queue_delay', 0, 1e3), plotted('loss', 0, 100.0),
        number(values.get('round_trip'), 0, 1e3),
        ''.join('; by %s %s' % path for path in values.get('paths', {}).items()), state)


def _clock(status: Tree, clock: Optional[Tree], whose: str, plots: Plots) -> str:
    if not clock or clock['offset'] is None:
        return 'clock%s: %s' % (whose, status['message'])
    return "clock%s: the robot's is %s +- %s ms, round trip %s ms" % (
        whose, offset_text(clock['offset']), number(clock['uncertainty'], 1, 1e3), number(clock['round_trip'], 1, 1e3))


def _control(status: Tree, control: Optional[str], whose: str, plots: Plots) -> str:
    return '%s: %s' % (status['node'], control or status['message'])


def _transport(status: Tree, transport: Optional[Tree], whose: str, plots: Plots) -> str:
    if transport is None:
        return '%s: %s: %s' % (status['node'], status['name'], status['message'])
    peers = transport['connected_to'] or '-'
    reasons = ', '.join('%s %s' % (number(count), reason) for reason, count in transport['dropped_by_reason'].items())
    problem = re.sub(r' from ([^\s;]+)', lambda found: '' if found[1] in peers else found[0], status['message'])
    return '%s with %s; handshakes: %s; dropped: %s%s%s' % (
        status['node'], peers, number(transport['handshakes']),
        number(transport['dropped']), ' (%s)' % reasons if reasons else '',
        '; ' + problem if status['level'] != 'OK' else '')


def _wifi(status: Tree, wifi: Optional[Tree], whose: str, plots: Plots) -> str:
    text = status['message'] if status['level'] in ('WARN', 'ERROR') else '-' if wifi is None else \
        '%s%s: signal %s dBm, noise %s dBm; sends at %s, receives at %s Mbit/s; %s retries/s, %s failed/s%s' % (
            wifi['interface'], ' in %s' % wifi['ssid'] if wifi['ssid'] else '',
            number(wifi['signal_dbm']), number(wifi['noise_dbm']), number(wifi['tx_bitrate_mbit'], 1),
            number(wifi['rx_bitrate_mbit'], 1), number(wifi['retries']), number(wifi['failed']),
            ', %s beacons lost/s' % number(wifi['beacon_loss'], 1) if wifi['beacon_loss'] else '')
    return 'Wi-Fi of %s: %s' % (status['node'], text)


TEXTS: Dict[str, Callable[[Tree, Any, str, Plots], str]] = {
    Kind.LINK: _link, Kind.CLOCK: _clock, Kind.CONTROL: _control, Kind.TRANSPORT: _transport, Kind.WIFI: _wifi}
"""{kind: f(status, what its node has of this kind, whose it is, plots) -> text}, in the order of the lines"""


def offset_text(seconds: float) -> str:
    """The offset of a clock in a readable unit."""
    unit, size, digits = next((unit for unit in UNITS if abs(seconds) >= unit[1]), UNITS[-1])
    return '%s by %.*f %s' % ('behind' if seconds < 0 else 'ahead', digits, abs(seconds) / size, unit)


def number(value: Optional[float], digits: int = 0, factor: float = 1.0) -> str:
    """A number times `factor`, rounded; - where it is unknown."""
    return '-' if value is None else '%.*f' % (digits, value * factor)


def _with_limit(stream: Tree) -> Tree:
    """A stream with the most that may be sent, where that is known, in place of what is."""
    most = stream['sent_at_most_hz']
    return stream if most is None else {**stream, 'sent_hz': '<=' + number(most, 1)}


def _headings(columns: Sequence[Column], plots: Plots) -> str:
    return ' '.join('%*s%s' % (column.width, column.heading, column.plotted * plots.width * ' ')
                    for column in columns).rstrip()


def _row(columns: Sequence[Column], item: Tree, plots: Plots, owner: str = '') -> str:
    """The values of an item in their columns, followed by its problems."""
    cells = []
    for column in columns:
        value = item[column.name]
        text = value[:abs(column.width)] if isinstance(value, str) else number(value, column.digits, column.factor)
        plot = plots.line((owner, item['stream'], column.name), value) if column.plotted else ''
        cells.append('%*s%s' % (column.width, text, plot))
    return '  '.join([' '.join(cells), *item['problems']]).rstrip()
