# SPDX-License-Identifier: BSD-3-Clause
"""Another address of a peer, which has to prove that it receives there.

* Only an authentic packet, newer than all before and no probe, proposes an address. A copy of it may come from
  elsewhere: so what is sent there before the proof is never more than what came from there (RFC 9000, 9.3).
* The proof is an authentic packet from that address with the 8 random bytes of the challenge. It holds for PROVED_FOR,
  so that a peer which probes several paths is followed at once.
* A peer that has left the address again is not followed: packets on their way change the order in which both are heard,
  but not for longer than LEFT_AFTER.
"""
import math

from .control import CHALLENGE_SIZE
from .place import Place

AGAIN = 0.05
"""Between two challenges to one address [s]."""

LEFT_AFTER = 0.2
"""[s]"""

PROVED_FOR, RENEW_AFTER = 10.0, 2.0
"""How long a proof holds, and after what time a probe from there is a reason to ask for another one [s]."""


MAX_CREDIT = 1 << 16
"""Many challenges [byte]."""


class PathCheck:
    """The check of one address.

    :param challenge: CHALLENGE_SIZE random bytes
    """

    def __init__(self, place: Place, challenge: bytes) -> None:
        if len(challenge) != CHALLENGE_SIZE:
            raise ValueError('a challenge has %d bytes' % CHALLENGE_SIZE)
        self.place, self.challenge = place, challenge
        self.proved = -math.inf
        """When it proved itself [s]."""
        self.left = -math.inf
        """When the peer chose another one [s]."""
        self.proposed = False
        """Whether the peer wants to be reached there."""
        self.probed = -math.inf
        """When a probe came from there [s]."""
        self._credit, self._turn = 0, False
        self._next = self._heard = 0.0

    def came(self, size: int, now: float, proposes: bool = True) -> None:
        """An authentic packet came from there.

        :param size: [byte]
        :param now: [s]
        :param proposes: whether it proposes the address; otherwise it is a probe
        """
        self._credit = min(self._credit, MAX_CREDIT) + size
        if proposes:
            self._heard, self.proposed = now, True
        else:
            self.probed = now

    def has_left(self, now: float) -> bool:
        """Whether a peer that is heard from elsewhere now has left the address [s]."""
        return now - self._heard >= LEFT_AFTER

    def may_send(self, size: int, now: float) -> bool:
        """Whether to send a challenge of this size now; the caller does it then [byte, s]."""
        if now < self._next or not self.may_answer(size, now):
            return False
        self._next = now + AGAIN
        return True

    def may_answer(self, size: int, now: float) -> bool:
        """Whether to send an answer of this size now; the caller does it then [byte, s]."""
        if size > self._credit and not self.holds(now):
            return False
        self._credit = max(0, self._credit - size)
        return True

    def wants_proof(self, now: float) -> bool:
        """Whether to challenge who sends a probe [s]: each second one is answered, in case that no proof comes."""
        self._turn = not self._turn
        return self._turn and now - self.proved >= RENEW_AFTER

    def is_proof(self, place: Place, response: bytes) -> bool:
        """Whether a response proves the address."""
        return place == self.place and response == self.challenge

    def holds(self, now: float) -> bool:
        """Whether it has proved itself not long ago [s]."""
        return now - self.proved < PROVED_FOR
