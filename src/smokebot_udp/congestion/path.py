# SPDX-License-Identifier: BSD-3-Clause
"""What a report shows, by a model of the path: a base delay, noise, a queue, and a token bucket before it."""
import math
from typing import List, NamedTuple, Optional

from .delay import QueueDelay, typical
from .delivery_rate import BUSY_DELAY, busy_period, peak_rate
from .feedback import Feedback, PacketSample, sending_rate
from .shaper import Shaper

LONG_QUEUE = 0.06
"""A longer queue is drained; and datagrams lost beside it may never have been on the air [s]."""

DROPPING = 2.0
"""A queue that was longer than this many long ones for a moment may have dropped datagrams, too."""

MIN_BUSY = 0.01, 0.25
"""A rate is measured where the air was busy for this long, and for this part of the time [s, 1]."""

PUSHED, MAX_PUSH_FACTOR = 0.75, 1.1
"""Where the air was busy for this part of the time, a train that was faster may only have displaced other traffic: it
counts up to this factor."""


class Observation(NamedTuple):
    """What a report shows. It is computed before anything is decided."""
    now: float
    """When the report came [s]."""
    feedback: Feedback
    chain: List[PacketSample]
    """Its samples in sending order, after the newest one known before."""
    waits: List[float]
    """Queueing delay of each [s]."""
    sample: PacketSample
    """The one that speaks for the report."""
    queue: float
    """Queueing delay of that one [s]."""
    noise: float
    """What noise may add to a queueing delay [s]."""
    offered: float
    """What was sent [byte/s]."""
    carried: float
    """What arrived while the air was busy [byte/s]; 0: it was not, or not long enough to be measured."""
    busy: float
    """How long it was [s]."""
    bound: float
    """What the path carries at least, also where no queue was seen [byte/s]."""

    @property
    def newest(self) -> PacketSample:
        """The newest sample."""
        return self.chain[-1]

    @property
    def is_queued(self) -> bool:
        """Whether any datagram waited."""
        return max(self.waits) > BUSY_DELAY + self.noise

    @property
    def is_long(self) -> bool:
        """Whether the queue is so long that it is drained, and may have dropped what is lost."""
        return self.queue > LONG_QUEUE

    @property
    def was_long(self) -> bool:
        """Whether it was so long for some of the datagrams, so that some may have been dropped."""
        return self.is_long or max(self.waits) > DROPPING * LONG_QUEUE

    @property
    def duration(self) -> float:
        """From the first to the last arrival [s]."""
        return self.newest.arrived - self.chain[0].arrived


class Path:
    """The model of one path, which reports keep up to date."""

    def __init__(self) -> None:
        self.delay, self.shaper = QueueDelay(), Shaper()
        self._newest: Optional[PacketSample] = None

    def observe(self, feedback: Feedback, capacity: float, now: float) -> Observation:
        """Take a report.

        :param feedback: with one sample at least
        :param capacity: as known [byte/s]
        :param now: by a steady clock [s]
        """
        if feedback.restarted:
            self.delay.base = self._newest = None
            self.shaper.restart()
        samples, noise = feedback.samples, self.delay.allowance
        chain = [self._newest, *samples] if self._newest else samples
        self._newest = samples[-1]
        self.delay.update(samples, capacity, now)
        sample = typical(samples)
        waits = [self.delay.of(one) for one in chain]
        carried, busy = busy_period(chain, waits, noise, capacity, self.shaper.is_deep(capacity))
        duration = chain[-1].arrived - chain[0].arrived
        measured = busy > max(MIN_BUSY[0], MIN_BUSY[1] * duration)
        queue = self.delay.of(sample)
        bound = self._bound(chain, waits, capacity, queue)
        if busy > PUSHED * duration:
            bound = min(bound, MAX_PUSH_FACTOR * capacity)
        return Observation(now, feedback, chain, waits, sample, queue, noise, sending_rate(chain[0], chain[-1]),
                           carried / busy if measured else 0.0, busy, bound)

    def _bound(self, chain: List[PacketSample], waits: List[float], capacity: float, queue: float) -> float:
        """What the path carries at least [byte/s]; beside a long queue not all that was sent was carried."""
        noise = self.delay.allowance
        known = self.shaper.follow(chain, waits, capacity, BUSY_DELAY + noise)
        since = max((at + 1 for at, one in enumerate(known) if one.wait > LONG_QUEUE), default=0)
        cleared = known[since:]
        if queue > LONG_QUEUE or len(cleared) < 2:
            return 0.0
        fresh = [one for one in cleared if one.sample.sent >= chain[0].sent]
        if self.shaper.is_deep(capacity):       # what passes at once does not wait for each other
            self.delay.update_noise([one.sample for one in fresh if one.tokens], math.inf)
        else:
            self.delay.update_noise([one.sample for one in fresh], capacity)
        return peak_rate(cleared, noise)
