# SPDX-License-Identifier: BSD-3-Clause
"""What the integration tests have in common: events awaited with a deadline, never guessed at."""
import threading
import time
import xml.etree.ElementTree as ElementTree

import rospy
from rosunit import xmlrunner


class ResultWithSkips(xmlrunner._XMLTestResult):
    """A result that tells of skipped tests: rosunit itself writes them as passed, a whole class of them not at all."""

    def xml(self, time_taken, out, err):
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


def wait_for(condition, seconds=20.0, what='the condition'):
    """Return condition()'s first true value; AssertionError after `seconds`."""
    deadline = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        assert time.monotonic() < deadline, '%s did not come in %g s' % (what, seconds)
        assert not rospy.is_shutdown(), 'the node was shut down'
        time.sleep(0.02)


class Collector:
    """A subscriber that keeps what it gets: {stamp: message}, and when each came."""

    def __init__(self, topic, message_class):
        self.messages, self.arrivals = {}, {}
        self._lock = threading.Lock()
        self._subscriber = rospy.Subscriber(topic, message_class, self._take, queue_size=100, buff_size=1 << 25)

    def _take(self, message):
        with self._lock:
            self.messages[message.header.stamp] = message
            self.arrivals[message.header.stamp] = time.monotonic()

    def clear(self):
        with self._lock:
            self.messages, self.arrivals = {}, {}

    def wait_connected(self):
        wait_for(self._subscriber.get_num_connections, what='a publisher of %s' % self._subscriber.name)


def stamps(count, rate):
    """`count` times, `rate` a second, as they come due."""
    due = time.monotonic()
    for _ in range(count):
        time.sleep(max(0.0, due - time.monotonic()))
        due += 1.0 / rate
        yield rospy.Time.now()
