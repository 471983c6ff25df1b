# SPDX-License-Identifier: BSD-3-Clause
"""The two paths by which a peer may get what is sent, as transports, the link controller and the outbox know them."""
import math
from types import MappingProxyType
from typing import Collection, Hashable, Mapping, NamedTuple

NO_LIMITS: Mapping[str, int] = MappingProxyType({})


class PathPolicy(NamedTuple):
    """How a path may be used."""
    max_rate: float = math.inf
    """What all streams may take of it [byte/s]."""
    weight: float = 1.0
    """The part of its capacity that streams take, 0..1: others may need the rest."""
    metered: bool = False
    """Whether its bytes cost: beside another path it carries only what that one cannot carry of the cheapest images."""

    def limited(self, rate: float) -> float:
        """What streams may take of what the path carries [byte/s]."""
        return min(self.weight * rate, self.max_rate)


class PathUse(NamedTuple):
    """A path by which a peer gets what is sent."""
    key: Hashable
    """Equal for the same path."""
    silence: float = 0.0
    """Since the peer was heard over it, as far as it has to show that it is alive [s]."""
    host: str = ''
    """Address of the peer."""
    policy: PathPolicy = PathPolicy()
    is_quiet: bool = False
    """Whether the peer is heard over the second path only: nothing is to be sent by this one, which is the first."""
    interface: str = ''
    """By which interface of this machine it goes; empty: unknown."""

    @property
    def name(self) -> str:
        """As people know it."""
        return self.interface or self.host


class Route(NamedTuple):
    """Who gets what of some datagrams that leave together, and by which path."""
    limits: Mapping[str, int] = NO_LIMITS
    """{peer: it gets only this number of the first datagrams}; all others get all."""
    second: Collection[str] = ()
    """The peers that get them by their second path."""
    withheld: float = 0.0
    """What could have left by other paths meanwhile, and does not, as it would arrive later [byte]."""


STRAIGHT = Route()
"""All get all by their first path."""
