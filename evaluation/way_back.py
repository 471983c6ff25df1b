# SPDX-License-Identifier: BSD-3-Clause
"""What is measured on the way back over an emulated link; way_back_results.py judges it.

A robot that drives gets commands from its operator until `rest`.
"""
import collections
import concurrent.futures
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from smokebot_udp.link_lab.link_trace import SIDES

from . import teleoperated
from .polling import wait_for
from .way_back_nodes import ESTOP, POLLING, REST, STARTING, TIMEOUT, WayBackNodes
from .way_back_results import Log

NARROW = {'rate': 20e6}
"""Raw images fill this link [bit/s]."""

CUT = 1.0
"""Duration of a cut of the link that is long enough for a stop [s]."""

PAUSES = 0.3, 0.8
"""Limits of the time from when the robot drives until something happens [s]."""

MESSAGE_RATE = 50.0
"""Rate of reliable messages [Hz]."""

BRIEF_AGE = 2.0
"""Maximum age of messages of the relays `brief_...` [s]."""

GIVEN_UP = 'given up'
"""Text that is in what a node writes about messages that it gives up."""

Raw = Dict[str, Any]


def commands(nodes: WayBackNodes, seconds: float, conditions: Mapping[str, float],
             meanwhile: Optional[Callable[[float], None]] = None) -> Raw:
    """Commands at a steady rate.

    :param meanwhile: f(seconds), which takes this time; None: nothing happens
    """
    begun = nodes.settle(conditions)
    before, since = nodes.counts(), time.time()
    (meanwhile or time.sleep)(seconds)
    state = {**nodes.state(), **air(before, nodes.counts(), (time.time() - since) * nodes.conditions['rate'])}
    return {'kind': 'commands', 'sent': nodes.rest(), 'heard': nodes.speeds(begun), 'since': since, 'state': state}


def air(before: Mapping[str, Any], after: Mapping[str, Any], capacity: float) -> Dict[str, float]:
    """How far the air was used, and how long the operator's packets waited for it, for a row of a CSV file.

    :param before, after: Lab.counts()
    :param capacity: meanwhile [bit]
    """
    carried = sum(after[side]['carried'] - before[side]['carried'] for side in SIDES)
    waited = collections.Counter(after['waited']['operator'])
    waited.subtract(before['waited']['operator'])
    times = sorted(waited.elements())
    return {'used': round(8 * carried / capacity, 3), 'queue p99 [ms]': times[len(times) * 99 // 100] if times else 0}


def outages(nodes: WayBackNodes, seconds: float) -> None:
    """Cuts of a second, with a second or two between them."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(nodes.random.uniform(1.0, 2.0))
        list(nodes.cut(CUT))


def cuts(nodes: WayBackNodes, count: int) -> Raw:
    """The link is cut while the operator drives on."""
    def cut() -> List[float]:
        times = list(nodes.cut(CUT))
        if not nodes.moves():
            nodes.drive(STARTING)
        return times
    return stops(nodes, count, cut)


def kills(nodes: WayBackNodes, count: int) -> Raw:
    """operator_receiver is killed while the operator drives on."""
    def kill() -> List[float]:
        begun = time.time()
        nodes.kill_receiver()
        time.sleep(CUT)
        nodes.start_receiver()
        restarted = time.time()
        nodes.drive(STARTING)
        return [begun, restarted]
    return stops(nodes, count, kill)


def stops(nodes: WayBackNodes, count: int, interrupt: Callable[[], List[float]]) -> Raw:
    """:param interrupt: f() -> [when commands cannot arrive any more, when they can again]; the robot drives then"""
    since = nodes.settle({})
    events = []
    for _ in range(count):
        time.sleep(nodes.random.uniform(*PAUSES))
        events.append(interrupt())
    state = nodes.state()
    return {'kind': 'stops', 'sent': nodes.rest(), 'heard': nodes.speeds(since), 'events': events, 'state': state}


def estops(nodes: WayBackNodes, count: int, conditions: Mapping[str, float]) -> Raw:
    """The emergency stop while the operator drives on."""
    since = nodes.settle(conditions)
    before, begun = nodes.counts(), time.time()
    tries = []
    for _ in range(count):
        time.sleep(nodes.random.uniform(*PAUSES))
        published = nodes.teleoperators['operator'].estop(True)
        engaged = flagged(nodes, True, published)
        time.sleep(nodes.random.uniform(*PAUSES))
        asked = nodes.teleoperators['operator'].estop(False)
        tries.append((published, engaged, asked, flagged(nodes, False, asked)))
        nodes.drive(STARTING)
    state = {**nodes.state(), **air(before, nodes.counts(), (time.time() - begun) * nodes.conditions['rate'])}
    return {'kind': 'estops', 'sent': nodes.rest(), 'heard': nodes.speeds(since), 'tries': tries, 'state': state}


def flagged(nodes: WayBackNodes, engaged: bool, since: float) -> Optional[float]:
    """When the robot's emergency stop was engaged, or released; None: it was not."""
    found = wait_for(lambda: [at for flag, at in nodes.heard('robot', ESTOP, since) if flag == engaged], TIMEOUT,
                     POLLING)
    return float(found[0]) if found else None


def calls(nodes: WayBackNodes, count: int, at_once: int, conditions: Mapping[str, float]) -> Raw:
    """Calls of a service that counts."""
    nodes.settle(conditions)
    nodes.rest()
    since = time.time()
    called = nodes.teleoperators['operator'].call(count, at_once, count * TIMEOUT / at_once)
    time.sleep(REST)    # what is repeated has come
    executed = [content for content, _ in nodes.heard('robot', teleoperated.SERVICE, since)]
    return {'kind': 'calls', 'calls': called, 'executed': executed, 'state': nodes.state()}


def reliable(nodes: WayBackNodes, count: int, conditions: Mapping[str, float]) -> List[Raw]:
    """Reliable messages in both directions at once: to the robot, and to the operator."""
    nodes.settle(conditions)
    nodes.rest()
    logs = sent_both_ways(nodes, '', count, lambda: None)
    state = nodes.state()
    return [{'kind': 'reliable', 'sent': sent, 'heard': heard, 'state': state} for sent, heard in logs]


def give_up(nodes: WayBackNodes) -> List[Raw]:
    """Reliable messages that may be BRIEF_AGE old, and a longer cut; as of `reliable`."""
    nodes.settle({})
    nodes.rest()
    written = nodes.log.stat().st_size
    times: List[float] = []

    def cut() -> None:
        time.sleep(BRIEF_AGE)
        times.extend(nodes.cut(2 * BRIEF_AGE))
    logs = sent_both_ways(nodes, 'brief_', int(4 * BRIEF_AGE * MESSAGE_RATE), cut)
    said = [line for line in nodes.log.read_bytes()[written:].decode(errors='replace').splitlines()
            if GIVEN_UP in line]
    return [{'kind': 'given up', 'sent': sent, 'heard': heard, 'cut': times[0], 'restored': times[1],
             'max_age': BRIEF_AGE, 'said': said, 'state': nodes.state()} for sent, heard in logs]


def sent_both_ways(nodes: WayBackNodes, prefix: str, count: int,
                   meanwhile: Callable[[], None]) -> List[Tuple[Log, Log]]:
    """(sent, heard) of the messages to the robot, and of those to the operator.

    :param prefix: of the topics' names
    """
    since = time.time()
    with concurrent.futures.ThreadPoolExecutor() as pool:
        sending = [pool.submit(nodes.teleoperators[side].send, topic, count, MESSAGE_RATE) for side, topic in (
            ('operator', '/operator/%sto_robot' % prefix), ('robot', '/%sto_operator' % prefix))]
        meanwhile()
        sent = [future.result() for future in sending]
    received = ('robot', '/%sto_robot' % prefix), ('operator', '/operator/%sto_operator' % prefix)

    def heard() -> List[Log]:
        return [nodes.heard(side, topic, since) for side, topic in received]
    wait_for(lambda: all(log and log[-1][0] == count - 1 for log in heard()), TIMEOUT, POLLING)
    time.sleep(REST)    # what is repeated has come
    return list(zip(sent, heard()))
