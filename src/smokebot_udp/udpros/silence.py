# SPDX-License-Identifier: BSD-3-Clause
"""When a subscriber asks about a topic that is silent, and when it replaces a connection."""
from typing import Generic, Iterable, List, Protocol, TypeVar

from ..backoff import Backoff
from ..newest import Newest

SILENCE_TIMEOUT = 3.0
"""After this time without a message of a topic, the master and its publishers are asked for it [s]."""

MAX_SILENCE_PERIOD = 30.0
"""Longest time from one such question to the next [s]."""

RENEGOTIATION, MAX_RENEGOTIATION = 120.0, 1200.0
"""After this time of silence a connection is negotiated anew, whatever its publisher says; it doubles up to the
maximum [s]."""

BROKEN, WATCHED = 0.25, 1.0
"""For WATCHED after a change of an address, earlier connections that are silent for BROKEN are replaced [s]."""

MAX_MOVED = 64
"""Nodes of which the newest address is remembered."""


USUAL_FACTOR = 2.5
"""A topic counts as silent after this many times its longest usual pause."""

FADING, MAX_PAUSE = 0.8, 12.0
"""Factor by which the longest usual pause decreases with each shorter one, and longest pause that counts [1, s]."""


class Silence:
    """The questions about one topic: at intervals that double while it stays silent.

    Some topics have a message each few seconds: that is no silence.

    :param now: when the topic is subscribed [s]
    """

    def __init__(self, now: float) -> None:
        self.asked_at = now
        """When it was asked for last [s]."""
        self._pauses = Backoff(SILENCE_TIMEOUT, MAX_SILENCE_PERIOD)
        self._heard, self._usual = -float('inf'), 0.0       # the last message; its usual pause [s]

    def due(self, heard: float, now: float, early: float = 1.0, message: bool = True) -> bool:
        """Whether to ask now.

        :param heard: when the topic was heard last; -inf: never [s]
        :param early: the part of the interval that is enough
        :param message: whether that was a message; else a new connection, which begins no usual pause
        """
        if message:
            self._learn(heard)
        if heard > self.asked_at:
            self._pauses.reset()
        timeout = min(max(SILENCE_TIMEOUT, USUAL_FACTOR * self._usual), MAX_SILENCE_PERIOD)
        return (now - heard >= max(SILENCE_TIMEOUT, early * timeout)
                and now - max(heard, self.asked_at) >= early * max(timeout, self._pauses.interval))

    def _learn(self, heard: float) -> None:
        if heard > self._heard:
            pause = heard - self._heard if self._heard > -float('inf') else 0.0
            self._heard, self._usual = heard, max(pause if pause <= MAX_PAUSE else 0.0, FADING * self._usual)

    def asked(self, now: float) -> None:
        """The question is being asked."""
        self.asked_at = now
        self._pauses.take()

    def unanswered(self) -> None:
        """It was not answered: it is repeated soon."""
        self._pauses.reset()

    def hurry(self) -> None:
        """Something has changed: if the topic is silent, it is asked for at once."""
        self.asked_at, self._usual = -float('inf'), 0.0
        self._pauses.reset()


class Renegotiation:
    """When to negotiate anew with a publisher that says it serves us: the path from it may be broken."""

    def __init__(self) -> None:
        self._silences = Backoff(RENEGOTIATION, MAX_RENEGOTIATION)

    def due(self, idle: float, worked: bool) -> bool:
        """Whether to replace a connection; if so, the next one after twice the time.

        :param idle: how long it has been silent [s]
        :param worked: whether anything was ever received through it
        """
        if worked:
            self._silences.reset()
        if idle < self._silences.interval:
            return False
        self._silences.take()
        return True


class Connection(Protocol):
    """What FormerAddress knows of a connection."""

    @property
    def done(self) -> bool:
        """Whether it has been closed."""

    @property
    def idle(self) -> float:
        """Time since a datagram came by it last [s]."""


Made = TypeVar('Made', bound=Connection)


class FormerAddress(Generic[Made]):
    """Finds the connections that a change of an address breaks: of this machine, or of a publisher's.

    Nothing comes to the former address any more, or from it; but with several addresses, others go on. So each
    connection is watched until it is silent.
    """

    def __init__(self) -> None:
        self._watched: List[Made] = []
        self._until = 0.0

    def __bool__(self) -> bool:
        """Whether connections are watched."""
        return bool(self._watched)

    def lost(self, connections: Iterable[Made], now: float) -> None:
        """The address has changed.

        :param connections: all that were made before, and may be broken
        """
        watched = set(map(id, self._watched))
        self._watched += [connection for connection in connections if id(connection) not in watched]
        self._until = now + WATCHED

    def broken(self, now: float) -> List[Made]:
        """Those to be replaced now, each once."""
        found: List[Made] = []
        going_on: List[Made] = []
        for connection in self._watched:
            if not connection.done:
                (found if connection.idle > BROKEN else going_on).append(connection)
        self._watched = going_on if now < self._until else []
        return found


class NewestAddresses:
    """The address that each node has moved to."""

    def __init__(self) -> None:
        self._addresses: Newest[str, str] = Newest(MAX_MOVED)

    def is_new(self, uri: str, address: str) -> bool:
        """Whether a node that has moved to this address was not known to be there."""
        if self._addresses.get(uri) == address:
            return False
        self._addresses[uri] = address
        return True
