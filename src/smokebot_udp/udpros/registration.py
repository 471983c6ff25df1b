# SPDX-License-Identifier: BSD-3-Clause
"""A context in which many topics and services are made, and then registered with the master in one call."""
import contextlib
from typing import Any, Iterator, List

import rospy
from rospy.impl.paramserver import get_param_server_cache
from rospy.impl.registration import RegistrationListener, RegManager, get_registration_listeners

from . import rpc
from .master import Registration, register_together, registering
from .rospy_binding import install

STATISTICS = '/enable_statistics'
"""The parameter that rospy reads for each Subscriber."""


class _Postponed(RegistrationListener):
    """Takes the place of a RegManager, and notes the registrations instead of making them."""

    def __init__(self, manager: Any) -> None:
        self._manager = manager
        self._notes: List[Registration] = []

    def reg_added(self, resolved_name: str, data_type_or_uri: str, reg_type: str) -> None:
        """Called by rospy for a new topic or service."""
        self._notes.append(Registration(resolved_name, data_type_or_uri, reg_type))

    def reg_removed(self, resolved_name: str, data_type_or_uri: str, reg_type: str) -> None:
        """Called by rospy for a topic or service that ends."""
        note = Registration(resolved_name, data_type_or_uri, reg_type)
        if note in self._notes:
            self._notes.remove(note)
        else:
            self._manager.reg_removed(*note)

    def register(self) -> None:
        """Register all at once; those for which this fails one by one, as rospy does."""
        for note in register_together(self._manager, self._notes):
            self._manager.reg_added(*note)


@contextlib.contextmanager
def registered_together() -> Iterator[None]:
    """A context in which publishers, subscribers and services are made without a call to the master.

    They are registered at its end, all at once, and cannot be reached before. Contexts may be nested.
    """
    install()
    with registering:
        listeners = get_registration_listeners()
        manager = next((listener for listener in listeners.listeners if isinstance(listener, RegManager)), None)
        if manager is None:     # within such a context, or the node is shutting down
            yield
            return
        postponed, cache = _Postponed(manager), get_param_server_cache()
        cache.set(STATISTICS, rpc.repeated(lambda: rospy.get_param(STATISTICS, False)))
        _replace(listeners, manager, postponed)
        try:
            yield
        finally:
            cache.delete(STATISTICS)
            _replace(listeners, postponed, manager)
            postponed.register()


def _replace(listeners: Any, one: Any, other: Any) -> None:
    with listeners.lock:
        if one in listeners.listeners:      # at shutdown rospy removes all
            listeners.listeners[listeners.listeners.index(one)] = other
