# SPDX-License-Identifier: BSD-3-Clause
"""What one direction of a bad link does to each packet: pure, seeded, time is an argument.

A packet first queues for the air (a rate, with a queue that drops its tail when it is full), then it may be lost (a
two-state Markov chain: E. N. Gilbert, "Capacity of a Burst-Noise Channel", 1960), and then it travels (delay,
jitter, reordering, duplication). Loss comes after the rate: air time is spent on lost packets, too.
"""
import collections
import math
import random
from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Quality:
    """How good one direction of a link is.

    :raises ValueError: naming the field that is impossible and its value
    """
    loss: float = 0.0
    """Share of packets that the air loses, 0..1."""
    burst: float = 0.0
    """Mean run of lost packets, at least 1 / (1 - loss); 0: packets are lost independently."""
    delay: float = 0.0
    """One way [s]."""
    jitter: float = 0.0
    """The delay varies by so much to either side; packets stay in order [s]."""
    rate: float = 0.0
    """Of the air [bit/s]; 0: unlimited."""
    queue: float = 0.1
    """With a rate: so much air time may wait; what comes to a full queue is dropped [s]."""
    reorder: float = 0.0
    """Share of packets that skip the delay and overtake, 0..1."""
    duplicate: float = 0.0
    """Share of packets that come twice, 0..1."""

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value < 0:
                raise ValueError('%s is %r, must be a number from 0' % (field.name, value))
        for name in ('loss', 'reorder', 'duplicate'):
            if getattr(self, name) > 1:
                raise ValueError('%s is %g, must be from 0 to 1' % (name, getattr(self, name)))
        if self.burst and self.loss < 1 and self.burst < 1 / (1 - self.loss):
            raise ValueError('burst is %g; losing %g of the packets takes runs of %g at least' % (
                self.burst, self.loss, 1 / (1 - self.loss)))

    @property
    def chain(self):
        """(P(lost | the last one came), P(lost | the last one was lost)); equal where losses are independent."""
        if not self.burst or self.loss in (0, 1):
            return self.loss, self.loss
        ends = 1 / self.burst
        return self.loss * ends / (1 - self.loss), 1 - ends


@dataclass
class Counts:
    """What happened to the packets of one direction."""
    offered: int = 0
    lost: int = 0
    """By the air."""
    dropped: int = 0
    """By the full queue."""
    delivered: int = 0
    """Duplicates count, too."""
    carried: int = 0
    """By the air, what it lost included [byte]."""


class Channel:
    """One direction of a link. Its quality may change at any time.

    Each effect draws from a random stream of its own, once a packet: packet n meets the same fate by one effect
    whatever the others are set to.
    """

    def __init__(self, quality=None, seed=0):
        self.quality = quality or Quality()
        self.counts = Counts()
        self.waited = collections.Counter()
        """{whole milliseconds: packets that waited so long for the air}"""
        self._draws = [random.Random('%s %s' % (seed, effect)).random
                       for effect in ('loss', 'jitter', 'reorder', 'duplicate')]
        self._losing = False          # the chain's state
        self._air_free = -math.inf    # when the air has sent all that is queued [s]
        self._latest = -math.inf      # when the last packet in order comes out [s]

    def waits(self, now):
        """How long a packet that enters now waits for the air [s]."""
        return max(0.0, self._air_free - now)

    def fate(self, now, size):
        """When a packet that enters now comes out: at none, one or two times [s].

        :param size: of the whole packet [byte]
        """
        quality, counts = self.quality, self.counts
        loss, jitter, reorder, duplicate = (draw() for draw in self._draws)
        counts.offered += 1
        sent = now
        if quality.rate:
            begins = max(now, self._air_free)
            if begins - now > quality.queue:
                counts.dropped += 1
                return ()
            sent = self._air_free = begins + size * 8 / quality.rate
            self.waited[int(1e3 * (begins - now))] += 1
        counts.carried += size
        self._losing = loss < quality.chain[self._losing]
        if self._losing:
            counts.lost += 1
            return ()
        if reorder < quality.reorder:
            out = sent
        else:
            travels = max(0.0, quality.delay + quality.jitter * (2 * jitter - 1))
            out = self._latest = max(self._latest, sent + travels)
        times = 2 if duplicate < quality.duplicate else 1
        counts.delivered += times
        return (out,) * times
