# SPDX-License-Identifier: BSD-3-Clause
"""What streams, connections and the link report of themselves: the one source of diagnostics and status messages.

Counters only grow, or restart from 0.
"""
import math
import re
from dataclasses import dataclass, field
from typing import Dict, NamedTuple, Optional, Sequence, Tuple

from ..image_error import ImageError

PAUSED = 'the link is too slow for it and the other streams'
"""Problem of a stream that is not sent because of this."""


NO_REPORTS, OVER_ONE = 'no reports of %s for %.1f s', '%s, over %s only'
"""The state of a link whose operator does not report, and of one that lost one of two paths."""

PROBLEM = re.compile(r'no reports of .*|.*, over \S+ only')
"""Both, as they are relayed."""


@dataclass(frozen=True)
class ConnectionStats:
    """One UDPROS connection. None: this side does not know the value.

    The fields but `name` are the keys of an item of `udpros.Publisher.connections()` and
    `udpros.Subscriber.connections()`.
    """
    peer: str
    """Name of the node at the other end."""
    address: Tuple[str, int]
    """(host, port) of the other end."""
    datagrams: int
    bytes: int
    connection_id: Optional[int] = None
    max_datagram_size: Optional[int] = None
    """[byte of UDP payload]"""
    failures: Dict[str, int] = field(default_factory=dict)
    """{name of the error: datagrams that could not be sent}"""
    received: Optional[int] = None
    """Messages received; None without sequence numbers."""
    lost: Optional[int] = None
    """Messages not received yet although later ones were; the one count that may fall, as reordered messages arrive."""
    idle: Optional[float] = None
    """Time since the last datagram [s]."""
    dropped: Dict[str, int] = field(default_factory=dict)
    """{reason: datagrams that were discarded}"""
    receive_buffer: Optional[int] = None
    """Size of the socket's receive buffer [byte]."""
    kernel_drops: Optional[int] = None
    """Datagrams that found the receive buffer full."""
    name: str = ''
    """Name of the part of the stream that the connection carries, as in link reports; empty: the name of the stream."""


class Shown(NamedTuple):
    """A message that was published. None: unknown."""
    age: Optional[float]
    """The difference between this machine's clock and the message's stamp [s]."""
    completeness: Optional[float]
    """Share of the message that arrived, 0..1."""
    error: Optional[ImageError] = None
    """Error of the image, if it was coded with loss."""


@dataclass(frozen=True)
class StreamStats:
    """One stream, on either side."""
    messages_in: int
    """Messages received: from the source, or over the link."""
    messages_out: int
    """Messages sent over the link, or published."""
    enabled: bool = True
    """Whether the stream is meant to be sent."""
    rate: float = 0.0
    """Maximum rate of the stream [Hz]; 0: unknown."""
    steady: bool = True
    """False for a stream that may be silent and old without a fault: a latched topic, a carousel."""
    dropped: Dict[str, int] = field(default_factory=dict)
    """{reason: messages, segments or datagrams that were discarded}"""
    shown: Sequence[Shown] = ()
    """Messages published since the last call."""
    connections: Sequence[ConnectionStats] = ()
    activity: str = ''
    """What it does now, in words; empty: that shows in its rates."""
    to_robot: bool = False
    """Whether operators send it and the robot receives it; there may be no operator."""
    problem: Optional[str] = None
    """Another problem, in words, that deserves a warning now."""
    busy: float = 0.0
    """Time that its coding has taken so far [s]; messages are coded one after the other."""


class PathRates(NamedTuple):
    """One of two paths to an operator. NaN: unknown."""
    name: str
    """The robot's interface, or the operator's host."""
    sent: float
    """[byte/s]"""
    capacity: float
    """[byte/s]"""
    loss: float
    """Packet-loss ratio, 0..1."""
    queue_delay: float
    """[s]"""


@dataclass(frozen=True)
class LinkStats:
    """The link as the robot estimates it from the reports of its operators. Rates include IP and UDP headers.

    Of several operators it is the link that the streams are planned for. NaN: unknown.
    """
    adaptive: bool
    """Whether the rate follows the reports."""
    rate: Optional[float]
    """Maximum rate of all streams together [byte/s]; None: unlimited."""
    sent: float
    """[byte/s]"""
    wanted: float
    """What the streams would send over an unlimited link [byte/s]."""
    capacity: float = math.nan
    """[byte/s]"""
    loss: float = math.nan
    """Packet-loss ratio, 0..1."""
    queue_delay: float = math.nan
    """[s]"""
    round_trip: float = math.nan
    """[s]"""
    longest: Optional[int] = None
    """Longer datagrams do not pass to an operator; None: all pass [byte of UDP payload]."""
    operator: Optional[str] = None
    """The operator that counts; None: none has reported yet."""
    silence: float = math.nan
    """Time since its last report [s]."""
    timeout: bool = False
    """Whether reports are missing, so that the rate falls where it is used."""
    only: str = ''
    """The path by which it is reached, where there were two: an interface, or a host; empty: by all that there were."""
    paths: Sequence[PathRates] = ()
    """Those that are in use, where there were two."""
    slower: Dict[str, float] = field(default_factory=dict)
    """{operator with a slower link: its part of the rate [byte/s]}; it gets a part of the datagrams."""
    refused_reports: Dict[str, int] = field(default_factory=dict)
    """{reason: reports of operators that were refused, wholly or in part}"""

    @property
    def state(self) -> str:
        """What the rate depends on now, in words, and by which path alone operators are reached."""
        return OVER_ONE % (self._dependence, self.only) if self.only else self._dependence

    @property
    def _dependence(self) -> str:
        if not self.adaptive:
            return 'fixed'
        if self.operator is None:
            return 'no operator has reported yet'
        if self.timeout:
            return NO_REPORTS % (self.operator, self.silence)
        return 'as %s reports%s' % (self.operator, ', less for ' * bool(self.slower) + ', '.join(sorted(self.slower)))
