# SPDX-License-Identifier: BSD-3-Clause
"""One direction of an emulated link, packet by packet: seeded, without I/O; time is an argument.

A packet first waits for transmission (a rate, and a drop-tail queue, or a policer, where nothing waits), perhaps until
the aggregate ends that it is a part of, as over Wi-Fi. Then it may be lost (a two-state Markov chain: E. N. Gilbert,
"Capacity of a Burst-Noise Channel", 1960), and then it propagates (delay, jitter, reordering, duplication). Loss comes
after the rate because lost packets take air time, too.
"""
import collections
import math
import random
from dataclasses import astuple, dataclass, fields
from typing import Counter, DefaultDict, Optional, Tuple

ROUNDING = 1e-3
"""A packet may exceed the tokens by this: times are rounded, and a bucket of one packet has to pass it [bit]."""


AGGREGATE_SPREAD = 1 / 3
"""How far the time between two aggregates deviates from its mean: 4 to 8 ms where that is 6 ms."""


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
    bucket: float = 0.0
    """Depth of the token bucket of a policer (RFC 2697), which replaces the queue: what exceeds the rate by more than
    this is dropped at once, and nothing waits; 0: no policer [byte]."""
    aggregate: float = 0.0
    """Mean time between the ends of aggregates (A-MPDUs of IEEE 802.11): what was transmitted meanwhile arrives at
    once, and nothing else; each time deviates by up to a third. 0: each packet arrives by itself [s]."""
    ecn_threshold: float = 0.0
    """A packet that would wait longer than this in the queue is marked, if its sender sees marks (RFC 3168); 0: none is
    [s]."""
    reorder: float = 0.0
    """Ratio of packets that skip the delay and overtake others, 0..1."""
    duplicate: float = 0.0
    """Ratio of packets that are delivered twice, 0..1."""
    longest: float = 0.0
    """Longer packets are lost, and nobody is told: a tunnel whose ICMP messages are dropped; 0: none are [byte]."""

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
        if self.bucket and not self.rate:
            raise ValueError('bucket is %g, needs a rate' % self.bucket)

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
    """By the full queue, or by the policer."""
    delivered: int = 0
    """Including duplicates."""
    carried: int = 0
    """Transmitted, including lost packets [byte]."""
    marked: int = 0
    """In the queue (ECN), including lost and dropped packets."""


@dataclass
class Air:
    """What transmits packets one after the other, first come, first served: of one direction, or of several."""
    idle_from: float = -math.inf
    """End of the transmission of all queued packets; of a policer, when its bucket is full again [s]."""


class Channel:
    """One direction of a link. Its `conditions` may change at any time.

    Each effect draws from its own random stream, once a packet, or once an aggregate: what one effect does to packet n
    does not depend on the settings of the others.

    :param air: shared with other channels; None: an air of its own
    """

    def __init__(self, conditions: Optional[LinkConditions] = None, seed: object = 0,
                 air: Optional[Air] = None) -> None:
        self.conditions = conditions or LinkConditions()
        self.flows: DefaultDict[str, Counts] = collections.defaultdict(Counts)
        """{flow: what became of its packets}"""
        self.waited: Counter[int] = collections.Counter()
        """{time in the queue [ms], rounded down: packets}"""
        self._draws = [random.Random('%s %s' % (seed, effect)).random
                       for effect in ('loss', 'jitter', 'reorder', 'duplicate')]
        self._draw_aggregate = random.Random('%s aggregate' % seed).random
        self._aggregate_ends = -math.inf    # of the newest one [s]
        self._losing = False            # state of the Markov chain
        self._air = air or Air()
        self._latest = -math.inf        # delivery of the last packet that is in order [s]

    @property
    def counts(self) -> Counts:
        """What became of the packets of all flows until now."""
        return Counts(*map(sum, zip(*map(astuple, self.flows.values()))))

    def waits(self, now: float) -> float:
        """How long a packet that enters now waits in the queue [s]."""
        return 0.0 if self.conditions.bucket else max(0.0, self._air.idle_from - now)

    def marks(self, now: float, flow: str = '') -> bool:
        """Whether a packet that enters now, and whose sender sees marks, is marked; to be called before `fate`."""
        threshold = self.conditions.ecn_threshold
        marked = 0 < threshold < self.waits(now)
        self.flows[flow].marked += marked
        return marked

    def fate(self, now: float, size: int, flow: str = '') -> Tuple[float, ...]:
        """When a packet that enters now is delivered: no, one or two times [s].

        :param size: of the whole packet [byte]
        :param flow: what it is counted with; the link treats all flows alike
        """
        conditions, counts = self.conditions, self.flows[flow]
        loss, jitter, reorder, duplicate = (draw() for draw in self._draws)
        counts.offered += 1
        sent = self._transmit(now, size)
        if sent is None:
            counts.dropped += 1
            return ()
        counts.carried += size
        sent = self._gathered(sent)
        self._losing = loss < conditions.chain[self._losing]
        if self._losing or 0 < conditions.longest < size:
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
        """When a packet's transmission ends; None: the queue is full, or the bucket has too few tokens [s]."""
        conditions = self.conditions
        if not conditions.rate:
            return now
        begins = max(now, self._air.idle_from)
        ends = begins + size * 8 / conditions.rate
        if conditions.bucket:       # the tokens that it lacks are a queue in which nobody waits
            if (ends - now) * conditions.rate > conditions.bucket * 8 + ROUNDING:
                return None
            self._air.idle_from = ends
            return now
        if begins - now > conditions.queue:
            return None
        self.waited[int(1e3 * (begins - now))] += 1
        self._air.idle_from = ends
        return ends

    def _gathered(self, sent: float) -> float:
        """When the aggregate ends of a packet that was transmitted then [s]."""
        mean = self.conditions.aggregate
        if not mean:
            return sent
        if self._aggregate_ends + 2 * mean <= sent:     # since then, empty ones have ended
            self._aggregate_ends = sent
        while self._aggregate_ends <= sent:
            self._aggregate_ends += mean * (1 + AGGREGATE_SPREAD * (2 * self._draw_aggregate() - 1))
        return self._aggregate_ends
