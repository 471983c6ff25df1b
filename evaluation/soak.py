# SPDX-License-Identifier: BSD-3-Clause
"""The soak without processes: which faults come, which streams have to be fresh after them, and whether the goals hold.

A soak goes round after round: a fault, the wait until every awaited stream is fresh again, and the resources of each
node once they have settled. Times are seconds since the epoch, by the clock of the operator's side.
"""
import math
import random
import statistics
from dataclasses import dataclass
from typing import Any, Collection, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np

from .listener import Heard

SECOND_OPERATOR = 'operator2'


@dataclass(frozen=True)
class Kind:
    """A kind of fault."""
    restarts: Tuple[str, ...] = ()
    """Parts that are killed, and started again."""
    down: Tuple[float, float] = (0.0, 0.0)
    """Limits of its duration [s]: how long the parts are down, the link is cut, the flood lasts."""
    median: float = 2.0
    """Goal of the wait in half of the rounds [s]."""
    worst: float = 6.0
    """Goal of the wait in each round [s]."""


KINDS = {
    'robot_sender killed': Kind(('robot_sender',), (0.5, 3.0)),
    'operator_receiver killed': Kind(('operator_receiver',), (0.5, 3.0)),
    'source killed': Kind(('source',), (0.5, 3.0)),
    'robot reboots': Kind(('master', 'source', 'robot_sender'), (2.0, 10.0), 5.0, 10.0),
    'master killed': Kind(('master',), (0.5, 10.0), 5.0, 10.0),
    'link cut': Kind(down=(1.0, 30.0)),
    'address changed': Kind(),
    'second operator comes': Kind((SECOND_OPERATOR,)),
    'second operator goes': Kind(),
    'clock stepped': Kind(),
    'hostile flood': Kind(down=(10.0, 10.0)),
}
"""{name: Kind}"""

GENTLE = [kind for kind, one in KINDS.items() if not {'robot_sender', 'operator_receiver'}.intersection(one.restarts)]
"""The kinds that both nodes live through: how their memory grows is seen in long lives only."""

REBOOTS = 'robot reboots'
COMES, GOES = 'second operator comes', 'second operator goes'

STEPS = 1.0, 3600.0
"""Limits of the size of a step of the robot's clock [s]."""


@dataclass(frozen=True)
class Fault:
    """One fault."""
    kind: str
    """One of KINDS."""
    seconds: float
    """Duration of the fault, see Kind.down [s]."""
    step: float = 0.0
    """Step of the robot's clock, forwards or back [s]."""


def faults(seed: int, longest: float = math.inf, among: Collection[str] = tuple(KINDS)) -> Iterator[Fault]:
    """Endless faults. Every kind comes once before any comes again, in random order; the second operator comes first.

    :param longest: limit of Fault.seconds
    :param among: the kinds that come
    """
    chance = random.Random(seed)
    while True:
        kinds = list(among)
        chance.shuffle(kinds)
        second = iter((COMES, GOES))
        for kind in kinds:
            kind = next(second) if kind in (COMES, GOES) else kind
            low, high = KINDS[kind].down
            seconds = math.exp(chance.uniform(math.log(low), math.log(high))) if high else 0.0
            size = math.exp(chance.uniform(*map(math.log, STEPS)))
            sign = chance.choice((-1, 1))
            yield Fault(kind, min(seconds, longest), sign * size if kind == 'clock stepped' else 0.0)


class Stream(NamedTuple):
    """A stream at one operator."""
    name: str
    topic: str
    """Where the operator shows it."""
    operator: str
    """The operator's node."""
    origin: str
    """The part that publishes it on the robot: source or robot_sender."""
    kept: bool
    """Shown only where it changed: a map, and what is latched."""


def streams_of(config: Mapping[str, Mapping[str, Any]], operator: str) -> List[Stream]:
    """The streams of a streams.yaml at an operator.

    :param config: {name: settings}
    """
    return [Stream(name, settings['operator_topic'], operator,
                   'robot_sender' if settings['robot_topic'].startswith('/robot_sender/') else 'source',
                   settings['type'] == 'grid' or bool(settings.get('latch')))
            for name, settings in config.items()]


def awaited(streams: Iterable[Stream], restarted: Iterable[str]) -> List[Stream]:
    """The streams that show something new after a restart of these parts; without any, those that are not kept."""
    parts = set(restarted)
    return [stream for stream in streams if not stream.kept or parts & {stream.origin, stream.operator}]


def fresh(heard: Iterable[Heard], streams: Iterable[Stream], end: float, clock: float) -> Dict[Stream, float]:
    """When each stream was fresh first: {stream: arrival}, without those that are not yet.

    Fresh is a message that arrived after the fault's end and is stamped after it. A kept message may be older, and some
    types have no stamp: there the arrival alone counts.

    :param end: of the fault
    :param clock: how far the robot's clock is ahead
    """
    topics = {stream.topic: stream for stream in streams}
    found: Dict[Stream, float] = {}
    for message in heard:
        stream = topics.get(message.topic)
        if stream is None or stream in found or message.arrival <= end:
            continue
        if stream.kept or message.stamp is None or message.stamp - clock > end:
            found[stream] = message.arrival
    return found


class Registration(NamedTuple):
    """What a node has registered at a master."""
    uri: str
    names: Set[str]
    """Topics and services, each with its kind."""


class Registered(NamedTuple):
    """The state of the master from a time on."""
    at: float
    master: Optional[int]
    """Its process id; None: it does not answer."""
    nodes: Dict[str, Registration]


def registered_at(states: Sequence[Registered], part: str, end: float) -> Optional[float]:
    """When a part that was started at `end` had registered all that it has now; None: it has not.

    :param states: in order of time; the last one is the state now
    :param part: a node, or 'master': when it answered first
    """
    now = states[-1] if states else None
    if now is None or now.master is None or (part != 'master' and part not in now.nodes):
        return None
    for state in states:
        if state.at < end or state.master != now.master:
            continue
        if part == 'master':
            return state.at
        node = state.nodes.get(part)
        if node is not None and node.uri == now.nodes[part].uri and node.names >= now.nodes[part].names:
            return state.at
    return None


class Usage(NamedTuple):
    """The resources of a process."""
    threads: int
    descriptors: int
    memory: float
    """Resident [MB]."""


def usual(rounds: Sequence[Mapping[str, Usage]]) -> Dict[str, Usage]:
    """What is usual after some rounds: of each node, and of each number, the median; the lower one of two.

    A leak exceeds it once it has accumulated. What was there, or missing, in a single round does not change it.

    :param rounds: {node: its usage} of each; nodes that had ended are missing
    """
    nodes = dict.fromkeys(node for found in rounds for node in found)
    return {node: Usage(*map(statistics.median_low, zip(*(found[node] for found in rounds if node in found))))
            for node in nodes}


SPARE = 1
"""Threads and descriptors that may be there at one time and not at another: rospy connects, notices the end of a
connection, and ends threads when it next has something to send. A leak of one is found when it has happened some times.
"""


def surplus(usual: Mapping[str, Usage], now: Mapping[str, Usage], spare: int = 0) -> str:
    """Which nodes have more threads or descriptors than usual; empty: none.

    :param spare: number by which a count may exceed the usual one

    :param usual, now: {node: its usage}
    """
    return '; '.join(
        '%s: %s %d, was %d' % (node, what, getattr(now[node], what), getattr(usual[node], what))
        for node in usual if node in now for what in ('threads', 'descriptors')
        if getattr(now[node], what) > getattr(usual[node], what) + spare)


def memory_slope(times: Sequence[float], lives: Sequence[Any], memory: Sequence[float], warm_up: float,
                 begin: float = -math.inf) -> Optional[Tuple[float, float]]:
    """The growth of a node's resident memory: one slope of all its lives, by least squares.

    Each life has an intercept of its own: a process that was started again begins anew.

    :param times: of the samples [s]
    :param lives: which process each sample is of
    :param memory: [MB]
    :param warm_up: samples within this time after the first one of their life do not count [s]
    :param begin: nor do samples before this time [s]
    :return: (slope, its standard error) [MB/min]; None: too few samples
    """
    x, y, used = [], [], 0
    for life in dict.fromkeys(lives):
        samples = [(time, size) for time, other, size in zip(times, lives, memory) if other == life]
        samples = [(time, size) for time, size in samples if time >= max(begin, samples[0][0] + warm_up)]
        if len(samples) > 1:
            centred = np.array(samples) - np.mean(samples, axis=0)
            x.append(centred[:, 0] / 60)
            y.append(centred[:, 1])
            used += 1
    if not used:
        return None
    minutes, sizes = np.concatenate(x), np.concatenate(y)
    slope = float(minutes @ sizes / (minutes @ minutes))
    freedom = max(1, len(minutes) - used - 1)
    error = math.sqrt(float(np.sum((sizes - slope * minutes) ** 2)) / freedom / float(minutes @ minutes))
    return slope, error


class Waits(NamedTuple):
    """The waits after one kind of fault [s]; inf: a stream did not come back."""
    rounds: int
    median: float
    worst: float


def waits_by_kind(rounds: Iterable[Tuple[str, Optional[float]]]) -> Dict[str, Waits]:
    """{kind: its waits}, in the order of KINDS.

    :param rounds: (kind, wait [s]; None: a stream did not come back)
    """
    found: Dict[str, List[float]] = {kind: [] for kind in KINDS}
    for kind, wait in rounds:
        found[kind].append(math.inf if wait is None else wait)
    return {kind: Waits(len(waits), statistics.median(waits), max(waits)) for kind, waits in found.items() if waits}
