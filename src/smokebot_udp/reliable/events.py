# SPDX-License-Identifier: BSD-3-Clause
"""What happens to the channels of a node, in the order in which it happened."""
from typing import NamedTuple, Union


class Received(NamedTuple):
    """A message came."""
    peer: str
    channel: int
    data: bytes


class GivenUp(NamedTuple):
    """Messages to a peer may not have arrived, and are not sent any more."""
    peer: str
    channel: int
    number: int
    reason: str


class Joined(NamedTuple):
    """A session with a node of the other side began."""
    peer: str
    channel: int


class Left(NamedTuple):
    """That session is over: what was in flight in either direction is lost."""
    peer: str
    channel: int
    reason: str


class Unknown(NamedTuple):
    """The peer does not have a channel."""
    peer: str
    channel: int


Event = Union[Received, GivenUp, Joined, Left, Unknown]
