# SPDX-License-Identifier: BSD-3-Clause
"""What carries the streams between robot and operators: the one interface of all transports.

The nodes use a Transport for everything that crosses the link: segments, link reports, the clock, focus requests.
udpros/transport.py and link/transport.py implement it.
"""
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Callable, Collection, Counter, Dict, List, Mapping, Optional, Protocol, Sequence, Tuple

from .paths import PathUse
from .udpros.depacketizer import Arrived, BatchCallback
from .udpros.frame import Frame


def nothing() -> None:
    """What is called where nobody has asked to be."""


def always() -> bool:
    """True: what is wanted as soon as there is a peer, before it is known what the peer offers."""
    return True


BESIDE, COPIES, UNUSED = 'beside', 'commands only', 'not used'
"""What goes by another path than the first one: a part of the streams, copies alone, or probes alone."""


@dataclass(frozen=True)
class PathStats:
    """Another path to a peer than the one by which it gets all that is not shared."""
    address: Tuple[str, int]
    interface: str
    """As of PeerStats."""
    use: str
    """One of BESIDE, COPIES, UNUSED."""
    silence: float
    """Time since it answered last [s]."""
    round_trip: Optional[float]
    """[s]; None: unknown."""


@dataclass(frozen=True)
class PeerStats:
    """One node of the other side."""
    name: str
    address: Tuple[str, int]
    silence: float
    """Time since it was heard last [s]."""
    round_trip: Optional[float]
    """[s]; None: unknown."""
    interface: str = ''
    """The one of this machine by which it is reached; empty: the kernel's routes decide."""
    others: Sequence[PathStats] = ()
    """In order of preference."""
    carried: Mapping[Tuple[str, str], int] = field(default_factory=dict)
    """{(its host, interface): bytes sent there until now, to it and to former ones of its name, IP and UDP headers
    included}"""


@dataclass(frozen=True)
class TransportStats:
    """The state of a transport, for diagnostics."""
    peers: List[PeerStats]
    handshakes: int
    """Completed until now."""
    dropped: Mapping[str, int]
    """{reason: datagrams} until now."""
    problem: Optional[str]
    """In one sentence; None: there is none."""
    remarks: Sequence[str] = ()
    """What this machine lacks, in one sentence each."""


class Publisher(Protocol):
    """Sends the messages of one topic to all peers that want them."""

    tos: int
    """Second byte of the datagrams' IP headers from now on, see traffic.py; within the transport's tos_mask."""

    @property
    def resolved_name(self) -> str:
        """The topic."""

    def publish(self, message: Any) -> None:
        """Number and send one message."""

    def publish_frames(self, *frames: Frame, limits: Mapping[str, int] = MappingProxyType({}),
                       second: Collection[str] = ()) -> int:
        """Number and send all messages of some frames.

        :param limits: {peer: it gets only this number of the first messages}
        :param second: peers that get them by their second path, see Transport.paths
        :return: the first message's sequence number; those of the others follow
        :raises ValueError: if a frame is of another type than the topic
        """

    def publish_to(self, peer: str, frame: Frame) -> None:
        """Send the messages of a frame to one peer, numbered as they are; without effect where it is not connected.

        :raises ValueError: if the frame is of another type than the topic
        """

    def connections(self) -> List[Dict[str, Any]]:
        """Statistics of the peers that it sends to, one dictionary each, with keys as udpros.Publisher.connections."""

    def get_num_connections(self) -> int:
        """The number of peers that it sends to."""

    def why_not(self, peer: str) -> str:
        """Why it does not send to a peer, in words: what the peer does or lacks, as far as this side knows."""

    def unregister(self) -> None:
        """End the topic."""


class Subscriber(Protocol):
    """Receives the messages of one topic."""

    def connections(self) -> List[Dict[str, Any]]:
        """Statistics of the peers that it receives from, with keys as udpros.Subscriber.connections."""

    def unregister(self) -> None:
        """End the subscription."""


class Transport(Protocol):
    """Makes publishers and subscribers of topics on the wire, whose names are absolute."""

    on_moved: Callable[[], None]
    """Called where the first path of a peer has become another one, or quiet; any thread, and it must not block."""

    @property
    def name(self) -> str:
        """Under which the other side knows this node: the callerid of its messages, and the peer in its statistics."""

    @property
    def max_datagram_size(self) -> int:
        """The longest datagram of a topic, its header of 8 bytes included [byte]."""

    @property
    def room(self) -> int:
        """The longest datagram of a topic that passes to all peers now, as far as is known [byte]."""

    def limit(self, room: int) -> None:
        """Set `room`: longer messages are sent in several datagrams from now on. Any thread."""

    @property
    def overhead(self) -> int:
        """What the transport adds to each datagram, besides the headers of IP and UDP [byte]."""

    @property
    def tos_mask(self) -> int:
        """The bits of the second byte of IP headers that are set where publishers ask for it, see traffic.mask."""

    @property
    def own_masters(self) -> bool:
        """Whether each side has a ROS master of its own: then the other side's parameters cannot be reached."""

    def publisher(self, topic: str, message_class: Any, *, queue_size: int = 10, subscriber_listener: Any = None,
                  carries: str = '', whole: bool = False, tos: int = 0, copied: bool = False) -> Publisher:
        """Publish a topic.

        :param queue_size: of messages that wait for one peer, where the transport has a queue
        :param subscriber_listener: as rospy.Publisher's: its peer_subscribe is called for each new peer
        :param carries: type and md5 sum of the messages within the messages, as 'tf2_msgs/TFMessage 94810ed...';
            empty: the messages carry none
        :param whole: whether messages are sent in one datagram however long they are: to see whether that passes
        :param tos: second byte of the datagrams' IP headers, of which tos_mask is set
        :param copied: whether copies go by a second path, where there is one and the messages have a header: of what
            is short, seldom, and has to arrive at once
        """

    def subscriber(self, topic: str, message_class: Any, callback: Optional[Callable[[Any], None]] = None, *,
                   queue_size: Optional[int] = None, batch_callback: Optional[BatchCallback] = None,
                   arrived: Optional[Arrived] = None, wanted: Callable[[], bool] = always,
                   carries: str = '') -> Subscriber:
        """Subscribe a topic. The callbacks are called in a thread of the transport, and have to be short.

        A message's `_connection_header` is one object for each connection of a peer; its 'callerid' is the peer's name.

        :param callback: f(message)
        :param queue_size: of messages that arrived together only this many, the newest, are delivered; None: all
        :param batch_callback: f(records, mask), called for messages that arrived together, as of udpros.Subscriber
        :param arrived: called for new messages, see udpros.depacketizer.Arrived
        :param wanted: f() -> bool, called when a peer offers the topic, and again until it is True: nothing is received
            before, unless `wanted` is `always`
        :param carries: as of `publisher`
        """

    def dropped(self) -> Counter[str]:
        """{reason: datagrams} that the transport itself dropped."""

    def problem(self) -> Optional[str]:
        """Why nothing is received from the other side, in one sentence; None: there is no problem."""

    def paths(self, now: float) -> Mapping[str, Sequence[PathUse]]:
        """{peer: its first path, and a second one if it has one now}, of peers that may move from one to another; any
        thread."""

    def stats(self, now: float) -> Optional[TransportStats]:
        """Its state by time.monotonic(); None: all of it shows in the stats of publishers and subscribers."""

    def close(self) -> None:
        """End the transport, after all of its publishers and subscribers."""
