# SPDX-License-Identifier: BSD-3-Clause
"""What bounds a channel: how much waits in it for one peer, and for how long."""
from typing import NamedTuple


class Bounds(NamedTuple):
    """Of the messages that were not acknowledged yet; beyond them the oldest are given up."""
    messages: int = 1000
    bytes: int = 1 << 20
    """Of all messages together, and so of the longest one [byte]."""
    age: float = 10.0
    """Of a message, or of one of many segments since one of them was acknowledged; beyond the time that it takes at
    pace.MIN_RATE it is given up all the same [s]."""
    keeps_last: bool = False
    """Whether the newest message is not given up by its age: a state, which is not old before there is another one."""
    one_session: bool = False
    """Whether also what was not sent yet is given up when the session with the peer ends."""


USUAL = Bounds()
