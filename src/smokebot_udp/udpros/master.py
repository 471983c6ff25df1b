# SPDX-License-Identifier: BSD-3-Clause
"""Registration with the master: of many topics and services in one call, and of a whole node at a restarted master.

rospy registers each by a call of its own, one after the other. Over a link with 100 ms round-trip time and 20 % loss
this takes half a minute for a node with a dozen streams. The master accepts many calls in one (system.multicall), but
notifies a topic's subscribers of a new publisher one topic after the other, over that link even if they are on the
publisher's side of it. Therefore the publisher notifies them as well, all at once, each of all topics in one call.

rospy never registers again. If the master is restarted, `MasterWatch` finds it, and `register_node` registers the whole
node with the new one.
"""
import contextlib
import math
import threading
import time
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import rosgraph
import rospy
from rospy.impl.paramserver import get_param_server_cache
from rospy.impl.registration import get_service_manager, get_topic_manager

from . import rpc
from .negotiation import Refused

CALLS = {'pub': 'registerPublisher', 'sub': 'registerSubscriber', 'srv': 'registerService', 'param': 'subscribeParam'}
"""{kind of registration: the master's method}; all but param are rospy's."""

MULTICALL_TIMEOUT = 15.0
"""How long the master may take to answer all calls together [s]. To make them one by one would take longer."""

LOOKUP_PERIOD = 10.0
"""How often the master is asked for this node, even if its process and the connection to it are the same [s]."""

ROSOUT_TOPICS = '/rosout_disable_topics_generation'
"""The parameter by which a message on /rosout does not list the node's topics, see rospy.impl.rosout."""

_kept: Dict[str, None] = {}
"""Namespaces of parameters, besides the node's own, that a new master gets, see keep_parameters."""

registering = threading.RLock()
"""Held while many registrations are made, or postponed."""


class Registration(NamedTuple):
    """Something that the master has to know of this node."""
    name: str
    what: str
    """Type of a topic, URI of a service, nothing for a parameter."""
    kind: str
    """A key of CALLS."""

    def call(self, node: str, uri: str) -> Dict[str, Any]:
        """The call of the master, as an element of a multicall.

        :param node: this node's name
        :param uri: of this node's XML-RPC server
        """
        params = [node, uri, self.name] if self.kind == 'param' else [node, self.name, self.what, uri]
        return {'methodName': CALLS[self.kind], 'params': params}


class Identity(NamedTuple):
    """What distinguishes a master from the one before it."""
    pid: int
    run_id: Any
    """The parameter /run_id, which roslaunch sets; None without."""


class Acquaintance:
    """Decides by the master's answers whether a node has to register again."""

    def __init__(self) -> None:
        self._registered: Optional[Identity] = None

    def is_lost(self, master: Identity, found: Optional[str], uri: str) -> bool:
        """Whether a master does not have this node's registrations.

        :param found: URI of the node of this name, as the master knows it; None if it knows no such node
        :param uri: this node's
        """
        if self._registered is None and found is not None:
            self._registered = master       # by rospy, at the node's start
        # another node of this name is left alone: the master would shut it down
        return found is None or (found == uri and master != self._registered)

    def missed(self) -> None:
        """The master did not answer: the one that answers next may have been started since the node was."""
        self._registered = self._registered or Identity(0, None)

    def registered(self, master: Identity) -> None:
        """All registrations have been made."""
        self._registered = master


class MasterWatch:
    """Finds out whether the master is a new one, over a TCP connection that is kept open: its end reveals the master's,
    and costs nothing until then.

    :param master_uri: of the master
    :param uri: of the node's XML-RPC server
    :param node: the node's name; None: this process's node
    """

    def __init__(self, master_uri: str, uri: str, node: Optional[str] = None) -> None:
        self._session = rpc.Session(master_uri)
        self._uri = uri
        self._node = node
        self._acquaintance = Acquaintance()
        self._connection = 0        # the session's number of the one through which the master was identified
        self._next_lookup = -math.inf
        self._master: Optional[Identity] = None

    @property
    def connections(self) -> int:
        """How many connections to the master have been made until now."""
        return self._session.connections

    @property
    def own_address(self) -> Optional[str]:
        """This machine's address towards the master; None: unknown."""
        return self._session.own_address

    def is_new(self) -> bool:
        """Whether this node has to be registered.

        :raises Unreachable: if the master does not answer
        """
        try:
            return self._ask()
        except rpc.Unreachable:
            self._acquaintance.missed()
            raise

    def _ask(self) -> bool:
        now = time.monotonic()
        if self._session.alive and self._connection == self._session.connections and now < self._next_lookup:
            return False
        if not self._session.alive:
            self._session.close()
        code, _, found = self._session.call('lookupNode', self._node or rospy.get_caller_id())
        if self._master is None or self._connection != self._session.connections:
            pid = int(self._session.call('getPid')[2])
            known, _, run_id = self._session.call('getParam', '/run_id')
            self._master, self._connection = Identity(pid, run_id if known == 1 else None), self._session.connections
        if self._acquaintance.is_lost(self._master, found if code == 1 else None, self._uri):
            self._next_lookup = -math.inf
            return True
        self._next_lookup = now + LOOKUP_PERIOD
        return False

    def registered(self) -> None:
        """This node has been registered with the master that was new."""
        if self._master is not None:
            self._acquaintance.registered(self._master)

    def register(self, registrations: Sequence[Registration]) -> List[Any]:
        """The master's answers to some registrations, None where it refuses.

        :raises Unreachable: if it does not answer
        """
        name = rospy.get_caller_id()
        return self._session.call_all([one.call(name, self._uri) for one in registrations])


def register_together(manager: Any, registrations: Sequence[Registration]) -> List[Registration]:
    """Register all in one call, and take over the publishers and parameters that the master answers.

    :param manager: rospy's RegManager
    :return: those that are not registered
    """
    answers, publishers = ask_together(registrations, rospy.get_caller_id(), manager.uri)
    only_ours: Dict[Registration, List[str]] = {}
    for one, answer in zip(registrations, answers):
        if answer is None:
            continue
        if one.kind == 'sub':
            manager.publisher_update(one.name, answer)
        elif one.kind == 'param':
            _take_over(one.name, answer)
        # other publishers are known by name only: then only the master can notify of all of them
        elif one.kind == 'pub' and publishers.get(one.name) == [rospy.get_caller_id()]:
            only_ours[one] = answer
    if any(only_ours.values()):
        threading.Thread(target=_notify_all, args=(only_ours, manager.uri), daemon=True).start()
    return [one for one, answer in zip(registrations, answers) if answer is None]


def keep_parameters(namespace: str) -> None:
    """Treat the parameters of a namespace, once they are cached, as the node's private ones: a new master gets them.

    :param namespace: resolved
    """
    _kept[namespace] = None


def register_node(manager: Any) -> bool:
    """Register all topics and services of this node, and subscribe to its private parameters, and those of
    keep_parameters, where they are cached; those that the master has lost are written back.

    :param manager: rospy's RegManager
    :return: whether all are registered
    :raises Unreachable: if the parameters cannot be written
    """
    with registering:
        registrations = _of_node()
        missing = register_together(manager, registrations)
        now = _of_node()
        for one in registrations:       # ended meanwhile
            if one not in now and one.kind != 'param':
                manager.reg_removed(*one)
    return not missing


def _of_node() -> List[Registration]:
    topics = get_topic_manager()
    found = [Registration(impl.resolved_name, impl.type, kind)
             for kind, impls in (('pub', topics.pubs), ('sub', topics.subs)) for impl in list(impls.values())]
    found += [Registration(name, uri, 'srv') for name, uri in get_service_manager().get_services()]
    for namespace in {rospy.get_name(): None, **_kept}:
        with contextlib.suppress(KeyError):
            get_param_server_cache().get(namespace)
            found.append(Registration(namespace, '', 'param'))
    return found


def _take_over(namespace: str, values: Any) -> None:
    """Update the cached parameters of a namespace that have other values at the master, and write those back that it
    does not have.

    :raises Unreachable: if they cannot be written
    """
    cache, values = get_param_server_cache(), values if isinstance(values, dict) else {}
    cached = cache.get(namespace)
    cached = cached if isinstance(cached, dict) else {}
    missing = dict(_missing(namespace, cached, values))
    for name, value in values.items():
        with contextlib.suppress(KeyError):
            if cached.get(name) != value:
                cache.update('%s/%s' % (namespace, name), value)
    write_parameters(missing)


def _missing(namespace: str, cached: Mapping[str, Any], values: Mapping[str, Any]) -> Iterator[Tuple[str, Any]]:
    """(name, value) of the cached parameters that a master does not have; an empty namespace is none."""
    for name, value in cached.items():
        key = '%s/%s' % (namespace, name)
        if isinstance(value, dict) and isinstance(values.get(name), dict):
            yield from _missing(key, value, values[name])
        elif name not in values and value != {}:
            yield key, value


def write_parameters(values: Mapping[str, Any]) -> None:
    """Set some parameters in one call. All others stay, also those that somebody is just setting
    in the same namespace.

    :param values: {resolved name: value}
    :raises Unreachable: if the master does not answer
    """
    if not values:
        return
    node, cache = rospy.get_caller_id(), get_param_server_cache()
    rpc.call_all(rosgraph.get_master_uri(), [
        {'methodName': 'setParam', 'params': [node, name, value]} for name, value in values.items()], MULTICALL_TIMEOUT)
    for name, value in values.items():
        with contextlib.suppress(KeyError):     # it is not cached
            cache.update(name, value)


def ask_together(registrations: Sequence[Registration], node: str, uri: str
                 ) -> Tuple[List[Any], Dict[str, List[str]]]:
    """The master's answer to each registration, None if it refuses or does not answer; {topic: publishers' names}.

    :param node: the name of the node that is registered
    :param uri: of its XML-RPC server
    """
    if not registrations:
        return [], {}
    calls = [one.call(node, uri) for one in registrations] + [{'methodName': 'getSystemState', 'params': [node]}]
    try:
        values = rpc.call_all(rosgraph.get_master_uri(), calls, MULTICALL_TIMEOUT)
    except rpc.Unreachable as error:
        rospy.logdebug('the master does not register all at once: %s', error)
        return [None] * len(registrations), {}
    return values[:-1], dict(values[-1][0]) if values[-1] else {}


def _notify_all(subscribers: Dict[Registration, List[str]], uri: str) -> None:
    """Notify the subscribers of topics that only this node publishes; then correct what has changed meanwhile.

    Another publisher may have been registered before the notification arrived, and roscpp then ends the connection to
    it. To register again makes the master notify of all publishers.

    :param subscribers: {topic: URIs of its subscribers}
    :param uri: of this node's XML-RPC server
    """
    of_node: Dict[str, List[str]] = {}
    for topic, found in subscribers.items():
        for subscriber in found:
            of_node.setdefault(subscriber, []).append(topic.name)
    threads = [threading.Thread(target=_notify, args=(subscriber, topics, uri), daemon=True)
               for subscriber, topics in of_node.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    try:
        state = rpc.call(rosgraph.get_master_uri(), 'getSystemState')
        publishers = dict(state[0]) if state else {}
        for topic in subscribers:
            if len(publishers.get(topic.name, ())) > 1 and get_topic_manager().has_publication(topic.name):
                rpc.call(rosgraph.get_master_uri(), CALLS['pub'], topic.name, topic.what, uri)
    except (rpc.Unreachable, Refused) as error:
        rospy.logdebug('the master does not say who else publishes: %s', error)


def _notify(subscriber: str, topics: Sequence[str], uri: str) -> None:
    """Notify a subscriber, by its URI, that this node publishes some topics."""
    try:
        answers = rpc.call_together(subscriber, [('publisherUpdate', (topic, [uri])) for topic in topics])
    except rpc.Unreachable as error:
        answers = [error] * len(topics)
    for topic, answer in zip(topics, answers):
        if isinstance(answer, Exception):
            rospy.logdebug('[%s]: only the master notifies the subscriber %s: %s', topic, subscriber, answer)


def log_without_master() -> None:
    """Let rospy's log messages not depend on the master.

    rospy asks the master for ROSOUT_TOPICS with each message, as long as nobody has set it, without a timeout, and
    holds the lock of all logging. Over a dead link every thread that logs would wait until TCP gives up: a quarter of
    an hour. Here it is asked for once.
    """
    try:
        value = rpc.call(rosgraph.get_master_uri(), 'getParam', ROSOUT_TOPICS)
    except (rpc.Unreachable, Refused):
        value = False       # rospy's default
    get_param_server_cache().set(ROSOUT_TOPICS, bool(value))
