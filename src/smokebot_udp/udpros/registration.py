# SPDX-License-Identifier: BSD-3-Clause
"""Registration of many topics and services with the master in one call, and notification of their subscribers.

rospy registers each by a call of its own, one after the other. Over a link with 100 ms round-trip time and 20 % loss
this takes half a minute for a node with a dozen streams. The master accepts many calls in one (system.multicall), but
notifies a topic's subscribers of a new publisher one topic after the other, over that link even if they are on the
publisher's side of it. Therefore the publisher notifies them as well, all at once.
"""
import contextlib
import threading
import xmlrpc.client
from typing import Any, Dict, Iterator, List, NamedTuple, Tuple
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
from rospy.impl.paramserver import get_param_server_cache
from rospy.impl.registration import RegistrationListener, RegManager, get_registration_listeners

from . import rpc
from .negotiation import Refused
from .rospy_binding import install

CALLS = {'pub': 'registerPublisher', 'sub': 'registerSubscriber', 'srv': 'registerService'}
"""{kind of registration in rospy: the master's method}"""

MULTICALL_TIMEOUT = 15.0
"""How long the master may take to answer all calls together [s]. To make them one by one would take longer."""

STATISTICS = '/enable_statistics'
"""The parameter that rospy reads for each Subscriber."""

_one_at_a_time = threading.RLock()


class _Registration(NamedTuple):
    name: str
    what: str
    """Type of a topic, URI of a service."""
    kind: str
    """A key of CALLS."""


class _Postponed(RegistrationListener):
    """Takes the place of a RegManager, and notes the registrations instead of making them."""

    def __init__(self, manager: Any) -> None:
        self._manager = manager
        self._notes: List[_Registration] = []

    def reg_added(self, resolved_name: str, data_type_or_uri: str, reg_type: str) -> None:
        """Called by rospy for a new topic or service."""
        self._notes.append(_Registration(resolved_name, data_type_or_uri, reg_type))

    def reg_removed(self, resolved_name: str, data_type_or_uri: str, reg_type: str) -> None:
        """Called by rospy for a topic or service that ends."""
        note = _Registration(resolved_name, data_type_or_uri, reg_type)
        if note in self._notes:
            self._notes.remove(note)
        else:
            self._manager.reg_removed(*note)

    def register(self) -> None:
        """Register all at once; those for which this fails one by one, as rospy does."""
        answers, publishers = self._ask()
        for note, answer in zip(self._notes, answers):
            if answer is None:
                self._manager.reg_added(*note)
            elif note.kind == 'sub':
                self._manager.publisher_update(note.name, answer)
            # other publishers are known by name only: then only the master can notify of all of them
            elif note.kind == 'pub' and publishers.get(note.name) == [rospy.get_caller_id()]:
                for subscriber in answer:
                    threading.Thread(target=self._notify, args=(subscriber, note.name), daemon=True).start()

    def _ask(self) -> Tuple[List[Any], Dict[str, List[str]]]:
        """The master's answer to each registration, None if it refuses or does not answer; {topic: publishers' names}.
        """
        if not self._notes:
            return [], {}
        name = rospy.get_caller_id()
        calls = [{'methodName': CALLS[note.kind], 'params': [name, note.name, note.what, self._manager.uri]}
                 for note in self._notes] + [{'methodName': 'getSystemState', 'params': [name]}]
        answers: List[Any] = []
        try:
            transport = rpc.MasterTransport(MULTICALL_TIMEOUT)
            with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=transport) as proxy:
                master: Any = proxy
                answers = master.system.multicall(calls)
        except (OSError, xmlrpc.client.Error, ExpatError) as error:
            rospy.logdebug('the master does not register all at once: %s', error)
        # an answer is in a list of one; a fault is a dictionary
        values = [answer[0][2] if isinstance(answer, list) and answer[0][0] == 1 else None for answer in answers]
        values += [None] * (len(calls) - len(values))
        return values[:-1], dict(values[-1][0]) if values[-1] else {}

    def _notify(self, subscriber: str, topic: str) -> None:
        """Notify a subscriber, by its URI, that this node publishes a topic."""
        try:
            rpc.call(subscriber, 'publisherUpdate', topic, [self._manager.uri])
        except (rpc.Unreachable, Refused) as error:
            rospy.logdebug('[%s]: only the master notifies the subscriber %s: %s', topic, subscriber, error)


@contextlib.contextmanager
def registered_together() -> Iterator[None]:
    """A context in which publishers, subscribers and services are made without a call to the master.

    They are registered at its end, all at once, and cannot be reached before. Contexts may be nested.
    """
    install()
    with _one_at_a_time:
        listeners = get_registration_listeners()
        manager = next((listener for listener in listeners.listeners if isinstance(listener, RegManager)), None)
        if manager is None:     # within such a context, or the node is shutting down
            yield
            return
        postponed, cache = _Postponed(manager), get_param_server_cache()
        cache.set(STATISTICS, rospy.get_param(STATISTICS, False))
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
