# SPDX-License-Identifier: BSD-3-Clause
"""Relayed messages that take several datagrams: a message is lost with any of them."""
LARGEST = 1400
"""Size of the longest relayed message that fits a datagram [byte]."""

REMEDY = 'with "reliable: true" and "newest: true" the newest one arrives whole'
"""Advice for a stream of longer messages."""


def datagrams(size: float) -> int:
    """The number of datagrams of a message.

    :param size: [byte]
    """
    return int(-(-size // LARGEST))
