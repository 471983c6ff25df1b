# SPDX-License-Identifier: BSD-3-Clause
"""What bounds a channel: how much waits in it for one peer, and for how long."""
from typing import NamedTuple


class Bounds(NamedTuple):
    """Bounds of the messages that were not acknowledged yet. Beyond them the oldest are given up."""
    messages: int = 1000
    bytes: int = 1 << 20
    """Size of all messages together, at most, and so of the longest one [byte]."""
    age: float = 10.0
    """Age of a message, or time since one of its segments was acknowledged, at most. Progress counts only for as long
    as the message takes at pace.MIN_RATE [s]."""
    keeps_last: bool = False
    """Whether the newest message is not given up by its age: a state, which is not old before there is another one."""
    one_session: bool = False
    """Whether also what was not sent yet is given up when the session with the peer ends."""


USUAL = Bounds()
