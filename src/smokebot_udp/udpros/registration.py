# SPDX-License-Identifier: BSD-3-Clause
"""Registers many topics and services with the master in one call, and tells their subscribers.

rospy registers each by a call of its own, one after the other: over a link with 100 ms round trip and 20 % loss a node
with a dozen streams takes half a minute for it. The master takes many calls in one (system.multicall). But it tells a
topic's subscribers of a new publisher one topic after the other, over that link even where they are beside the
publisher: so they hear it from the publisher, too, all at once.
"""
import contextlib
import threading
import xmlrpc.client
from xml.parsers.expat import ExpatError

import rosgraph
import rospy
from rospy.impl.paramserver import get_param_server_cache
from rospy.impl.registration import RegistrationListener, RegManager, get_registration_listeners

from . import rpc
from .negotiation import Refused
from .rospy_binding import install

CALLS = {'pub': 'registerPublisher', 'sub': 'registerSubscriber', 'srv': 'registerService'}
"""{rospy's kind: the master's method}"""

PATIENCE = 15.0
"""So long the master may take to answer; to ask for all one by one would take longer [s]."""

STATISTICS = '/enable_statistics'
"""rospy asks for this parameter at each Subscriber."""

_one_at_a_time = threading.RLock()


class _Postponed(RegistrationListener):
    """Stands in for a RegManager, and notes what it would have registered."""

    def __init__(self, manager):
        self._manager = manager
        self._notes = []    # (name, type or URI, kind)

    def reg_added(self, resolved_name, data_type_or_uri, reg_type):
        self._notes.append((resolved_name, data_type_or_uri, reg_type))

    def reg_removed(self, resolved_name, data_type_or_uri, reg_type):
        note = resolved_name, data_type_or_uri, reg_type
        if note in self._notes:
            self._notes.remove(note)
        else:
            self._manager.reg_removed(*note)

    def register(self):
        """Register all at once; what that fails for, one by one, as rospy does."""
        answers, publishers = self._ask()
        for (name, what, kind), answer in zip(self._notes, answers):
            if answer is None:
                self._manager.reg_added(name, what, kind)
            elif kind == 'sub':
                self._manager.publisher_update(name, answer)
            # who else publishes is known by name only: then the master alone tells of all of them
            elif kind == 'pub' and publishers.get(name) == [rospy.get_caller_id()]:
                for subscriber in answer:
                    threading.Thread(target=self._tell, args=(subscriber, name), daemon=True).start()

    def _ask(self):
        """What the master answers to each, None where it refuses, or nothing comes; {topic: [publisher's name]}."""
        if not self._notes:
            return [], {}
        name = rospy.get_caller_id()
        calls = [{'methodName': CALLS[kind], 'params': [name, topic, what, self._manager.uri]}
                 for topic, what, kind in self._notes] + [{'methodName': 'getSystemState', 'params': [name]}]
        try:
            transport = rpc.MasterTransport(PATIENCE)
            with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), transport=transport) as master:
                answers = master.system.multicall(calls)
        except (OSError, xmlrpc.client.Error, ExpatError) as error:
            rospy.logdebug('the master does not register all at once: %s', error)
            answers = []
        # an answer is in a list of one; a fault is a dictionary
        values = [answer[0][2] if isinstance(answer, list) and answer[0][0] == 1 else None for answer in answers]
        values += [None] * (len(calls) - len(values))
        return values[:-1], dict(values[-1][0]) if values[-1] else {}

    def _tell(self, subscriber, topic):
        """Tell a subscriber, by its URI, that this node is its topic's publisher."""
        try:
            rpc.call(subscriber, 'publisherUpdate', topic, [self._manager.uri])
        except (rpc.Unreachable, Refused) as error:
            rospy.logdebug('[%s]: the subscriber %s will hear it from the master: %s', topic, subscriber, error)


@contextlib.contextmanager
def registered_together():
    """In this context publishers, subscribers and services are made without a word to the master; it is told of all
    of them at the end. Until then nobody can reach them."""
    install()
    with _one_at_a_time:
        listeners = get_registration_listeners()
        manager = next((listener for listener in listeners.listeners if isinstance(listener, RegManager)), None)
        if manager is None:     # we are in such a context already, or the node shuts down
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


def _replace(listeners, one, other):
    with listeners.lock:
        if one in listeners.listeners:      # at shutdown rospy takes them all
            listeners.listeners[listeners.listeners.index(one)] = other
