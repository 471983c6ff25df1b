# SPDX-License-Identifier: BSD-3-Clause
"""What a node's getBusInfo says of its UDPROS connections."""
import re
from typing import Any, FrozenSet, List, NamedTuple, Optional, Sequence

from .negotiation import PROTOCOL

INBOUND, OUTBOUND = 'i', 'o'

TEXT = re.compile(r'UDPROS connection on port (\d{1,5}) to \[(?:([^\s\]]{1,253}):(\d{1,5}) on socket )?')
"""The last element of an entry, by rospy's and roscpp's nodes."""


class BusEntry(NamedTuple):
    """One connection."""
    peer: str
    """Name of the subscriber, or URI of the publisher."""
    direction: str
    """INBOUND or OUTBOUND."""
    topic: str
    local_port: Optional[int]
    """None: the node does not say; likewise below."""
    remote_host: Optional[str]
    """Name or address."""
    remote_port: Optional[int]


def udpros_entries(bus: Any) -> List[BusEntry]:
    """The UDPROS connections in the value of a getBusInfo call; what is malformed is left out."""
    found = []
    for entry in bus if isinstance(bus, list) else ():
        if (isinstance(entry, list) and len(entry) >= 5 and entry[3] == PROTOCOL
                and all(isinstance(text, str) for text in entry[1:5])):
            text = TEXT.match(entry[6]) if len(entry) > 6 and isinstance(entry[6], str) else None
            local, host, port = text.groups() if text else (None, None, None)
            found.append(BusEntry(entry[1], entry[2], entry[4], _number(local), host, _number(port)))
    return found


def receiving_ports(entries: Optional[Sequence[BusEntry]], topic: str) -> Optional[FrozenSet[int]]:
    """The UDP ports on which a node receives a topic; None: it does not say.

    :param entries: of its getBusInfo; None: it does not answer
    """
    ports = [entry.local_port for entry in entries or () if (entry.direction, entry.topic) == (INBOUND, topic)]
    return None if entries is None or None in ports else frozenset(port for port in ports if port is not None)


def _number(text: Optional[str]) -> Optional[int]:
    return None if text is None else int(text)
