# SPDX-License-Identifier: BSD-3-Clause
"""The paths by which this desk reaches a robot: addresses of both sides, and the interface of this machine."""
from typing import Any, Callable, Dict, List, Optional, Tuple

from ..monitoring.link_snapshot import Tree
from ..monitoring.status import OPERATOR, printable
from ..monitoring.wifi_texts import Route

MAX_PATHS = 8
"""That are shown."""

MAX_NAME = 100
"""Letters of a robot's name that are shown: it comes over the link."""


def paths_of(tree: Tree, route: Callable[[str], Route]) -> List[Dict[str, Any]]:
    """The field `paths` of doc/web_protocol.md, of a robot and this desk.

    :param tree: of this desk's operator_receiver
    :param route: f(host)
    """
    found: Dict[Tuple[str, str, str], Dict[str, Any]] = {}
    for name, host, port, named, round_trip, used in _peers(tree):
        if (name, host, named) not in found and len(found) < MAX_PATHS:
            own, interface = ('', named) if named else route(host)
            found[name, host, named] = {
                'name': printable(name[:MAX_NAME]), 'address': host if port is None else '%s:%d' % (host, port),
                'own_address': own, 'interface': interface, 'round_trip': round_trip, 'used': used}
    return list(found.values())


def _peers(tree: Tree) -> List[Tuple[str, str, Optional[int], str, Optional[float], bool]]:
    """(name, host, port, interface, round trip [s], whether it is used) of each robot that operator_receiver is
    connected with.

    On a shared master each stream has a port of its own, which is None here.
    """
    transports = [operator['transport'] for operator in tree.get('operators', ()) if operator['transport']]
    if transports:
        return [(peer['name'], peer['host'], peer['port'], peer['interface'], peer['round_trip'], peer['used'])
                for transport in transports for peer in transport['peers']]
    return [(connection['peer'], connection['address'].rpartition(':')[0], None, '', None, True)
            for connection in tree.get('connections', ())
            if connection['side'] == OPERATOR and connection['peer'] and connection['address']]
