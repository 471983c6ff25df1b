# SPDX-License-Identifier: BSD-3-Clause
"""What the streams of every kind have in common, on either side."""
import collections
import functools
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Callable, Optional

import rospy

from .. import udpros
from ..congestion.operating_points import rate_levels
from .outbox import Outbox, size_of
from .parameters import OPERATOR, ROBOT
from .rate import NewestWorker

SHOWN = 512
"""Of so many messages at most it is kept, until it is asked for, how old and how complete they were."""


@dataclass
class Link:
    """How a node's streams reach the other side."""
    max_datagram_size: int
    """[byte of UDP payload]"""
    outbox: Outbox = field(default_factory=Outbox)
    """Through which the robot's streams send."""
    receive_buffer: int = 4 << 20
    """Asked of the operator's kernel for each stream [byte]."""
    drop: Optional[Callable] = None
    """Loses datagrams on purpose, see udpros.Subscriber."""
    motion: Any = None
    """Tells the operator's streams whether the robot stands(), and is told by pictures(changed) of theirs."""
    arrived: Callable = lambda *_: None
    """f(stream, number, seq, size, count, when), told what comes of the operator's streams, see udpros.Subscriber."""
    clock_offset: Callable = lambda: 0.0
    """f() -> how far the robot's clock is ahead of the operator's [s]."""

    def __post_init__(self):
        self.datagram_size = self.max_datagram_size
        """The longest that the robot's streams are to send now [byte of UDP payload]."""


def wire_topic(name):
    """Where a stream's segments cross."""
    return 'smokebot_udp/%s/segments' % name


class RobotStream(rospy.SubscribeListener):
    """Sends the newest messages of a robot's topic as segments.

    A kind derives from it: MESSAGE and SEGMENT are its message classes, and `frames(message)` makes the
    udpros.Frames that carry a message, or raises ValueError where the message is wrong. `settings` are those in
    force: as they are asked for, but for what the link leaves of them.
    """
    MESSAGE = SEGMENT = None
    PARAMETERS = ROBOT
    PROTECTED = False   # whether the link's other users wait for it, and it for none
    QUEUE_SIZE = 1
    STEADY = True   # a silent source is a fault

    def __init__(self, name, settings, link):
        self.name, self.topic = name, rospy.resolve_name(settings['robot_topic'])
        self.asked, self.granted, self.paused = dict(settings), {}, False
        self.settings = dict(settings)
        self.link = link
        self.received, self.sent = 0, 0     # messages of the source
        self._changing = threading.Lock()
        self._wrong = 0
        self._stamp = None   # of the last message sent
        self._size = None    # of that, on the air [byte]
        self._worker = NewestWorker(name, self._send, self._report, settings['rate'])
        self.prepare()

    def start(self):
        """Begin to send; apart from making a stream, which needs no ROS."""
        self._publisher = udpros.Publisher(
            wire_topic(self.name), self.SEGMENT, subscriber_listener=self, queue_size=10,
            max_datagram_size=self.link.max_datagram_size)
        self._worker.start()
        self._subscriber = rospy.Subscriber(self.topic, self.MESSAGE, self._count,
                                            queue_size=self.QUEUE_SIZE, buff_size=1 << 24, tcp_nodelay=True)

    def configure(self, changes):
        """Change settings while it runs.

        :param changes: {name: value}, checked each
        :raises ValueError: where they contradict each other; none is changed then
        """
        self._change(lambda: ({**self.asked, **changes},
                              {name: value for name, value in self.granted.items() if name not in changes}))
        if not self.settings['enabled']:
            self.link.outbox.drop(self.name)

    def levels(self, rate):
        """What the stream could do with less of the link than all it is asked for, see supervisor.levels.

        Where a kind does not say otherwise its messages come more rarely.

        :param rate: of the source [Hz]
        :return: [Level, ...], the cheapest first; empty where nothing is known of its messages yet
        """
        return rate_levels(rate, self._size) if self._size else []

    def refine(self, settings, spare):
        """The settings of a level, bettered by what the link has to spare [byte/s]; it may change with each call."""
        return settings

    def grant(self, settings):
        """What the link leaves of the settings: {name: value}; None: nothing at all, the stream waits."""
        self.paused = settings is None
        if settings is not None and settings != self.granted:
            self._change(lambda: (self.asked, settings))

    def _change(self, make):
        """Set what is asked and granted, as make() says; ValueError changes nothing."""
        with self._changing:
            before = self.asked, self.granted
            try:
                self._set(*make())
            except ValueError:
                self._set(*before)
                raise

    def _set(self, asked, granted):
        self.asked, self.granted, self.settings = asked, granted, {**asked, **granted}
        self.prepare()

    def prepare(self):
        """Make what depends on the settings; ValueError where they contradict each other."""
        self._worker.set_rate(self.settings['rate'])

    def frames(self, message):
        raise NotImplementedError

    @property
    def wanted(self):
        """Whether there is anybody to send to, and leave to."""
        return self.settings['enabled'] and not self.paused and self.heard

    @property
    def heard(self):
        """Whether anybody listens."""
        return self._publisher.get_num_connections() > 0

    def figures(self):
        """What the stream does and did, for diagnostics: all counts only grow, see nodes.diagnostics."""
        return {'in': self.received, 'out': self.sent, 'enabled': self.settings['enabled'],
                'rate': self.settings['rate'], 'steady': self.STEADY,
                'dropped': {'a newer one came': self._worker.replaced, 'wrong': self._wrong,
                            'datagrams of older ones': self.link.outbox.dropped(self.name)},
                'connections': self._publisher.connections(),
                'problem': 'the link is too slow for it, beside the others' if self.paused else None}

    def _count(self, message):
        self.received += 1
        self._receive(message)

    def _receive(self, message):
        if self.wanted:
            self._worker.give(message)

    def _send(self, message):
        self.link.outbox.await_rest(self.name)
        self.put(self.frames(self._told_apart(message)))
        self.sent += 1

    def put(self, frames):
        """Hand over the frames that carry a message, to be sent in their turn."""
        self._size = size_of(frames)
        self.link.outbox.put(self.name, self._publisher, frames)

    def _told_apart(self, message):
        """Segments belong together by their stamp, so a message that has none gets one, and none may come twice."""
        if message.header.stamp.is_zero():
            message.header.stamp = rospy.Time.now()
        if message.header.stamp == self._stamp:
            raise ValueError('its stamp is %d.%09d like the last one\'s: they cannot be told apart' % (
                message.header.stamp.secs, message.header.stamp.nsecs))
        self._stamp = message.header.stamp
        return message

    def _report(self, error):
        self._wrong += 1
        if not rospy.is_shutdown():
            rospy.logerr_throttle_identical(5, "stream '%s': a message of %s is not sent: %s" % (
                self.name, self.topic, error))

    def close(self):
        self._subscriber.unregister()
        self._worker.stop()
        self.link.outbox.drop(self.name)
        self._publisher.unregister()


class OperatorStream:
    """Makes messages from the segments that arrive.

    A kind derives from it and takes batches of segments in `take(records, mask)`, in the transport's thread.
    """
    MESSAGE = SEGMENT = None
    PARAMETERS = OPERATOR
    LATCH = False
    STEADY = True   # a silent robot is a fault

    def __init__(self, name, settings, link):
        self.name, self.topic = name, rospy.resolve_name(settings['operator_topic'])
        self.settings = dict(settings)
        self.link = link
        self.received, self.published = 0, 0
        self.last_shown = None      # when, by time.monotonic() [s]
        self._shown = collections.deque(maxlen=SHOWN)

    def start(self):
        """Begin to receive; apart from making a stream, which needs no ROS."""
        self._publisher = rospy.Publisher(self.topic, self.MESSAGE, queue_size=2, latch=self.LATCH, tcp_nodelay=True)
        self.subscriber = self.subscribe(max_datagram_size=self.link.max_datagram_size,
                                         receive_buffer=self.link.receive_buffer, drop=self.link.drop,
                                         arrived=functools.partial(self.link.arrived, self.name))

    def configure(self, changes):
        """Change settings while it runs: {name: value}, checked each."""
        self.settings = {**self.settings, **changes}

    def subscribe(self, **options):
        return udpros.Subscriber(wire_topic(self.name), self.SEGMENT, batch_callback=self.take, **options)

    def take(self, records, mask):
        raise NotImplementedError

    def publish(self, message, stamp, completeness=None):
        """Show a message.

        :param stamp: rospy.Time of what it shows, by the robot's clock; zero: unknown
        :param completeness: which share of it was received, 0..1; None: unknown
        """
        self._publisher.publish(message)
        self.published += 1
        self.last_shown = time.monotonic()
        self._shown.append(((rospy.Time.now() - stamp).to_sec() if stamp else None, completeness))

    def figures(self):
        """What the stream does and did, for diagnostics, see nodes.diagnostics; `shown` since the last call."""
        shown = [self._shown.popleft() for _ in range(len(self._shown))]
        return {'in': self.received, 'out': self.published, 'steady': self.STEADY, 'shown': shown,
                'dropped': dict(self.dropped), 'connections': self.subscriber.connections()}

    @property
    def dropped(self):
        """{reason: count} of the segments that changed nothing."""
        return {}

    def report(self, problem):
        rospy.logerr_throttle_identical(5, "stream '%s': %s" % (self.name, problem))

    def close(self):
        self.subscriber.unregister()
        self._publisher.unregister()
