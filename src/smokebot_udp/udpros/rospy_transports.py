# SPDX-License-Identifier: BSD-3-Clause
"""UDPROS connections as rospy's topics hold them: rospy's Transport and topic classes, extended."""
import contextlib
import io
import threading
import time
import traceback

import numpy as np
import rospy
from rospy.exceptions import TransportTerminated
from rospy.impl.transport import INBOUND, OUTBOUND, Transport
from rospy.topics import _PublisherImpl, _SubscriberImpl

from . import datagram
from .endpoints import DatagramSender, PeerGone
from .negotiation import PROTOCOL
from .records import LayoutError, has_header, lengths_of, record_dtype
from .subscription import Subscription


class UdpTransport(Transport):
    """What the two ends of a connection have in common: how rosnode shows them."""
    transport_type = PROTOCOL
    _fileno = None

    def fileno(self):
        return self._fileno

    def get_transport_info(self):
        return '%s connection on port %s to [%s:%s on socket %s]' % (
            (self.transport_type, self.local_endpoint[1]) + tuple(self.remote_endpoint[:2]) + (self._fileno,))


class PublisherTransport(UdpTransport):
    """A publisher's connection to one subscriber."""

    def __init__(self, topic, request, connection_id, max_datagram_size):
        super().__init__(OUTBOUND, name=topic)
        self.endpoint_id = request.header['callerid']
        self.connection_id, self.max_datagram_size = connection_id, max_datagram_size
        self.pacer = None
        self.sender = DatagramSender(request.host, request.port)
        self._fileno = self.sender.socket.fileno()
        self.local_endpoint, self.remote_endpoint = self.sender.local, self.sender.remote
        self.stat_num_datagram = 0
        self._last_id = 0
        self._lock = threading.Lock()

    def write_data(self, data):
        """Send one message, its length prefix included, as rospy's publishers give it."""
        with self._sending():
            self._last_id = self._last_id % datagram.MESSAGE_IDS + 1
            if len(data) <= self.max_datagram_size - datagram.HEADER.size:
                header = datagram.HEADER.pack(self.connection_id, datagram.Op.DATA0, self._last_id, 1)
                sent = self.sender.send_one(header, data)
            else:
                size = self.max_datagram_size
                blocks = datagram.split(data, self.connection_id, self._last_id, size)
                sent = self.sender.send(blocks, size, -(-len(blocks) // size), self.pacer)
            self._count(1, sent, len(data))
        return True

    def write_frame(self, frame):
        """Send a frame's messages, each a datagram where the connection takes one so long."""
        if frame.datagram_size > self.max_datagram_size:
            for row in frame.rows:
                self.write_data(row[datagram.HEADER.size:].tobytes())
            return
        with self._sending():
            ids = datagram.message_ids(self._last_id, len(frame))
            self._last_id = int(ids[-1])
            frame.header['connection_id'], frame.header['message_id'] = self.connection_id, ids
            sent = self.sender.send(frame.rows, frame.datagram_size, len(frame), self.pacer)
            self._count(len(frame), sent, frame.rows.size)

    @contextlib.contextmanager
    def _sending(self):
        with self._lock:
            if self.done:
                raise TransportTerminated('connection closed')
            try:
                yield
                return
            except PeerGone as error:
                gone = error
        rospy.loginfo('[%s]: subscriber %s is gone: %s', self.name, self.endpoint_id, gone)
        self.close()
        raise TransportTerminated(str(gone)) from gone

    def _count(self, messages, datagrams, size):
        self.stat_num_msg += messages
        self.stat_num_datagram += datagrams
        self.stat_bytes += size

    def close(self):
        if not self.done:
            self.done = True
            super().close()
            with self._lock:
                self.sender.close()


class SubscriberTransport(UdpTransport):
    """A subscriber's connection to one publisher: a Subscription, its thread, and how its messages are read."""

    def __init__(self, impl, receiver, reply, publisher_uri, hosts):
        super().__init__(INBOUND, name=impl.resolved_name)
        self.endpoint_id = publisher_uri
        self.header, self.md5sum, self.type = reply.header, reply.header['md5sum'], reply.header['type']
        self.callerid_pub = reply.header.get('callerid', 'unknown')
        self.is_latched, self.latch = reply.header.get('latching') == '1', None
        self.local_endpoint, self.remote_endpoint = receiver.address, (reply.host, reply.port)
        self._fileno = receiver.socket.fileno()
        self.publisher_pid = None
        self._impl = impl
        self.subscription = Subscription(receiver, reply, hosts, self, impl.data_class, impl.queue_size,
                                         impl.options.coalesce if impl.batch_callbacks else 0.0, impl.options.drop,
                                         impl.options.arrived)
        self._thread = threading.Thread(target=self._run, name='UDPROS ' + impl.resolved_name, daemon=True)

    def start(self):
        self._thread.start()

    def _run(self):
        try:
            self.subscription.run()
        except Exception:   # a bug of ours must not leave a connection that only looks alive
            rospy.logerr('[%s]: receiving from %s failed: %s', self.name, self.callerid_pub, traceback.format_exc())
        finally:
            self.close()

    @property
    def idle(self):
        """Since when nothing has come [s]."""
        return time.monotonic() - self.subscription.last_arrival

    @property
    def wants_batches(self):
        return bool(self._impl.batch_callbacks)

    @property
    def wants_messages(self):
        return bool(self._impl.callbacks)

    def take_records(self, records, mask):
        self._update_counts()
        self._impl.call_batch(records, mask)

    def take_message(self, data):
        self._update_counts()
        try:
            message = self._impl.data_class().deserialize(data)
        except Exception:   # genpy's readers on hostile bytes raise DeserializationError, UnicodeError, ...
            self.subscription.inbox.dropped['message'] += 1
            return
        message._connection_header = self.header
        if self.is_latched:
            self.latch = message
        self._impl.receive_callback([message], self)

    def _update_counts(self):
        self.stat_bytes, self.stat_num_msg = self.subscription.bytes, self.subscription.datagrams

    def close(self):
        if not self.done:
            self.done = True
            self.subscription.stop()
            super().close()


class UdpPublisherImpl(_PublisherImpl):
    """A topic's publishing side that sends frames, and sends by UDP without a queue or a thread."""

    def __init__(self, name, data_class, options):
        super().__init__(name, data_class)
        self.options = options

    def add_connection(self, c):
        if not isinstance(c, PublisherTransport):
            return super().add_connection(c)
        c.pacer = self.options.pacer
        with self.c_lock:
            queue_size, self.queue_size = self.queue_size, None   # a datagram leaves at once or is lost
            try:
                return super().add_connection(c)
            finally:
                self.queue_size = queue_size

    def publish_frames(self, frames):
        """Number the frames' messages, and send them to one connection after the other."""
        for frame in frames:
            if has_header(self.data_class):   # the numbering of rospy.msg.serialize_message
                frame.records['header']['seq'] = self.seq + 1 + np.arange(len(frame))
            self.seq += len(frame)
            self.message_data_sent += frame.rows.size
        stream = None
        for connection in self.connections:
            try:
                if isinstance(connection, PublisherTransport):
                    for frame in frames:
                        connection.write_frame(frame)
                else:
                    stream = b''.join(frame.stream() for frame in frames) if stream is None else stream
                    connection.write_data(stream)
            except Exception as error:   # as rospy's publish: whatever failed ends this connection only
                rospy.logdebug('[%s]: %s ended: %s', self.resolved_name, connection.endpoint_id, error)
                connection.close()


class UdpSubscriberImpl(_SubscriberImpl):
    """A topic's subscribing side that asks for UDPROS, as its options say."""

    def __init__(self, name, data_class, options):
        super().__init__(name, data_class)
        self.options = options
        self.batch_callbacks = []
        self.publishers = ()        # their URIs, as the master last said
        self.connecting = set()     # of them, those being asked just now
        self.last_asked = time.monotonic()  # when the master was last asked for them

    def call_batch(self, records, mask):
        for callback in self.batch_callbacks:
            self._invoke_callback(records, callback, mask)

    def receive_callback(self, msgs, connection):
        """As rospy's; messages that came by TCPROS reach the batch callbacks too, as batches of one."""
        super().receive_callback(msgs, connection)
        if self.batch_callbacks and not isinstance(connection, SubscriberTransport):
            for message in msgs:
                with contextlib.suppress(LayoutError):
                    self.call_batch(_as_records(message), np.ones(1, bool))


def _as_records(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    data = buffer.getvalue()
    return np.frombuffer(data, record_dtype(type(message), lengths_of(type(message), data)))
