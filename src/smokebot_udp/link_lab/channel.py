# SPDX-License-Identifier: BSD-3-Clause
"""One direction of an emulated link, packet by packet: seeded, without I/O; time is an argument.

A packet first waits for transmission (a rate, and a drop-tail queue), then it may be lost (a two-state Markov chain:
E. N. Gilbert, "Capacity of a Burst-Noise Channel", 1960), and then it propagates (delay, jitter, reordering,
duplication). Loss comes after the rate because lost packets take air time, too.
"""
import collections
import math
import random
from dataclasses import dataclass, fields
from typing import Counter, Optional, Tuple


@dataclass(frozen=True)
class LinkConditions:
    """The conditions in one direction of a link.

    :raises ValueError: naming the field that is invalid and its value
    """
    loss: float = 0.0
    """Packet-loss ratio, 0..1."""
    burst: float = 0.0
    """Mean length of a run of lost packets, at least 1 / (1 - loss); 0: packets are lost independently."""
    delay: float = 0.0
    """One-way propagation delay [s]."""
    jitter: float = 0.0
    """Maximum deviation of the delay to either side; packets stay in order [s]."""
    rate: float = 0.0
    """Transmission rate [bit/s]; 0: unlimited."""
    queue: float = 0.1
    """Length of the queue before the transmission, as its transmission time; a full queue drops new packets [s]."""
    reorder: float = 0.0
    """Ratio of packets that skip the delay and overtake others, 0..1."""
    duplicate: float = 0.0
    """Ratio of packets that are delivered twice, 0..1."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value < 0:
                raise ValueError('%s is %r, must be a number from 0' % (field.name, value))
        for name in ('loss', 'reorder', 'duplicate'):
            if getattr(self, name) > 1:
                raise ValueError('%s is %g, must be from 0 to 1' % (name, getattr(self, name)))
        if self.burst and self.loss < 1 and self.burst < 1 / (1 - self.loss):
            raise ValueError('burst is %g, must be at least %g with a loss of %g' % (
                self.burst, 1 / (1 - self.loss), self.loss))

    @property
    def chain(self) -> Tuple[float, float]:
        """The Markov chain: (P(lost | the last one was not), P(lost | the last one was)); equal without bursts."""
        if not self.burst or self.loss in (0, 1):
            return self.loss, self.loss
        ends = 1 / self.burst
        return self.loss * ends / (1 - self.loss), 1 - ends


@dataclass
class Counts:
    """What became of the packets of one direction."""
    offered: int = 0
    lost: int = 0
    """During transmission."""
    dropped: int = 0
    """By the full queue."""
    delivered: int = 0
    """Including duplicates."""
    carried: int = 0
    """Transmitted, including lost packets [byte]."""


@dataclass
class Air:
    """What transmits packets one after the other, first come, first served: of one direction, or of several."""
    idle_from: float = -math.inf
    """End of the transmission of all queued packets [s]."""


class Channel:
    """One direction of a link. Its `conditions` may change at any time.

    Each effect draws from its own random stream, once a packet: what one effect does to packet n does not depend on the
    settings of the others.

    :param air: shared with other channels; None: an air of its own
    """

    def __init__(self, conditions: Optional[LinkConditions] = None, seed: object = 0,
                 air: Optional[Air] = None) -> None:
        self.conditions = conditions or LinkConditions()
        self.counts = Counts()
        self.waited: Counter[int] = collections.Counter()
        """{time in the queue [ms], rounded down: packets}"""
        self._draws = [random.Random('%s %s' % (seed, effect)).random
                       for effect in ('loss', 'jitter', 'reorder', 'duplicate')]
        self._losing = False            # state of the Markov chain
        self._air = air or Air()
        self._latest = -math.inf        # delivery of the last packet that is in order [s]

    def waits(self, now: float) -> float:
        """How long a packet that enters now waits in the queue [s]."""
        return max(0.0, self._air.idle_from - now)

    def fate(self, now: float, size: int) -> Tuple[float, ...]:
        """When a packet that enters now is delivered: no, one or two times [s].

        :param size: of the whole packet [byte]
        """
        conditions, counts = self.conditions, self.counts
        loss, jitter, reorder, duplicate = (draw() for draw in self._draws)
        counts.offered += 1
        sent = self._transmit(now, size)
        if sent is None:
            counts.dropped += 1
            return ()
        counts.carried += size
        self._losing = loss < conditions.chain[self._losing]
        if self._losing:
            counts.lost += 1
            return ()
        if reorder < conditions.reorder:
            out = sent
        else:
            delay = max(0.0, conditions.delay + conditions.jitter * (2 * jitter - 1))
            out = self._latest = max(self._latest, sent + delay)
        times = 2 if duplicate < conditions.duplicate else 1
        counts.delivered += times
        return (out,) * times

    def _transmit(self, now: float, size: int) -> Optional[float]:
        """When a packet's transmission ends; None: the queue is full [s]."""
        if not self.conditions.rate:
            return now
        begins = max(now, self._air.idle_from)
        if begins - now > self.conditions.queue:
            return None
        self.waited[int(1e3 * (begins - now))] += 1
        self._air.idle_from = begins + size * 8 / self.conditions.rate
        return self._air.idle_from
