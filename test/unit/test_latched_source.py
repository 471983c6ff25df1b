# SPDX-License-Identifier: BSD-3-Clause
"""The sending side of latched reliable relays: what is kept together, and what is not kept."""
from types import SimpleNamespace
from typing import Any, List

from geometry_msgs.msg import TransformStamped
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from smokebot_udp.nodes import reliable_relay
from smokebot_udp.packed import unpack
from smokebot_udp.streams.config import load
from smokebot_udp.streams.relay.contents import MAX_CONTENTS

MAX_BYTES = 100000

STREAM = """
streams:
  state: {type: relay, message_type: %s, robot_topic: /state, operator_topic: /operator/state, reliable: true,
          latch: true, max_bytes: %d}
"""


class Channel:
    """Keeps what it is to send."""

    def __init__(self) -> None:
        self.sent: List[bytes] = []

    def send(self, data: bytes) -> int:
        self.sent.append(data)
        return 1

    def close(self) -> None:
        """It has nothing to end."""


class Sending:
    """A source whose messages go nowhere."""

    def __init__(self, message_class: Any, monkeypatch: Any) -> None:
        self.errors: List[str] = []
        monkeypatch.setattr(reliable_relay, 'logerr', lambda _, problem: self.errors.append(str(problem)))
        monkeypatch.setattr(reliable_relay.rospy, 'is_shutdown', lambda: False)
        settings = load(STREAM % (message_class._type, MAX_BYTES))[0]['state']
        self._class, self._channel = message_class, Channel()
        callbacks: List[Any] = []
        monkeypatch.setattr(reliable_relay.rospy, 'Subscriber', lambda *given, **_: (
            callbacks.append(given[2]), SimpleNamespace(unregister=lambda: None))[1])
        link: Any = SimpleNamespace(channel=lambda *_, **__: self._channel)
        reliable_relay.Source('state', settings, link, '/state').start()
        self._receive, = callbacks

    def __call__(self, message: Any) -> Any:
        """What is sent of a message; None: nothing."""
        del self._channel.sent[:]
        message._connection_header = {'callerid': '/node'}
        self._receive(message)
        return self._class().deserialize(unpack(self._channel.sent[0], MAX_BYTES)) if self._channel.sent else None


def placed(*pairs: Any) -> Any:
    message = TFMessage()
    for parent, child in pairs:
        message.transforms.append(TransformStamped(child_frame_id=child))
        message.transforms[-1].header.frame_id = parent
    return message


def frames(message: Any) -> Any:
    return {one.child_frame_id: one.header.frame_id for one in message.transforms}


def test_a_frame_that_moves_and_comes_back(monkeypatch: Any) -> None:
    send = Sending(TFMessage, monkeypatch)
    for parent in 'table', 'gripper', 'table':
        sent = send(placed((parent, 'cup'), ('base', 'laser')))
        assert frames(sent) == {'cup': parent, 'laser': 'base'} and len(sent.transforms) == 2


def test_what_is_too_long_does_not_keep_out_what_comes_later(monkeypatch: Any) -> None:
    send = Sending(TFMessage, monkeypatch)
    send(placed(('base', 'laser')))
    assert send(placed(('base', 'x' * MAX_BYTES))) is None and 'max_bytes is %d' % MAX_BYTES in send.errors[0]
    assert frames(send(placed(('base', 'camera')))) == {'laser': 'base', 'camera': 'base'}


def test_more_frames_than_fit_do_not_keep_out_those_that_are_known(monkeypatch: Any) -> None:
    send = Sending(TFMessage, monkeypatch)
    for parent in 'base', 'map':
        sent = frames(send(placed(*((parent, str(number)) for number in range(MAX_CONTENTS + 1)))))
        assert set(sent.values()) == {parent} and len(sent) == MAX_CONTENTS
    assert '%d is left out' % MAX_CONTENTS in send.errors[0]


def test_of_other_messages_the_last_one_is_latched(monkeypatch: Any) -> None:
    send = Sending(String, monkeypatch)
    assert [send(String(text)).data for text in 'ab'] == ['a', 'b']
