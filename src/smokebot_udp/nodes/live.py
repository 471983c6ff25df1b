# SPDX-License-Identifier: BSD-3-Clause
"""Settings that change while a node runs, by the ways ROS users know: dynamic_reconfigure and rosparam.

Whichever way a value comes, a SettingsStore checks it and holds it, it takes effect at once, and the other way shows
it. What rosparam sets wrongly is reported and set back; dynamic_reconfigure clamps, as it always does.

parameter_watch.py reads what rosparam sets, live_server.py serves dynamic_reconfigure.
"""
import threading
from typing import Any, Callable, Dict, Mapping, Optional, Protocol, Sequence

import rospy

from ..mission.mirror import Mirror
from ..mission.settings import SettingsStore
from ..udpros.master import write_parameters
from .parameters import DIAGNOSTICS

PUBLISHING = threading.RLock()
"""Held while this node writes parameters, and while it reads what others wrote. Taken after a server's mutex."""


class Shown(Protocol):
    """What shows live settings."""

    def show(self) -> None:
        """Show the values as they are now."""


class LiveSettings:
    """The live settings of one part of a node, under <node>/<name>/ (or <node>/ where the name is empty).

    :param store: SettingsStore
    :param report: f(problem), called with what is refused
    :param request: requests changes of the store; None: the store itself does
    :param node: namespace of the node's parameters; None: this node's private ones
    """

    def __init__(self, name: str, store: SettingsStore, report: Callable[[str], None],
                 request: Optional[Callable[[Mapping[str, Any]], Any]] = None, node: Optional[str] = None) -> None:
        self.name, self.store = name, store
        self.node = node or rospy.get_name()
        self.namespace = '%s/%s' % (self.node, name) if name else self.node
        self.request, self.report = request or store.request, report
        others = None if not name else DIAGNOSTICS if node is None else ()
        self.mirror = Mirror(self.namespace, store, self.request, report, others)
        self.server: Optional[Shown] = None
        """Shows the values to clients of dynamic_reconfigure."""

    @property
    def values(self) -> Dict[str, Any]:
        """{name: value} as requested."""
        requested = self.store.current.requested
        return {name: requested[name] for name in self.store.table}

    def read(self, found: Mapping[str, Any]) -> bool:
        """Take values that others set on the parameter server.

        :param found: what is in the node's namespace
        :return: whether anything was set
        """
        return self.mirror.read(found.get(self.name, {}) if self.name else found)

    def show(self) -> None:
        """Show the requested values in dynamic_reconfigure and on the parameter server."""
        if self.server is not None:
            self.server.show()


def publish_all(parts: Sequence[LiveSettings]) -> None:
    """Write the values that differ to the parameter server, in one call, and nothing else; PUBLISHING is held."""
    news = [(part, part.mirror.to_write()) for part in parts]
    write_parameters({'%s/%s' % (part.namespace, name): value for part, values in news
                      for name, value in values.items()})
    for part, values in news:
        part.mirror.written(values)


def found_on_master(node: str) -> Dict[str, Any]:
    """What the parameter server has in a node's namespace; a copy, for rospy's cache changes."""
    found = rospy.get_param(node, {})
    return {name: dict(value) if isinstance(value, dict) else value
            for name, value in dict(found).items()} if isinstance(found, dict) else {}
