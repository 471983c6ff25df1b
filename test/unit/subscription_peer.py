# SPDX-License-Identifier: BSD-3-Clause
"""A publisher of arbitrary bytes, a Subscription, and the loopback device between them."""
import io
import threading
from typing import Any, Iterator

from polling import WAIT
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String

from smokebot_udp.udpros.datagram import split
from smokebot_udp.udpros.endpoints import DatagramReceiver, DatagramSender
from smokebot_udp.udpros.negotiation import Reply
from smokebot_udp.udpros.subscription import Subscription

CONNECTION = 5
SIZE = 200


def serialised(message) -> Any:
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


class Topic:
    """Keeps what is delivered."""

    def __init__(self, batches, messages) -> None:
        self.wants_batches, self.wants_messages = batches, messages
        self.batches, self.messages = [], []
        self._new = threading.Condition()

    def take_records(self, records, mask) -> None:
        with self._new:
            self.batches.append([record.tobytes() for record in records[mask]])
            self._new.notify_all()

    def take_message(self, message) -> None:
        with self._new:
            self.messages.append(message)
            self._new.notify_all()

    @property
    def records(self) -> Any:
        return [record for batch in self.batches for record in batch]

    def wait_for(self, last) -> None:
        with self._new:
            assert self._new.wait_for(lambda: (last in self.messages or not self.wants_messages) and
                                      (last in self.records or not self.wants_batches), WAIT)


class Peer:
    """A subscription, its thread if it is started, and the publisher's socket."""

    def __init__(self, message_class=String, batches=False, messages=True, hosts=('127.0.0.1',), receiver=None,
                 **options) -> None:
        self.receiver = receiver or DatagramReceiver('127.0.0.1', SIZE)
        self.sender = DatagramSender('127.0.0.1', self.receiver.address[1])
        self.topic = Topic(batches, messages)
        self.subscription = Subscription(self.receiver, Reply('127.0.0.1', 1, CONNECTION, SIZE, {}), hosts, self.topic,
                                         message_class, **options)
        self.counted = self.subscription.depacketizer
        self.thread = threading.Thread(target=self.subscription.run, daemon=True)
        self._last_id = 0

    def start(self) -> Any:
        self.thread.start()
        return self

    def send(self, *messages) -> None:
        for message in messages:
            self._last_id = self._last_id % 255 + 1
            data = split(len(message).to_bytes(4, 'little') + message, CONNECTION, self._last_id, SIZE)
            assert self.sender.send(data, SIZE, -(-len(data) // SIZE))

    def send_and_wait(self, *messages) -> None:
        """Send messages, the last one unique, and wait until it has arrived."""
        self.send(*messages)
        self.topic.wait_for(messages[-1])

    def close(self) -> None:
        self.subscription.stop()
        if self.thread.ident is not None:
            self.thread.join(WAIT)
            assert not self.thread.is_alive()
        self.receiver.close()
        self.sender.close()


def peers() -> Iterator[Any]:
    """For a fixture: f(*arguments of Peer) -> Peer; all are closed at its end."""
    made = []

    def make_one(*args, **kwargs) -> Any:
        made.append(Peer(*args, **kwargs))
        return made[-1]

    yield make_one
    for peer in made:
        peer.close()


def text(n, length=0) -> Any:
    return serialised(String(('%d' % n).ljust(length, '.')))


def datagram(message, connection_id=CONNECTION, message_id=1) -> Any:
    return bytes(split(len(message).to_bytes(4, 'little') + message, connection_id, message_id, SIZE))


def numbered(seq, frame_id='x') -> Any:
    return serialised(Image(header=Header(seq=seq, frame_id=frame_id)))
