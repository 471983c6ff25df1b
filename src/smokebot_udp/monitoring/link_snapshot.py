# SPDX-License-Identifier: BSD-3-Clause
"""The newest reports of all nodes as one tree of plain values: for `link_top --json`, and for its tables and plots.

doc/monitoring.md lists the keys. A value that is unknown is None.
"""
import math
from typing import Any, Dict, Mapping, NamedTuple, Optional, Sequence, Tuple

from .link_board import LEVELS, STALE, Board, NodeStatus
from .link_table import NOT_REPORTED, sections_of, streams_of
from .status import OPERATOR, ROBOT, TO_ROBOT

Tree = Dict[str, Any]
Fields = Mapping[str, Tuple[str, float]]
"""{key: (key of the status, factor)}"""

LINK: Fields = {
    'rate_mbit': ('rate [Mbit/s]', 1.0), 'sent_mbit': ('sent [Mbit/s]', 1.0), 'wanted_mbit': ('wanted [Mbit/s]', 1.0),
    'capacity_mbit': ('capacity [Mbit/s]', 1.0), 'loss': ('loss [%]', 0.01), 'queue_delay': ('queue delay [ms]', 1e-3),
    'round_trip': ('round trip [ms]', 1e-3)}

CLOCK: Fields = {'offset': ('offset [ms]', 1e-3), 'uncertainty': ('uncertainty [ms]', 1e-3)}

WIFI: Fields = {
    'signal_dbm': ('signal [dBm]', 1.0), 'noise_dbm': ('noise [dBm]', 1.0),
    'tx_bitrate_mbit': ('tx bitrate [Mbit/s]', 1.0), 'rx_bitrate_mbit': ('rx bitrate [Mbit/s]', 1.0),
    'retries': ('retries [1/s]', 1.0), 'failed': ('failed [1/s]', 1.0), 'beacon_loss': ('beacon loss [1/s]', 1.0)}

CONNECTION: Fields = {
    'datagrams': ('datagrams', 1.0), 'loss': ('loss [%]', 0.01), 'bytes_per_second': ('bytes/s', 1.0),
    'kernel_drops': ('kernel drops', 1.0)}

SENDER: Fields = {'source_hz': ('rate in [Hz]', 1.0), 'sent_hz': ('rate out [Hz]', 1.0)}
RECEIVER: Fields = {
    'received_hz': ('rate in [Hz]', 1.0), 'shown_hz': ('rate out [Hz]', 1.0), 'loss': ('loss [%]', 0.01),
    'age_median': ('age p50 [ms]', 1e-3), 'age_p99': ('age p99 [ms]', 1e-3)}


class Key(NamedTuple):
    """Names one number of a tree over time."""
    part: str
    """robots or streams"""
    owner: str
    """A robot's node, or an operator's; of streams that no operator receives the robot's."""
    stream: str
    """Empty: of the link as a whole."""
    name: str
    """In the tree."""


PLOTTED = {'robots': ('sent_mbit', 'capacity_mbit', 'loss', 'queue_delay'),
           'streams': ('shown_hz', 'loss', 'age_median')}
"""{part: names of the numbers that are plotted over time}"""


def snapshot(board: Board, now: float, only: str = '') -> Tree:
    """The tree of a board.

    :param only: see link_table.render
    """
    statuses, sections = sections_of(board, now, only)
    age = board.age(now)
    nodes = list(dict.fromkeys(status.node for status in statuses))
    sides = {status.node: status.values['side'] for status in statuses}
    own = {node: [status for status in statuses if status.node == node] for node in nodes}
    return {
        'last_report_age': None if age is None else round(age, 3),
        'robots': [_robot(node, own[node]) for node in nodes if sides[node] == ROBOT],
        'operators': [{**_operator(node, own[node]), 'receives_from': section.robots} for node in nodes
                      for section in sections if sides[node] == OPERATOR and section.operator == node],
        'streams': [{'robots': section.robots, 'operator': section.operator,
                     **_stream(name, by_side.get(ROBOT, NOT_REPORTED), by_side.get(OPERATOR, NOT_REPORTED))}
                    for section in sections for name, by_side in streams_of(section, statuses).items()],
        'connections': [{'node': status.node, **_judged(status), 'stream': status.stream,
                         'peer': status.values['peer'], 'address': status.values.get('address'),
                         **_numbers(status, CONNECTION)} for status in statuses if status.kind == 'connection']}


def plotted(tree: Tree) -> Dict[Key, Optional[float]]:
    """The numbers of a tree that are plotted over time."""
    links = {Key('robots', robot['node'], '', name): (robot['link'] or {}).get(name)
             for robot in tree['robots'] for name in PLOTTED['robots']}
    return {**links, **{stream_key(stream, name): stream[name]
                        for stream in tree['streams'] for name in PLOTTED['streams']}}


def stream_key(stream: Tree, name: str) -> Key:
    """The key of a number of one of a tree's streams."""
    return Key('streams', stream['operator'] or ''.join(stream['robots'][:1]), stream['stream'], name)


def _robot(node: str, statuses: Sequence[NodeStatus]) -> Tree:
    control = _first(statuses, 'control')
    return {**_node(node, statuses), 'link': _part(_first(statuses, 'link'), LINK, 'state'),
            'control': control.values['control'] if control else None}


def _operator(node: str, statuses: Sequence[NodeStatus]) -> Tree:
    clock = _first(statuses, 'clock')
    return {**_node(node, statuses), 'clock': _part(clock, CLOCK)}


def _node(node: str, statuses: Sequence[NodeStatus]) -> Tree:
    """What both sides have."""
    wifi = _first(statuses, 'wifi')
    known = wifi if wifi and wifi.values['wifi'] != '-' else None
    worst = max(status.level for status in statuses)
    return {'node': node, 'level': LEVELS[worst],
            'problems': sorted({status.message for status in statuses
                                if status.level and status.kind not in ('stream', 'connection')}),
            'wifi': known and {'interface': known.values['wifi'], 'ssid': known.values.get('ssid'),
                               **_numbers(known, WIFI)}}


def _stream(name: str, robot: NodeStatus, operator: NodeStatus) -> Tree:
    back = TO_ROBOT in (robot.values.get('direction'), operator.values.get('direction'))
    sender, receiver = (operator, robot) if back else (robot, operator)
    counted = robot if operator is NOT_REPORTED else operator
    return {
        'stream': name, 'to_robot': back, 'level': LEVELS[max(robot.level, operator.level)],
        'problems': ['%s: %s' % (status.values['side'], status.message) for status in (robot, operator)
                     if status.level],
        **_numbers(sender, SENDER), 'sent_at_most_hz': _number(robot, 'at most [Hz]'), **_numbers(receiver, RECEIVER),
        'completeness': _number(operator, 'completeness [%]', 0.01), 'error': operator.values.get('error'),
        'bytes_per_second': _number(counted, 'bytes/s')}


def _judged(status: NodeStatus) -> Tree:
    return {'level': LEVELS[status.level], 'problems': [status.message] if status.level else []}


def _first(statuses: Sequence[NodeStatus], kind: str) -> Optional[NodeStatus]:
    return next((status for status in statuses if status.kind == kind and status.level != STALE), None)


def _part(status: Optional[NodeStatus], fields: Fields, *texts: str) -> Optional[Tree]:
    return status and {**{text: status.values.get(text) for text in texts}, **_numbers(status, fields)}


def _numbers(status: NodeStatus, fields: Fields) -> Tree:
    return {name: _number(status, key, factor) for name, (key, factor) in fields.items()}


def _number(status: NodeStatus, key: str, factor: float = 1.0) -> Optional[float]:
    """A finite number of a status times `factor`; None: there is none, or it is too old."""
    try:
        number = float(status.values.get(key, '')) * factor
    except ValueError:
        return None
    return round(number, 6) if math.isfinite(number) and status.level != STALE else None
