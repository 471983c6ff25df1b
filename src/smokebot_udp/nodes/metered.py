# SPDX-License-Identifier: BSD-3-Clause
"""By which interface operators are reached, and whether it is named as metered: such paths cost.

The kernel's routes decide by which interface datagrams leave for an operator's address; they may change.
"""
import math
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
    """Gives paths the name of their interface, and those by metered ones their maximum rate.

    :param interfaces: names, separated by commas
    :param max_rate: what such a path carries by itself [byte/s]; beside another one it carries nothing
    :param report: f(text), called once for each name of no interface of this machine; it may appear later
    :param route: f(host)
    """

    def __init__(self, interfaces: str, max_rate: float, report: Callable[[str], None],
                 route: Callable[[str], Route] = route_to) -> None:
        self._names = frozenset(name.strip() for name in interfaces.split(',') if name.strip())
        self._max_rate, self._route = max_rate, route
        self._known: Dict[str, Tuple[float, str]] = {}     # {host: (when asked [s], interface)}
        for name in sorted(self._names - present()):
            report("metered: this machine has no interface '%s' now" % name)

    def mark(self, paths: Mapping[str, Sequence[PathUse]], now: float) -> Mapping[str, Sequence[PathUse]]:
        """Give paths their interface, and metered ones the maximum rate [s]."""
        hosts = {use.host for uses in paths.values() for use in uses}
        self._known = {host: known for host, known in self._known.items() if host in hosts}
        return {name: self._marked(uses, now) for name, uses in paths.items()}

    def _marked(self, uses: Sequence[PathUse], now: float) -> List[PathUse]:
        named = [use._replace(interface=self._interface(use.host, now)) for use in uses]
        return [use._replace(max_rate=self._max_rate) if use.interface in self._names else use for use in named]

    def _interface(self, host: str, now: float) -> str:
        asked, interface = self._known.get(host, (-math.inf, ''))
        if now - asked >= ROUTE_PERIOD:
            interface = self._route(host).interface
            self._known[host] = now, interface
        return interface
