# SPDX-License-Identifier: BSD-3-Clause
"""What the integration tests share: waiting for events with a deadline, and reports of skipped tests."""
import contextlib
import functools
import itertools
import os
import pathlib
import random
import socket
import sys
import threading
import time
import xml.etree.ElementTree as ElementTree
import xmlrpc.client
from typing import Any, Callable, Dict, Iterator, List, Sequence

import rosgraph
import rospy
from rosgraph_msgs.msg import Log
from rosunit import xmlrunner

from smokebot_udp.streams.blank import has_blank

LOOK_PERIOD, POLL_PERIOD = 0.01, 0.02
"""Interval at which Lateness looks at the clock, and at which wait_for looks at its condition [s]."""

MAX_LATENESS, MAX_SLOWNESS, ATTEMPTS = 0.1, 1.5, 8
"""Lateness of its process [s], or processes per processor, from which a test of times is repeated, and maximum number
of attempts."""

LEAST_PORT = 20000
"""Ports below are left to programs with a fixed port, as the master."""

CALM, TIMEOUT = 1.0, 10.0
"""Time without disturbance after which a test of times is repeated, and time after which it is repeated anyway [s]."""


FAILURES = AssertionError, ArithmeticError, LookupError, ValueError
"""What a test of times may raise: also for want of what it measures, as for the least of no rates."""


class ResultWithSkips(xmlrunner._XMLTestResult):
    """Reports skipped tests: rosunit itself writes them as passed, and a whole skipped class not at all."""

    def xml(self, time_taken: float, out: str, err: str) -> Any:
        tree = super().xml(time_taken, out, err)
        suite = tree.getroot()
        cases = {'%s.%s' % (case.get('classname'), case.get('name')): case for case in suite.iter('testcase')}
        for test, reason in self.skipped:
            case = cases.get(test.id())
            if case is None:
                case = ElementTree.SubElement(suite, 'testcase', classname=self._test_name, name=test.id())
            ElementTree.SubElement(case, 'skipped', message=reason)
        return tree


xmlrunner._XMLTestResult = ResultWithSkips


def errors_logged() -> List[str]:
    """The texts of the errors that any node logs from now on; rospy keeps the subscriber."""
    errors: List[str] = []
    rospy.Subscriber('/rosout', Log, lambda log: errors.append(log.msg) if log.level >= Log.ERROR else None)
    return errors


def slowness() -> float:
    """How much longer than on an idle machine things take: how many processes share each processor."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def wait_for(condition: Callable[[], Any], seconds: float = 20.0, what: str = 'the condition') -> Any:
    """The first true value of condition(); AssertionError after `seconds`, or longer on a busy machine.

    The time does not count in which this process waits for the processor: the nodes may do so, too.
    """
    begun, stalled = time.monotonic(), 0.0
    while True:
        now = time.monotonic()      # however long a look takes, the last one begins after the time has passed
        value = condition()
        if value:
            return value
        assert now - begun - stalled < seconds * slowness(), '%s did not come in %.1f s' % (what, now - begun)
        assert not rospy.is_shutdown(), 'the node was shut down'
        slept = time.monotonic()
        time.sleep(POLL_PERIOD)
        stalled += max(0.0, time.monotonic() - slept - POLL_PERIOD)


def give_time(seconds: float) -> None:
    """Let time pass: something is measured meanwhile, or must not happen, and nothing announces the end of that."""
    time.sleep(seconds)


def is_silent(found: Sequence[Any], seconds: float = 1.0) -> bool:
    """Whether nothing is appended to a list within this time."""
    count = len(found)
    give_time(seconds)
    return len(found) == count


def ticks(rate: float) -> Iterator[None]:
    """`rate` times a second, each yielded when it is due, until the node is shut down."""
    due = time.monotonic()
    while not rospy.is_shutdown():
        time.sleep(max(0.0, due - time.monotonic()))
        due += 1.0 / rate
        yield


def stays(condition: Callable[[], Any], seconds: float, what: str = 'the condition') -> None:
    """AssertionError where condition() does not stay true for `seconds`: nothing announces what must not happen."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        assert condition(), '%s did not last %g s' % (what, seconds)
        time.sleep(0.02)


class Lateness:
    """How late this process gets the processor, while the context lasts: nodes beside it do not get it sooner."""

    def __init__(self) -> None:
        self.most = 0.0
        """[s]"""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def _look(self) -> None:
        begun = time.monotonic()
        while not self._ended.wait(LOOK_PERIOD):
            now = time.monotonic()
            self.most, begun = max(self.most, now - begun - LOOK_PERIOD), now

    def disturbed(self, most: float = MAX_LATENESS) -> bool:
        """Whether the machine does other things as well: this process had to wait for longer, or others have to.

        :param most: [s]
        """
        return self.most >= most or slowness() >= MAX_SLOWNESS

    def __enter__(self) -> 'Lateness':
        self._thread.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._ended.set()
        self._thread.join()


def await_calm(most: float) -> None:
    """Wait until the machine does nothing else, but not for long: the nodes of the test may keep it busy themselves.

    :param most: see Lateness.disturbed
    """
    for _ in range(int(TIMEOUT / CALM)):
        with Lateness() as lateness:
            give_time(CALM)
        if not lateness.disturbed(most):
            return


def undisturbed(most: float = MAX_LATENESS) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorates a test of times or rates, or a step of one, which a machine that does other things as well may change.

    It is repeated where it fails, see Lateness.disturbed.

    :param most: it is judged where no wait was longer [s]
    """
    def decorated(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def repeated(case: Any, *arguments: Any) -> None:
            for last in (ATTEMPTS - 1) * (False,) + (True,):
                with Lateness() as lateness:
                    try:
                        test(case, *arguments)
                        return
                    except FAILURES as error:
                        failure = error
                if last or not lateness.disturbed(most):
                    raise failure
                print('%s is repeated: this process had to wait for %.2f s, load %.1f; %s' % (
                    case.id(), lateness.most, os.getloadavg()[0], str(failure)[:200]), file=sys.stderr)
                case.doCleanups()
                await_calm(most)
                case.setUp()
        return repeated
    return decorated


def pid_at(uri: str) -> int:
    """The process id of the node at a URI; 0: there is no node, or it does not answer.

    Not for os.kill before it has answered: there 0 means the caller's own group.
    """
    try:
        with xmlrpc.client.ServerProxy(uri or 'http://localhost:1') as proxy:
            node: Any = proxy
            return int(node.getPid('/test')[2])
    except OSError:
        return 0


def free_port() -> int:
    """A port that no other program gets unasked: it is below those of outgoing connections.

    One of these could take the port before it is used, or while the server there is being restarted: who connects to
    localhost then may even be connected to itself.
    """
    first = int(pathlib.Path('/proc/sys/net/ipv4/ip_local_port_range').read_text().split()[0])
    ports = list(range(LEAST_PORT, first)) or [0]
    while True:
        port = random.SystemRandom().choice(ports)
        with contextlib.suppress(OSError), socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
            tcp.bind(('', port))
            found = int(tcp.getsockname()[1])
            udp.bind(('', found))
            return found


def is_sent_here(topic: str, node: str = '') -> bool:
    """Whether a node sends the messages of a topic to this node by TCP; empty: any node."""
    master = rosgraph.Master(rospy.get_name())
    try:
        publishers = [node] if node else dict(master.getSystemState()[0]).get(topic, [])
        for uri in map(master.lookupNode, publishers):
            with xmlrpc.client.ServerProxy(uri) as proxy:
                publisher: Any = proxy
                if any(entry[1:5] == [rospy.get_name(), 'o', 'TCPROS', topic]
                       for entry in publisher.getBusInfo(rospy.get_name())[2]):
                    return True
    except (rosgraph.MasterException, xmlrpc.client.Error, OSError):    # it starts, or has just ended
        pass
    return False


class Collector:
    """A subscriber that keeps all messages: {stamp: message}, and when each arrived: {stamp: [s]}.

    Blank ones in place of an old cloud or scan do not count.
    """

    def __init__(self, topic: str, message_class: Any) -> None:
        self.messages: Dict[Any, Any] = {}
        self.arrivals: Dict[Any, float] = {}
        self._lock = threading.Lock()
        self._subscriber = rospy.Subscriber(topic, message_class, self._take, queue_size=100, buff_size=1 << 25)

    def _take(self, message: Any) -> None:
        if has_blank(type(message)) and not message.header.stamp:
            return
        with self._lock:
            self.messages[message.header.stamp] = message
            self.arrivals[message.header.stamp] = time.monotonic()

    def clear(self) -> None:
        with self._lock:
            self.messages, self.arrivals = {}, {}

    def newest(self) -> Any:
        """The message with the newest stamp; None: there is none. max(messages) may fail while messages come."""
        with self._lock:
            return self.messages[max(self.messages)] if self.messages else None

    def wait_connected(self) -> None:
        """Wait until a publisher sends to this. rospy's adds a connection only after the subscriber counts it."""
        wait_for(lambda: is_sent_here(self._subscriber.resolved_name),
                 what='a publisher of %s' % self._subscriber.resolved_name)


def stamps(count: int, rate: float) -> Iterator[Any]:
    """`count` times, `rate` per second, each yielded when it is due."""
    for _ in itertools.islice(ticks(rate), count):
        yield rospy.Time.now()
