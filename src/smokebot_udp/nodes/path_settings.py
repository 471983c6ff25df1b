# SPDX-License-Identifier: BSD-3-Clause
"""How each interface of the robot may be used, as settings that change while it runs: ~path_wwan0/metered.

An interface has settings as soon as an operator is reached by it, or from the start where it is named as metered.
"""
import math
import re
import threading
from typing import Callable, Dict, List, Mapping, Sequence

from ..link.interfaces import index_of
from ..mission.settings import SettingsStore
from ..paths import PathPolicy, PathUse
from ..units import MBIT
from .live import LiveSettings
from .parameters import PATH

MAX_INTERFACES = 16
"""That have settings: tunnels and containers come and go."""


def part_of(interface: str) -> str:
    """The name of an interface's settings: it may have characters that ROS names have not."""
    return 'path_' + re.sub(r'[^A-Za-z0-9_]', '_', interface)


class PathSettings:
    """Gives paths the policy of their interface.

    :param metered: names of interfaces whose bytes cost, separated by commas
    :param max_rate: of these; 0: unlimited [Mbit/s]
    :param report: f(text), called once for each name of no interface of this machine, which may appear later, and with
        settings that are refused
    """

    def __init__(self, metered: str, max_rate: float, report: Callable[[str], None]) -> None:
        self._metered = list(filter(None, map(str.strip, metered.split(','))))
        self._max_rate, self._report = max_rate, report
        self._stores: Dict[str, SettingsStore] = {}
        self._serve: Callable[[LiveSettings], None] = self._wait
        self._waiting: List[LiveSettings] = []
        self._lock = threading.Lock()
        for name in self._metered:
            if index_of(name) is None:
                report("metered: this machine has no interface '%s' now" % name)
            self._store(name)

    def serve(self, serve: Callable[[LiveSettings], None]) -> None:
        """Call f(LiveSettings) once for each interface, now and later."""
        with self._lock:
            self._serve = serve
            for settings in self._waiting:
                serve(settings)

    def _wait(self, settings: LiveSettings) -> None:
        self._waiting.append(settings)

    def mark(self, paths: Mapping[str, Sequence[PathUse]]) -> Mapping[str, Sequence[PathUse]]:
        """Paths with their policies; of those by no known interface nothing is changed."""
        return {name: [self._marked(use) for use in uses] for name, uses in paths.items()}

    def _marked(self, use: PathUse) -> PathUse:
        if not use.interface or use.interface not in self._stores and len(self._stores) >= MAX_INTERFACES:
            return use
        settings = self._store(use.interface).current
        return use._replace(policy=PathPolicy((settings['max_rate'] or math.inf) * MBIT, settings['weight'],
                                              settings['metered']))

    def _store(self, interface: str) -> SettingsStore:
        """The settings of an interface, which begin here."""
        store = self._stores.get(interface)
        if store is None:
            metered = interface in self._metered
            store = self._stores[interface] = SettingsStore(
                PATH, {'weight': PATH['weight'].default, 'metered': metered,
                       'max_rate': self._max_rate if metered else PATH['max_rate'].default})
            with self._lock:
                self._serve(LiveSettings(part_of(interface), store, self._report))
        return store
