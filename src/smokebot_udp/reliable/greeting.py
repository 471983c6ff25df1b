# SPDX-License-Identifier: BSD-3-Clause
"""How two nodes agree on sessions, so that nothing of an earlier life of either is taken for something of now.

Each side has a random session number for each peer. It takes another one of a peer only from a greeting that answers a
random number of its own: a greeting that was delayed, repeated or forged cannot, and so cannot end a running session.

    A: session a, number x        ->
                                  <-   B: session b, peer a, echo x, number y
    A: session a, peer b, echo y  ->

Each side repeats its greeting until it is answered; a session beside a running one is asked until one of the two
answers. Sessions that were replaced are not taken again.
"""
import collections
import math
from typing import Callable, Deque, Optional

from ..backoff import Backoff
from ..budget import Budget
from .segment import Kind, Segment

MIN_INTERVAL, MAX_INTERVAL = 0.1, 0.2
"""Between repeated greetings; doubled each time [s]."""

ANSWERS, ANSWER_PERIOD = 10, 0.1
"""Greetings are answered so often at once, and then once in this time [1, s]."""

MAX_TRIES, LONG_INTERVAL = 10, 2.0
"""A session that appears beside a running one is asked so often at these intervals, then at this one [1, s]."""

MAX_RETIRED = 64
"""Replaced sessions that are remembered."""


class Greeting:
    """Agrees on sessions with one peer. Times are by a steady clock [s].

    :param random: f() -> a random number of 32 bits other than 0
    """

    def __init__(self, random: Callable[[], int], now: float) -> None:
        self._random = random
        self.local = random()
        """This side's session."""
        self.remote = 0
        """The peer's session; 0: not agreed."""
        self.round_trip: Optional[float] = None
        """Round trip of the greeting that was answered last; None: unknown, or it was sent more than once [s]."""
        self._challenge = random()
        self._candidate = 0     # a session that has to answer the challenge
        self._echo: Optional[int] = None    # of a greeting that has to be answered, to the session of:
        self._answered = 0
        self._retired: Deque[int] = collections.deque(maxlen=MAX_RETIRED)
        self._budget = Budget(ANSWERS, ANSWER_PERIOD)
        self._begin(now)

    def _begin(self, now: float) -> None:
        """Ask from now on."""
        self._tries, self._due, self._asked = 0, now, now
        self._pauses = Backoff(MIN_INTERVAL, MAX_INTERVAL)

    def restart(self, now: float) -> None:
        """The peer has just been connected: greet it at once, if that is of use."""
        if not self.remote:
            self._begin(now)

    def take(self, segment: Segment, now: float) -> bool:
        """Take a greeting; whether the peer has another session now.

        :raises ValueError: where it is refused, with the reason
        """
        if not segment.session:
            raise ValueError('no session')
        if segment.session in self._retired:
            raise ValueError('old session')
        answers = segment.peer == self.local and segment.echo == self._challenge
        changed = answers and segment.session != self.remote
        if changed:
            self._adopt(segment.session, now)
        elif answers and self._tries > MAX_TRIES:   # by now, answers to earlier questions have come
            self._candidate = 0
        if segment.number or segment.session != self.remote:
            self.stranger(segment.session, segment.number, now)
        return changed

    def stranger(self, session: int, number: int, now: float) -> None:
        """A session has to be answered, and asked if it is not the peer's.

        :param number: of its greeting; 0: it sent something else
        """
        if not self._budget.take(now):
            return
        self._answered, self._echo = session, number
        if session not in (self.remote, self._candidate) and session not in self._retired:
            self._candidate = session
            self._begin(now)

    def _adopt(self, session: int, now: float) -> None:
        if self.remote:
            self._retired.append(self.remote)
        self.round_trip = now - self._asked if self._tries == 1 else None
        self.remote, self._candidate = session, 0
        self._challenge = self._random()

    @property
    def _asking(self) -> bool:
        """Whether the peer has to answer the challenge."""
        return not self.remote or bool(self._candidate)

    def poll(self, now: float) -> Optional[Segment]:
        """The greeting to send now; None: there is none."""
        if self._echo is not None:
            echo, peer, self._echo = self._echo, self._answered, None
            return self._greeting(peer, echo, now)
        if not self._asking or now < self._due:
            return None
        return self._greeting(self._candidate, 0, now)

    def _greeting(self, peer: int, echo: int, now: float) -> Segment:
        asks = not self.remote or (peer != 0 and peer == self._candidate)
        if asks:
            self._ask(now)
        return Segment(Kind.GREETING, number=self._challenge if asks else 0, echo=echo, session=self.local, peer=peer)

    def _ask(self, now: float) -> None:
        self._tries += 1
        self._asked = now
        self._due = now + (LONG_INTERVAL if self.remote and self._tries > MAX_TRIES else self._pauses.take())

    def deadline(self) -> float:
        """When `poll` has a greeting next [s]; infinite: never."""
        if self._echo is not None:
            return -math.inf
        return self._due if self._asking else math.inf
