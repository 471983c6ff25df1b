# SPDX-License-Identifier: BSD-3-Clause
"""What is known of a robot, its link and this desk, as messages of doc/web_protocol.md."""
import math
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, Optional, Sequence

from ..codecs.display.overlay import EMERGENCY_STOP
from ..monitoring.link_snapshot import Tree
from ..monitoring.status import LEVELS, printable
from .frames import finite

MAX_TEXTS, MAX_TEXT = 20, 300
"""Problems or profiles of a robot, and letters of each, that are shown: they come over the link."""


@dataclass
class Known:
    """The newest messages about one robot. None: none came."""
    status: Any = None
    """RobotStatus."""
    link: Any = None
    """LinkStatus."""
    battery: Any = None
    """sensor_msgs/BatteryState."""
    gas: Dict[str, float] = field(default_factory=dict)
    """{stream: value}"""
    control: str = ''
    """The state in words, as on operator/control."""
    stops: int = 0
    """How many emergency stops were seen."""
    heard: float = -math.inf
    """When anything came from the robot, by a steady clock [s]."""
    linked: float = -math.inf
    """When `link` came [s]."""
    tree: Tree = field(default_factory=dict)
    """What link_top --json prints; of this robot alone."""
    paths: List[Dict[str, Any]] = field(default_factory=list)
    """By which this desk reaches the robot, see paths.paths_of."""


def overview_of(name: str, known: Known, now: float) -> Dict[str, Any]:
    """A robot in the overview.

    :param now: by a steady clock [s]
    """
    status, link = known.status, known.link
    return {
        'name': name, 'level': level_of(known, now), 'control': known.control,
        'driver': _text(status.driver) if status else '', 'estop': bool(status and status.estop),
        'silence': _since(known.heard, now), 'loss': finite(link.loss) if link else None,
        'capacity': finite(link.capacity) if link else None, 'signal': finite(link.wifi.signal) if link else None,
        'battery': finite(known.battery.percentage) if known.battery else None,
        'focus': _text(status.focus) if status else '', 'problems': problems_of(known)}


def state_of(known: Known, node: str, now: float) -> Dict[str, Any]:
    """The state of a robot, but who of this desk's browsers drives.

    :param node: name of this desk's operator_receiver
    :param now: by a steady clock [s]
    """
    status, battery = known.status, known.battery
    driver = _text(status.driver) if status else ''
    return {
        'type': 'state', 'level': level_of(known, now), 'silence': _since(known.heard, now),
        'control': known.control, 'driver': driver, 'mine': _same_node(driver, node),
        'estop': bool(status and status.estop) or known.control == EMERGENCY_STOP,
        'focus': _text(status.focus) if status else '', 'modified': bool(status and status.modified),
        'profiles': _texts(status.profiles) if status else [], 'problems': problems_of(known),
        'battery': None if battery is None else {'charge': finite(battery.percentage),
                                                 'voltage': finite(battery.voltage)},
        'gas': [{'name': name, 'value': finite(value), 'unit': ''} for name, value in sorted(known.gas.items())],
        'link': _link(known, now), 'wifi': _wifi(known.tree), 'streams': _streams(known.tree)}


def urgent(state: Mapping[str, Any]) -> Any:
    """What of a state is sent at once where it changes."""
    return [state[name] for name in ('control', 'driver', 'mine', 'estop', 'focus', 'profiles', 'problems', 'level')]


def level_of(known: Known, now: float) -> str:
    """The worst of a robot: ok, warn, error or stale."""
    since = now - known.heard
    if not since < 5.0:
        return 'stale'
    if since > 2.0 or (known.status and known.status.estop):
        return 'error'
    return 'warn' if problems_of(known) else 'ok'


def problems_of(known: Known) -> List[str]:
    """In words."""
    return _texts(known.status.problems) if known.status else []


def _same_node(driver: str, node: str) -> bool:
    """Whether a driver's name is that of a node; several of the same name have a machine's name after it."""
    return driver == node or driver.startswith(node + ' ')


def _link(known: Known, now: float) -> Dict[str, Any]:
    link = known.link
    return {**{name: finite(getattr(link, name)) if link else None
               for name in ('sent', 'rate', 'capacity', 'loss', 'round_trip', 'queue_delay')},
            'state': _text(link.state) if link else '', 'age': _since(known.linked, now), 'paths': known.paths}


def _wifi(tree: Tree) -> Dict[str, Any]:
    found = {}
    for side in ('robot', 'operator'):
        nodes = tree.get(side + 's') or [{}]
        wifi = nodes[0].get('wifi')
        found[side] = wifi and {'signal': wifi['signal_dbm'], 'tx_bitrate': wifi['tx_bitrate_mbit'],
                                'ssid': wifi['ssid']}
    return found


def _streams(tree: Tree) -> List[Dict[str, Any]]:
    return [{'name': one['stream'], 'hz': one['shown_hz'], 'age': one['age_median'], 'loss': one['loss'],
             'completeness': one['completeness'], 'level': _level(one['level']), 'problem': '; '.join(one['problems'])}
            for one in tree.get('streams', ()) if not one['to_robot']]


def _level(name: str) -> str:
    assert name in LEVELS.values()
    return name.lower()


def _text(text: str) -> str:
    return printable(text[:MAX_TEXT])


def _texts(texts: Sequence[str]) -> List[str]:
    return [_text(one) for one in texts[:MAX_TEXTS]]


def _since(when: float, now: float) -> Optional[float]:
    return round(now - when, 3) if math.isfinite(when) else None
