# SPDX-License-Identifier: BSD-3-Clause
"""One copy of a command as it crosses the link: the fields of msg/Command, in their units, without its header."""
from typing import Any, NamedTuple

MAX_COMMAND_SIZE = 1024
"""A longer message is no command: a copy has to fit into one datagram of any link [byte]."""

MICROSECONDS = 1e6
"""Microseconds in a second. Times on the wire are in microseconds."""


class Copy(NamedTuple):
    """A copy of a command; `Command(**copy._asdict())` is its message."""
    session: int
    """Session of the operator's node."""
    robot: int
    """Session of the robot's node by whose clock `made` is."""
    number: int
    """Number of the command, the same in all its copies. Serial number arithmetic (RFC 1982): 2**32 - 1 precedes 0."""
    made: int
    """When the operator's node received the command, by the robot's steady clock [us]."""
    uncertainty: int
    """Maximum error of `made` [us]."""
    releases: int
    """Number of releases of the emergency stop that the operator's node knew of."""
    checksum: int
    """Checksum of `data`, see checksum.typed_checksum."""
    data: bytes
    """The serialised message."""

    @classmethod
    def of(cls, message: Any) -> 'Copy':
        """The copy that a msg/Command carries."""
        return cls(*(getattr(message, field) for field in cls._fields))
