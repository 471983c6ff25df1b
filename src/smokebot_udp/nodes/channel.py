# SPDX-License-Identifier: BSD-3-Clause
"""The channels of a ReliableLink: what both sides agree on, what a channel reports to its owner, and its counts."""
import time
import zlib
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, NamedTuple, Optional

from ..reliable.bounds import USUAL, Bounds
from ..reliable.conversation import Definition
from ..reliable.events import Event, GivenUp, Joined, Left, Received
from ..reliable.peers import Peers, Work
from ..streams.relay.parameters import TO_OPERATOR, TO_ROBOT
from .worker import DeadlineWorker


class ChannelKind(NamedTuple):
    """One kind of messages, in one direction. Both sides have to give the same name, direction, type and md5 sum."""
    name: str
    direction: str
    """TO_ROBOT or TO_OPERATOR"""
    type_name: str
    md5: str
    ordered: bool = True
    """Whether messages are delivered as they were sent; otherwise, as they come."""
    expedited: bool = False
    """Whether copies are sent before a timeout, as many as the loss takes: for calls."""
    bounds: Bounds = USUAL

    def definition(self, direction: str) -> Definition:
        """What the protocol has to know.

        :param direction: in which this side sends
        :raises ValueError: where there is no such direction
        """
        if self.direction not in (TO_ROBOT, TO_OPERATOR):
            raise ValueError('direction is %r, must be %s or %s' % (self.direction, TO_ROBOT, TO_OPERATOR))
        number = zlib.crc32('\0'.join((self.name, self.direction, self.type_name, self.md5)).encode())
        return Definition(number, self.direction == direction, self.ordered, self.expedited, self.bounds)


def ignore(*_: Any) -> None:
    """Do nothing."""


class ChannelListener(NamedTuple):
    """Functions that are called with what happens to a channel, in the link's thread. They have to be short."""
    received: Callable[[str, bytes], None] = ignore
    """f(peer, data), called for each message, once."""
    given_up: Callable[[str, int, str], None] = ignore
    """f(peer, count, reason), called for messages that may not have arrived: age, count, bytes, restart, left."""
    joined: Callable[[str], None] = ignore
    """f(peer), called when a session with a node of the other side begins, also after its restart."""
    left: Callable[[str, str], None] = ignore
    """f(peer, reason), called when it is over: what was in flight in either direction is lost."""
    unknown: Callable[[str], None] = ignore
    """f(peer), called when the node of the other side does not have the channel, and again while something waits."""


@dataclass
class ChannelStats:
    """What a channel did until now."""
    sent: int = 0
    """Messages to send, once for each peer that they were for."""
    received: int = 0
    given_up: Dict[str, int] = field(default_factory=dict)
    """{reason: messages that may not have arrived}"""
    waiting: int = 0
    """Messages that were neither acknowledged nor given up now."""

    @property
    def delivered(self) -> int:
        """Messages that were acknowledged."""
        return self.sent - self.waiting - sum(self.given_up.values())


NO_LISTENER = ChannelListener()


class Channel:
    """A channel of one side; made by ReliableLink.channel.

    :param worker: of the link; its lock is that of `peers`
    """

    def __init__(self, name: str, definition: Definition, listener: ChannelListener, peers: Peers,
                 worker: DeadlineWorker[Work]) -> None:
        self.name, self.closed = name, False
        self._definition, self._listener, self._peers, self._worker = definition, listener, peers, worker
        self._stats = ChannelStats()

    def send(self, data: bytes, peer: Optional[str] = None, first: bool = False) -> int:
        """Send a message; any thread.

        :param peer: None: all
        :param first: only to peers for which it is the first one in their present session: what is latched
        :return: the number of peers that it is for; 0: nobody is there, and it is not kept
        :raises ValueError: where it is too long, or this side does not send on the channel
        """
        if not self._definition.sends:
            raise ValueError('this side only receives %s' % self.name)
        with self._worker.changing():
            count = self._peers.send(self._definition.number, data, peer, time.monotonic(), first)
        self._stats.sent += count
        return count

    def waiting(self, peer: Optional[str] = None) -> int:
        """Messages that were neither acknowledged nor given up.

        :param peer: that they are for; None: all
        """
        with self._worker.lock:
            return self._peers.waiting(self._definition.number, peer)

    def stats(self) -> ChannelStats:
        """What it did until now."""
        self._stats.waiting = self.waiting()
        return self._stats

    def close(self) -> None:
        """End it; what waits is not sent."""
        with self._worker.changing():
            self._peers.remove(self._definition.number)
            self.closed = True

    def take(self, event: Event) -> None:
        """Pass an event on; the link's thread."""
        if isinstance(event, Received):
            self._stats.received += 1
            self._listener.received(event.peer, event.data)
        elif isinstance(event, GivenUp):
            given_up = self._stats.given_up
            given_up[event.reason] = given_up.get(event.reason, 0) + event.number
            self._listener.given_up(event.peer, event.number, event.reason)
        elif isinstance(event, Joined):
            self._listener.joined(event.peer)
        elif isinstance(event, Left):
            self._listener.left(event.peer, event.reason)
        else:
            self._listener.unknown(event.peer)
