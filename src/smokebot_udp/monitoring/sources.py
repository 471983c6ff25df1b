# SPDX-License-Identifier: BSD-3-Clause
"""Why nothing comes from the source of a stream, or nobody takes what comes: what the master knows of topics, services
and actions, in words."""
import difflib
from typing import Any, Callable, Collection, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

TOPIC, SERVICE, ACTION, LISTENER = 'topic', 'service', 'action', 'listener'
"""Kinds of sources. A LISTENER is no source, but who receives what operators send on a topic."""

STATUS, RESULT = '/status', '/result'
"""Topics of an action that its server publishes."""

GRACE = 4.0
"""Sources that are missing this long after the start are none's fault: nodes start in any order [s]."""

FIRST_PERIOD, PERIOD, MAX_PERIOD = 2.0, 5.0, 60.0
"""The master is asked at most this often where a source is newly silent, and while there is a problem; while it knows
none, less and less often: its answer has kilobytes, and crosses the link where both sides share a master [s]."""

FORGOTTEN_AFTER = 3.0
"""A source that was not asked for so long has come since [s]."""

SIMILAR, ALIKE = 0.75, 0.5
"""Least ratio of difflib (0..1) of names that are proposed: a letter in six differs; and where the type is right."""

PROPOSED = 2
"""Names."""

OWN_NODES = '/robot_sender', '/operator_receiver'
"""Ends of the names of nodes that are no sources to propose: what they publish is made of other topics."""


class Source(NamedTuple):
    """What a stream needs on its own side."""
    kind: str
    name: str
    """Resolved."""
    type: str = ''
    """package/Type of the messages, or several with ' or ' between them; of an action that of its results; empty: any.
    """


class Graph(NamedTuple):
    """What the master knows."""
    publishers: Mapping[str, Sequence[str]]
    """{topic: nodes}"""
    types: Mapping[str, str]
    """{topic: package/Type}"""
    services: Mapping[str, Sequence[str]]
    """{service: nodes}"""
    subscribers: Mapping[str, Sequence[str]] = {}
    """{topic: nodes}"""

    def published(self) -> List[str]:
        """The topics that may be sources."""
        return _of_others(self.publishers)

    def listened(self) -> List[str]:
        """The topics that a node of the robot subscribes."""
        return _of_others(self.subscribers)


def _of_others(topics: Mapping[str, Sequence[str]]) -> List[str]:
    """Those of {topic: nodes} with a node that is none of this package's."""
    return [topic for topic, nodes in topics.items() if any(not node.endswith(OWN_NODES) for node in nodes)]


def graph_of(state: Sequence[Any], types: Sequence[Tuple[str, str]]) -> Graph:
    """The Graph of the master's getSystemState and getTopicTypes."""
    return Graph({str(topic): nodes for topic, nodes in state[0]}, {str(topic): type_ for topic, type_ in types},
                 {str(service): nodes for service, nodes in state[2]}, {str(topic): nodes for topic, nodes in state[1]})


def problem_of(source: Source, graph: Graph, silent: bool = True) -> Optional[str]:
    """Why nothing comes from a source, in words; None: the master knows no reason.

    :param silent: whether messages of a topic are missing that should come
    """
    if source.kind == SERVICE:
        return None if source.name in graph.services else 'the robot has no service %s%s' % (
            source.name, _proposed(source.name, graph.services))
    if source.kind == ACTION:
        if not graph.publishers.get(source.name + STATUS):
            return 'the robot has no action server %s%s' % (source.name, _proposed(source.name, [
                topic[:-len(STATUS)] for topic in graph.published() if topic.endswith(STATUS)
                and topic[:-len(STATUS)] + RESULT in graph.publishers]))
        return _other_type(Source(TOPIC, source.name + RESULT, source.type), graph)
    if source.kind == LISTENER:
        topics = graph.listened()
        return None if source.name in topics else 'nobody on the robot listens to %s%s' % (
            source.name, _proposed(source.name, topics, _of_type(source, topics, graph)))
    nodes = graph.publishers.get(source.name)
    if not nodes:
        topics = graph.published()
        return 'nobody publishes %s%s' % (source.name, _proposed(source.name, topics, _of_type(source, topics, graph)))
    return _other_type(source, graph) or (
        '%s publishes %s, but nothing comes' % (', '.join(sorted(nodes)[:PROPOSED]), source.name) if silent else None)


def _of_type(source: Source, topics: Sequence[str], graph: Graph) -> List[str]:
    """Those of some topics that have the type of a source."""
    return [topic for topic in topics if source.type and graph.types.get(topic) in source.type.split(' or ')]


def _other_type(source: Source, graph: Graph) -> Optional[str]:
    found = graph.types.get(source.name, '*')
    if not source.type or found in (*source.type.split(' or '), '*'):
        return None
    return '%s is published as %s, must be %s' % (source.name, found, source.type)


def _proposed(name: str, names: Collection[str], of_type: Collection[str] = ()) -> str:
    """Names to use instead, in words; empty: there are none.

    :param of_type: those of names that have the right type
    """
    similar = (difflib.get_close_matches(name, of_type, PROPOSED, ALIKE)
               or difflib.get_close_matches(name, names, PROPOSED, SIMILAR))
    if similar:
        return '; similar: ' + ', '.join(similar)
    return '; of its type: ' + ', '.join(sorted(of_type)[:PROPOSED]) if of_type else ''


class SourceWatch:
    """Decides when the master is asked, and what is wrong with sources by its last answer.

    All times are by one steady clock [s].

    :param ask: f(), called when an answer is wanted: `answer` is to be called then, in any thread
    """

    def __init__(self, ask: Callable[[], None], now: float) -> None:
        self._ask, self._begun = ask, now
        self._graph: Optional[Graph] = None
        self._asked, self._period = -float('inf'), PERIOD
        self._answered = -float('inf')      # when the last answer was asked for
        self._waiting: Dict[Source, Tuple[float, float]] = {}   # {source: asked for since, and last}

    def answer(self, graph: Optional[Graph]) -> None:
        """The master's answer; None: there is none."""
        self._graph, self._answered = graph, self._asked

    def problem(self, source: Source, now: float, silent: bool = True) -> Optional[str]:
        """Why nothing comes from a source that is silent now, or whether a service or an action is missing.

        To be called regularly meanwhile, and not while a topic's messages come.

        :param silent: see `problem_of`
        """
        since, last = self._waiting.get(source, (now, now))
        since = now if now - last > FORGOTTEN_AFTER else since
        self._waiting[source] = since, now
        if now - self._begun < GRACE:
            return None
        is_known = self._answered >= since      # the answer before may be about what has ended
        if now >= self._asked + (self._period if is_known else FIRST_PERIOD):
            self._asked, self._period = now, min(2 * self._period, MAX_PERIOD)
            self._ask()
        if self._graph is None or self._answered < since:
            return None
        found = problem_of(source, self._graph, silent)
        if found:
            self._period = PERIOD
        return found
