# SPDX-License-Identifier: BSD-3-Clause
"""Which requests for a UDPROS connection a publisher grants. Requests are not authenticated, so their cost is bounded.

A caller is taken for a node that the master knows, on that node's host. One that is connected already, to another port,
is asked itself which of its ports it uses: only it knows whether it has been restarted, or somebody uses its name.
"""
import ipaddress
from typing import Collection, NamedTuple, Optional, Sequence, Tuple

from .negotiation import Refused

MAX_PER_HOST = 8
"""Connections of one topic to one host: some operators and tools on one machine."""

MAX_CONNECTIONS = 256
"""Connections of a node: 14 topics to 18 hosts. Each costs one file descriptor, and its part of each publication."""

MAX_PER_CALLER = 3
"""Connections of one topic to one node that cannot be asked: one that it has, and those that may have replaced it."""

MIN_REQUESTED_SIZE = 548
"""A subscriber that asks for shorter datagrams is refused, unless the publisher's own are as short: each message would
be cut into many. Every host accepts IP datagrams of 576 bytes (RFC 791) [byte of UDP payload]."""

SETTLED = 1.0
"""Time after which a node lists a connection that it was granted; a busy one or a bad link takes that long [s]."""

UNPROVEN = 60.0
"""Time after which the newest connection of a node counts, if the node cannot be asked [s]."""


class Claim(NamedTuple):
    """A connection that a publisher holds for one caller."""
    port: int
    """UDP port of the subscriber."""
    at_home: bool
    """Whether its address is one of the caller's host."""
    age: float
    """When the caller was asked for it; negative: it was made later [s]."""


def check_address(address: str) -> None:
    """Check the numeric address to which a subscriber wants datagrams sent.

    :raises Refused: if it is not that of one host
    """
    parsed = ipaddress.IPv4Address(address)
    if parsed.is_multicast or parsed.is_unspecified or parsed.is_reserved:      # reserved: the limited broadcast, too
        raise Refused('%s is not the address of a host' % address, 'address')


def check_size(requested: int, ours: int) -> None:
    """Check the longest datagram that a subscriber accepts [byte of UDP payload].

    :raises Refused: if it multiplies the work
    """
    least = min(ours, MIN_REQUESTED_SIZE)
    if requested < least:
        raise Refused('max_datagram_size is %d, this publisher sends at least %d' % (requested, least),
                      'datagram size')


def check_room(place: Tuple[str, str], others: Sequence[Tuple[str, str]]) -> None:
    """Check whether another connection is acceptable.

    :param place: its topic and address
    :param others: those of all connections of the node
    :raises Refused: if there are too many
    """
    if others.count(place) >= MAX_PER_HOST:
        raise Refused('there are %d connections to %s already' % (MAX_PER_HOST, place[1]), 'connections of a host')
    if len(others) >= MAX_CONNECTIONS:
        raise Refused('there are %d connections already' % len(others), 'connections')


def is_living(claim: Claim, ports: Optional[Collection[int]]) -> bool:
    """Whether the subscriber has a connection, by its own word.

    :param ports: that it uses for the topic; None: it does not answer
    """
    return ports is not None and claim.port in ports and claim.at_home


def has_ended(claim: Claim, ports: Optional[Collection[int]]) -> bool:
    """Whether the subscriber no longer has a connection, or never had it, by its own word."""
    return ports is not None and claim.age >= SETTLED and not is_living(claim, ports)
