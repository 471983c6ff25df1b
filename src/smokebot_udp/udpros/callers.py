# SPDX-License-Identifier: BSD-3-Clause
"""Who the callers of a publisher are, by the word of the master and of the callers themselves."""
import threading
import time
import urllib.parse
from typing import List, NamedTuple, Optional

import rosgraph

from ..budget import Budget
from ..newest import Newest
from . import rpc
from .bus_info import BusEntry, udpros_entries
from .endpoints import addresses_of, is_loopback
from .negotiation import Refused
from .shared_answers import SharedAnswers

TIMEOUT = 1.0
"""How long the master or a caller may take to answer: the caller waits for its own answer meanwhile [s]."""

MAX_AGE = 1.0
"""How long an answer is used after it came: a node requests its topics one after the other [s]."""

QUESTION_PERIOD = 0.5
"""A caller is asked at most once in this time [s]."""

MAX_STRANGERS = 100
"""How many names that the master did not confirm before it is asked for in a second."""

MAX_KNOWN = 256
"""Names that are remembered as confirmed."""


class Bus(NamedTuple):
    """What a node says of its UDPROS connections."""
    asked: float
    """When it was asked, by time.monotonic() [s]."""
    entries: List[BusEntry]


class Callers:
    """Asks the master and the callers; any thread."""

    def __init__(self) -> None:
        self._uris: SharedAnswers[str, Optional[str]] = SharedAnswers(_look_up, 0.0)
        self._buses: SharedAnswers[str, Bus] = SharedAnswers(_bus_of, QUESTION_PERIOD)
        self._lock = threading.Lock()
        self._known: Newest[str, None] = Newest(MAX_KNOWN)
        self._strangers = Budget(MAX_STRANGERS, 1 / MAX_STRANGERS)

    def uri(self, name: str) -> Optional[str]:
        """The URI of a node; None: the master does not know it.

        :raises Refused: if it is asked for too many names
        :raises Unreachable: if the master does not answer
        """
        with self._lock:
            if name not in self._known and not self._strangers.take(time.monotonic()):
                raise Refused('too many requests of unknown nodes, try again later', 'too many requests')
        uri = self._uris.ask(name, MAX_AGE)
        with self._lock:
            if uri is not None:
                self._known[name] = None
            else:
                self._known.pop(name, None)
        return uri

    def bus(self, uri: str, max_age: float = 0.0) -> Optional[Bus]:
        """The UDPROS connections of a node, by its own word; none if it has ended, None: it does not answer.

        :param max_age: how old its word may be [s]
        """
        try:
            return self._buses.ask(uri, max_age)
        except rpc.Gone:
            return Bus(time.monotonic(), [])
        except (rpc.Unreachable, Refused):
            return None


def _look_up(name: str) -> Optional[str]:
    try:
        uri = rpc.call(rosgraph.get_master_uri(), 'lookupNode', name, timeout=TIMEOUT)
    except Refused:
        return None
    return uri if isinstance(uri, str) else None


def _bus_of(uri: str) -> Bus:
    asked = time.monotonic()
    return Bus(asked, udpros_entries(rpc.call(uri, 'getBusInfo', timeout=TIMEOUT)))


def is_home(address: int, uri: str) -> bool:
    """Whether an address, as a number, is one of the host in a URI; True if that host is unknown here.

    All of 127.0.0.0/8 are the same machine.
    """
    try:
        home = addresses_of(urllib.parse.urlparse(uri).hostname)
    except ValueError:
        return True
    return not home or address in home or (is_loopback(address) and any(map(is_loopback, home)))
