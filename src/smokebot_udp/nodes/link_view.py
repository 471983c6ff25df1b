# SPDX-License-Identifier: BSD-3-Clause
"""link_top's view where the Python module rich is installed: robots and operators apart, with the last minute as
sparklines. Texts are shown as they are: rich's markup has no effect in them.
"""
import os
import select
import sys
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence

from rich.console import Console, Group
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from ..monitoring.history import ASCII_BARS, BARS, History, sparkline
from ..monitoring.link_snapshot import Key, Tree, plotted, stream_key
from ..monitoring.link_table import offset_text
from .terminal import single_keys

STYLES = {'OK': 'bold green', 'WARN': 'bold yellow', 'ERROR': 'bold red', 'STALE': 'bold magenta'}

SCROLLING = {b'\x1b[A': (-1, 0), b'\x1b[B': (1, 0), b'\x1b[5~': (0, -1), b'\x1b[6~': (0, 1)}
"""{key: (lines, pages)}"""

WIDE, MEDIUM = 150, 110
"""Widths of a terminal from which on sparklines are longer."""


class LinkView:
    """Makes what rich renders of trees, see monitoring/link_snapshot.py.

    :param width: f() -> of the terminal
    :param bars: signs of sparklines, ascending
    """

    def __init__(self, width: Callable[[], int], bars: str = BARS) -> None:
        self._width, self._bars = width, bars
        self._history: History[Key] = History()
        self._now = 0.0

    def render(self, tree: Tree, now: float) -> Group:
        """The view of a tree, by time.monotonic()."""
        self._history.add(plotted(tree), now)
        self._now = now
        age = tree['last_report_age']
        head = 'no report on /diagnostics yet' if age is None else 'last report %.1f s ago' % age
        parts: List[Any] = [Text('smokebot_udp link: ' + head)]
        parts += [table for table in (
            self._robots(tree['robots']), _operators(tree['operators']),
            _wifi([*tree['robots'], *tree['operators']])) if table.row_count]
        for title, streams in _sections(tree['streams']).items():
            parts.append(self._streams(title, streams))
        if tree['connections']:
            parts.append(_connections(tree['connections']))
        return Group(*parts)

    def _robots(self, robots: Sequence[Tree]) -> Table:
        table = _table('Robots', ('LEVEL', 'ROBOT'), ('SENT Mbit/s', 'CAPACITY', 'LOSS %', 'QUEUE ms', 'RTT ms'),
                       ('STATE',))
        for robot in robots:
            link = robot['link'] or {}
            cells = [self._plot(Key('robots', robot['node'], '', name), link.get(name), digits, factor)
                     for name, digits, factor in (('sent_mbit', 1, 1.0), ('capacity_mbit', 1, 1.0), ('loss', 0, 100.0),
                                                  ('queue_delay', 0, 1e3))]
            states: List[str] = [text for text in (robot['control'], link.get('state')) if text]
            states += [problem for problem in robot['problems'] if problem not in states]
            _row(table, robot['level'], [
                robot['node'], *cells, _number(link.get('round_trip'), 0, 1e3), '; '.join(states)])
        return table

    def _streams(self, title: str, streams: Sequence[Tree]) -> Table:
        table = _table(title, ('LEVEL', 'STREAM'), ('SOURCE', 'SENT', 'CAME', 'SHOWN Hz', 'LOSS %', 'COMPL %', 'ERROR',
                                                    'AGE ms', 'p99', 'kB/s'), ('',))
        for stream in streams:
            most = stream['sent_at_most_hz']
            _row(table, stream['level'], [
                stream['stream'], _number(stream['source_hz'], 1),
                _number(stream['sent_hz'], 1) if most is None else '<=%.1f' % most, _number(stream['received_hz'], 1),
                self._plot(stream_key(stream, 'shown_hz'), stream['shown_hz'], 1),
                self._plot(stream_key(stream, 'loss'), stream['loss'], 1, 100.0),
                _number(stream['completeness'], 0, 100.0), stream['error'] or '-',
                self._plot(stream_key(stream, 'age_median'), stream['age_median'], 0, 1e3),
                _number(stream['age_p99'], 0, 1e3), _number(stream['bytes_per_second'], 1, 1e-3),
                '; '.join(stream['problems'])])
        return table

    def _plot(self, key: Key, value: Optional[float], digits: int, factor: float = 1.0) -> str:
        """A number with its sparkline."""
        columns = self._width()
        width = 20 if columns >= WIDE else 10 if columns >= MEDIUM else 5
        line = sparkline(self._history.series(key, self._now), width, self._bars)
        return '%s %s' % (_number(value, digits, factor), line)


class _Window:
    """What rich renders of a part of a content, from a line on.

    :param scroll: f(number of lines, height) -> the first line shown
    """

    def __init__(self, content: Any, scroll: Callable[[int, int], int]) -> None:
        self._content, self._scroll = content, scroll

    def __rich_console__(self, console: Any, options: Any) -> Iterable[Any]:
        lines = console.render_lines(self._content, options.update(height=None), pad=False)
        height = options.height or console.height
        first = self._scroll(len(lines), height)
        for line in lines[first:first + height]:
            yield from line
            yield Segment.line()


class _Scroll:
    """The first line that is shown, as keys change it."""

    def __init__(self) -> None:
        self._first, self._lines, self._pages = 0, 0, 0

    def press(self, key: bytes) -> None:
        lines, pages = SCROLLING.get(key, (0, 0))
        self._lines += lines
        self._pages += pages

    def __call__(self, lines: int, height: int) -> int:
        wanted = self._first + self._lines + self._pages * height
        self._first, self._lines, self._pages = max(0, min(wanted, lines - height)), 0, 0
        return self._first


def show(take: Callable[[], Tree], clock: Callable[[], float], period: float) -> None:
    """Draw until q is pressed, or the terminal is closed.

    :param take: f() -> the tree now
    :param clock: f() -> time, of a monotonic clock [s]
    :param period: time between two drawings [s]
    """
    console, scroll = Console(), _Scroll()
    view = LinkView(lambda: console.width, BARS if 'utf' in console.encoding else ASCII_BARS)
    with single_keys(sys.stdin.fileno()), console.screen() as screen:
        while True:
            screen.update(_Window(view.render(take(), clock()), scroll))
            if select.select([sys.stdin], [], [], period)[0]:
                typed = os.read(sys.stdin.fileno(), 64)
                if not typed or b'q' in typed:
                    return
                scroll.press(typed)


def _operators(operators: Sequence[Tree]) -> Table:
    table = _table('Operators', ('LEVEL', 'OPERATOR', 'RECEIVES FROM'), ('CLOCK', '+- ms'), ('',))
    for operator in operators:
        clock = operator['clock'] or {}
        offset = clock.get('offset')
        _row(table, operator['level'], [
            operator['node'], ', '.join(operator['receives_from']) or '-',
            '-' if offset is None else offset_text(str(1e3 * offset)),
            _number(clock.get('uncertainty'), 1, 1e3), '; '.join(operator['problems'])])
    return table


def _connections(connections: Sequence[Tree]) -> Table:
    table = _table('Connections', ('LEVEL', 'NODE', 'STREAM', 'PEER', 'ADDRESS'),
                   ('DATAGRAMS', 'LOSS %', 'kB/s', 'DROPS'), ('',))
    for one in connections:
        _row(table, one['level'], [
            one['node'], one['stream'], one['peer'], one['address'] or '-', _number(one['datagrams'], 0),
            _number(one['loss'], 1, 100.0), _number(one['bytes_per_second'], 1, 1e-3),
            _number(one['kernel_drops'], 0), '; '.join(one['problems'])])
    return table


def _sections(streams: Sequence[Tree]) -> Dict[str, List[Tree]]:
    """{title: streams}, by operator and robot."""
    sections: Dict[str, List[Tree]] = {}
    for stream in streams:
        robots = ', '.join(stream['robots']) or 'no robot that reports'
        title = 'Streams of %s' % robots + (' at %s' % stream['operator'] if stream['operator'] else '')
        sections.setdefault(title, []).append(stream)
    return sections


def _table(title: str, names: Sequence[str], numbers: Sequence[str], texts: Sequence[str]) -> Table:
    table = Table(title=Text(title, 'bold'), title_justify='left', box=None, pad_edge=False, header_style='dim')
    for headings, justify in (names, 'left'), (numbers, 'right'), (texts, 'left'):
        for heading in headings:
            table.add_column(Text(heading), justify=justify, no_wrap=headings is not texts)
    return table


def _row(table: Table, level: str, cells: Sequence[str]) -> None:
    table.add_row(Text(level, STYLES[level]), *map(Text, cells))


def _wifi(nodes: Sequence[Tree]) -> Table:
    """The interfaces of robots and operators; - where there is none."""
    table = _table('Wi-Fi', ('NODE', 'INTERFACE', 'SSID'), ('SIGNAL dBm', 'NOISE dBm', 'TX Mbit/s', 'RX Mbit/s',
                                                            'RETRIES/s', 'FAILED/s', 'BEACON LOSS/s'), ())
    for node in nodes:
        wifi = node['wifi'] or {}
        table.add_row(*map(Text, [
            node['node'], wifi.get('interface') or '-', wifi.get('ssid') or '-',
            *(_number(wifi.get(name), digits) for name, digits in (
                ('signal_dbm', 0), ('noise_dbm', 0), ('tx_bitrate_mbit', 1), ('rx_bitrate_mbit', 1), ('retries', 1),
                ('failed', 1), ('beacon_loss', 1)))]))
    return table


def _number(value: Optional[float], digits: int, factor: float = 1.0) -> str:
    return '-' if value is None else '%.*f' % (digits, value * factor)
