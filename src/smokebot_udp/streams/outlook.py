# SPDX-License-Identifier: BSD-3-Clause
"""What the encoder of a stream may expect of the link, and how that follows from the operators' reports."""
import collections
import math
import statistics
from typing import Callable, Collection, Deque, Dict, Mapping, NamedTuple

from .air import UNKNOWN, Air, LossBeliefs, merged

COMPARED = 3
"""Estimates of the room of a stream."""


def no_train() -> float:
    """No packet train leaves."""
    return 1.0


def no_tokens() -> float:
    """Nothing passes at once."""
    return 0.0


class Outlook(NamedTuple):
    """What a stream may expect of the link. Immutable: threads may pass it on."""
    air: Air = UNKNOWN
    """What becomes of its datagrams."""
    room: float = math.inf
    """What the stream may use, at most, while the other streams use what they use now: see Rooms [byte/s]."""
    gain: Callable[[], float] = no_train
    """By what factor the message that is made now may be longer, as a packet train leaves: at least 1."""
    tokens: Callable[[], float] = no_tokens
    """What passes at once now, as a token bucket on the path has tokens [byte on the air]."""

    def loss(self, probability: float) -> float:
        """The packet-loss ratio that is not exceeded with a probability below 1."""
        total = 0.0
        for loss in sorted(self.air.losses):
            total += self.air.losses[loss]
            if total >= probability:
                break
        return loss


class Rooms:
    """What each stream may use of the link: the median of the latest estimates, so that a single one that is wrong
    changes nothing, and a link that has changed is followed with the second one."""

    def __init__(self) -> None:
        self._latest: Dict[str, Deque[float]] = {}

    def update(self, rooms: Mapping[str, float]) -> Dict[str, float]:
        """Take the newest estimates; streams without one are forgotten.

        :param rooms: {stream: byte/s}
        :return: {stream: byte/s}
        """
        self._latest = {name: self._latest.get(name) or collections.deque(maxlen=COMPARED) for name in rooms}
        for name, room in rooms.items():
            self._latest[name].append(room)
        return {name: statistics.median_low(latest) for name, latest in self._latest.items()}


class StreamLosses:
    """What the operators' reports say about each stream, from the first `air` of it on."""

    def __init__(self) -> None:
        self._beliefs: Dict[str, Dict[str, LossBeliefs]] = {}   # {stream: {operator: ...}}

    def add(self, operator: str, stream: str, expected: int, received: int, now: float) -> None:
        """As controller.OnArrivals."""
        if stream in self._beliefs:     # the others, such as relays, are never asked for, and would keep each operator
            self._beliefs[stream].setdefault(operator, LossBeliefs()).add(expected, received, now)

    def air(self, stream: str, operators: Collection[str], now: float) -> Air:
        """What to expect of a stream that is sent to these operators now; the others are forgotten.

        :param now: by a steady clock [s]
        """
        known = {name: beliefs for name, beliefs in self._beliefs.get(stream, {}).items() if name in operators}
        self._beliefs[stream] = known
        return merged([beliefs.air(now) for beliefs in known.values()])
