# SPDX-License-Identifier: BSD-3-Clause
"""Paths that cost: which operators are reached by an interface that is named as metered.

The kernel's routes decide by which interface datagrams leave for an operator's address; they may change.
"""
import socket
from typing import Callable, Dict, FrozenSet, List, Mapping, Sequence, Tuple

from ..monitoring.wifi_texts import Route
from ..paths import PathUse
from .route import route_to

ROUTE_PERIOD = 2.0
"""How often the kernel is asked anew [s]."""


def present() -> FrozenSet[str]:
    """The interfaces of this machine."""
    return frozenset(name for _, name in socket.if_nameindex())


class Metered:
    """Gives the paths by metered interfaces their maximum rate.

    :param interfaces: names, separated by commas
    :param max_rate: what such a path carries by itself [byte/s]; beside another one it carries nothing
    :param report: f(text), called once for each name of no interface of this machine; it may appear later
    :param route: f(host)
    """

    def __init__(self, interfaces: str, max_rate: float, report: Callable[[str], None],
                 route: Callable[[str], Route] = route_to) -> None:
        self._names = frozenset(name.strip() for name in interfaces.split(',') if name.strip())
        self._max_rate, self._route = max_rate, route
        self._known: Dict[str, Tuple[float, bool]] = {}     # {host: (when asked [s], whether it is metered)}
        for name in sorted(self._names - present()):
            report("metered: this machine has no interface '%s' now" % name)

    def mark(self, paths: Mapping[str, Sequence[PathUse]], now: float) -> Mapping[str, Sequence[PathUse]]:
        """Give metered paths the maximum rate; returns all paths [s]."""
        if not self._names:
            return paths
        hosts = {use.host for uses in paths.values() for use in uses}
        self._known = {host: known for host, known in self._known.items() if host in hosts}
        return {name: self._marked(uses, now) for name, uses in paths.items()}

    def _marked(self, uses: Sequence[PathUse], now: float) -> List[PathUse]:
        return [use._replace(max_rate=self._max_rate) if self._is_metered(use.host, now) else use for use in uses]

    def _is_metered(self, host: str, now: float) -> bool:
        asked, metered = self._known.get(host, (-ROUTE_PERIOD, False))
        if now - asked >= ROUTE_PERIOD:
            metered = self._route(host).interface in self._names
            self._known[host] = now, metered
        return metered
