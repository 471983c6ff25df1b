# SPDX-License-Identifier: BSD-3-Clause
"""A peer's new address, until it has proved that it receives there.

* Only an authentic packet, newer than all before, proposes an address. A copy of it may come from elsewhere: so what is
  sent there before the proof is never more than what came from there (RFC 9000, 9.3).
* The proof is an authentic packet from that address with the 8 random bytes of the challenge.
* A peer that has left the address again proves nothing: packets on their way change the order in which both are heard,
  but not for longer than LEFT_AFTER.
"""
from .control import CHALLENGE_SIZE
from .cookie import Place

AGAIN = 0.05
"""Between two challenges to one address [s]."""

LEFT_AFTER = 0.2
"""[s]"""


class PathCheck:
    """The check of one address.

    :param challenge: CHALLENGE_SIZE random bytes
    """

    def __init__(self, place: Place, challenge: bytes) -> None:
        if len(challenge) != CHALLENGE_SIZE:
            raise ValueError('a challenge has %d bytes' % CHALLENGE_SIZE)
        self.place, self.challenge = place, challenge
        self._credit = 0
        self._next = self._heard = 0.0

    def came(self, size: int, now: float) -> None:
        """An authentic packet came from there [byte, s]."""
        self._credit += size
        self._heard = now

    def has_left(self, now: float) -> bool:
        """Whether a peer that is heard from elsewhere now has left the address [s]."""
        return now - self._heard >= LEFT_AFTER

    def may_send(self, size: int, now: float) -> bool:
        """Whether to send a challenge of this size now; the caller does it then [byte, s]."""
        if size > self._credit or now < self._next:
            return False
        self._credit -= size
        self._next = now + AGAIN
        return True

    def is_proof(self, place: Place, response: bytes) -> bool:
        """Whether a response proves the address."""
        return place == self.place and response == self.challenge
