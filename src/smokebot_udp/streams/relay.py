# SPDX-License-Identifier: BSD-3-Clause
"""Relay streams: small messages of any type as they are: odometry, battery, gas, tf.

Transforms are merged: of each pair of frames the newest is sent, those of many publishers in one message, as
many as fit a datagram. What is latched is sent again and again, for what was lost and who came late.
"""
import io
import threading

import rospy
from genpy.message import get_message_class

from .. import udpros
from ..mission.parameters import Parameter
from ..udpros.datagram import OVERHEAD
from .base import OperatorStream, RobotStream, wire_topic
from .parameters import OPERATOR, ROBOT
from .rate import Repeater

TF_TYPES = 'tf2_msgs/TFMessage', 'tf/tfMessage'
QUEUE = 100
"""Messages of other publishers that may wait while one is taken; they are small."""

MAX_PAIRS = 1000
"""Of so many pairs of frames transforms are kept: they come from the network, too."""

RELAY = {
    'message_type': Parameter(None, '', 'of both topics, such as nav_msgs/Odometry'),
    'latch': Parameter(False, '', 'whether the last message is kept for who comes late, on both sides'),
}


def message_class(name):
    """The class of a message type; ValueError where it is none, or not installed."""
    try:
        found = get_message_class(name)
    except ValueError:
        found = None
    if found is None:
        raise ValueError('message_type %r is no message type that is installed here' % name)
    return found


class Merged:
    """What is to be sent of what came: the newest message, or of transforms the newest of each pair of frames."""

    def __init__(self, message_type, keep):
        """:param keep: whether what was taken stays, to be sent again"""
        self.class_, self.keep = message_class(message_type), keep
        self.is_tf = message_type in TF_TYPES
        self._lock = threading.Lock()
        self._parts = {}    # {(parent, child) or None: transform or message}

    def add(self, message):
        with self._lock:
            if self.is_tf:
                for transform in message.transforms:
                    pair = transform.header.frame_id, transform.child_frame_id
                    if pair not in self._parts and len(self._parts) >= MAX_PAIRS:
                        raise ValueError('there are more than %d pairs of frames; %s to %s is left out' % (
                            (MAX_PAIRS,) + pair))
                    self._parts[pair] = transform
            else:
                self._parts[None] = message

    def take(self, room):
        """[message, ...]: all there is to be sent; transforms in messages of up to `room` bytes where they can."""
        with self._lock:
            parts = list(self._parts.values())
            if not self.keep:
                self._parts.clear()
        return self._in_groups(parts, room) if self.is_tf else parts

    def _in_groups(self, transforms, room):
        messages, left = [], 0
        for transform in transforms:
            size = size_of(transform)
            if size > left:
                messages.append(self.class_())
                left = room - size_of(messages[-1])
            messages[-1].transforms.append(transform)
            left -= size
        return messages


def stamp_of(message):
    """When what a message tells of was so, rospy.Time; None where it does not tell."""
    if hasattr(message, 'transforms'):
        return max((transform.header.stamp for transform in message.transforms), default=None)
    return message.header.stamp if message._has_header else None


def size_of(message):
    """Its bytes on the wire."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.tell()


class RelaySender(RobotStream):
    """Sends small messages, at most `rate` a second, always the newest."""
    QUEUE_SIZE, PROTECTED = QUEUE, True
    LEAST = {'rate': 1.0, 'repeat_rate': 0.2}   # a slow link takes no more of these settings [Hz]
    PARAMETERS = {
        **ROBOT, **RELAY,
        'repeat_rate': Parameter(1.0, 'Hz', 'with latch: the last message is sent again so often', above=0.0,
                                 most=100.0, live=True),
    }

    def __init__(self, name, settings, link):
        self._merged = Merged(settings['message_type'], settings['latch'])
        self.MESSAGE = self.SEGMENT = self._merged.class_
        self.STEADY = not settings['latch']
        self._room = link.max_datagram_size - OVERHEAD
        self._rounds = Repeater(name + ' rounds', lambda: self._worker.give(True), self._report,
                                1.0 / settings['repeat_rate'])
        super().__init__(name, settings, link)

    def prepare(self):
        super().prepare()
        self._rounds.period = 1.0 / self.settings['repeat_rate']

    def start(self):
        super().start()
        if self._merged.keep:
            self._rounds.start()

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        """Who came late gets what is latched at once."""
        self._rounds.wake()

    def _receive(self, message):
        if self._merged.keep or self.wanted:
            try:
                self._merged.add(message)
            except ValueError as error:
                self._report(error)
            self._worker.give(True)

    def _send(self, _):
        if not self.wanted:
            return
        for message in self._merged.take(self._room):
            size = size_of(message)
            if size > self._room:
                rospy.logwarn_throttle_identical(
                    60, "stream '%s': a message of %s has %d bytes and takes %d datagrams: each one lost loses it" % (
                        self.name, self.topic, size, -(-size // self._room)))
            self.link.outbox.publish(self.name, self._publisher, message, size)
            self.sent += 1

    def close(self):
        self._rounds.stop()
        super().close()


class RelayReceiver(OperatorStream):
    """Publishes each message that came; of latched transforms all that came so far."""
    PARAMETERS = {**OPERATOR, **RELAY}

    def __init__(self, name, settings, link):
        self._merged = Merged(settings['message_type'], settings['latch'])
        self.MESSAGE = self.SEGMENT = self._merged.class_
        self.LATCH, self.STEADY = settings['latch'], not settings['latch']
        self._last = None       # latched transforms
        super().__init__(name, settings, link)

    def subscribe(self, **options):
        return udpros.Subscriber(wire_topic(self.name), self.SEGMENT, self._take, queue_size=QUEUE, **options)

    def _take(self, message):
        self.received += 1
        if self._merged.is_tf and self._merged.keep:
            # of latched messages only the last one is kept, so it has to have all of them
            try:
                self._merged.add(message)
            except ValueError as error:
                self.report(error)
            message, = self._merged.take(float('inf'))
            if message == self._last:
                return      # it is sent again and again
            self._last = message
        self.publish(message, stamp_of(message))
