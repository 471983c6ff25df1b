# SPDX-License-Identifier: BSD-3-Clause
"""The byte rate that the link carries now, from the rate at which datagrams arrive and from how long they queue.

What it rests on, and where that is from:

* **Delivered rate** (BBR, draft-cardwell-iccrg-bbr-congestion-control, and draft-cheng-iccrg-delivery-rate-estimation):
  between two datagrams that came, the bytes that left over the longer of the times in which they left and came are a
  rate that the link carries at the least; it never exceeds what was offered, so neither clumped arrivals nor forged
  reports can push it up. Where the later one had to queue, the air was busy between both, and bytes over the time in
  which they came are the capacity itself, even while sources pause: no "application-limited" marks are needed.
* **A standing queue of a few ms as the target** (LEDBAT, RFC 6817; SCReAM, RFC 8298): while it is there the air is busy
  and the capacity is measured all the time; a rate in proportion to what the queue lacks keeps it. LEDBAT's constant
  target is unfair to who came earlier and has no fixed shares, so the target falls with the rate (as Swift's flow
  scaling, Kumar et al., SIGCOMM 2020): of those who share an air the fast wants a shorter queue than the slow.
* **The queue as it will be** when the rate takes effect: what left since the newest report, less what the air has
  carried since (SCReAM's bytes in flight, as seconds).
* **The least delay, measured anew** (BBR's ProbeRTT): where nothing confirmed it for 5 s the rate dips shortly. All who
  share the air see the same valley, so their dips fall together, and the queue does drain.
* **Trains** (GCC's probe clusters, draft-ietf-rmcat-gcc-02; packet dispersion, Dovrolis 2001): where the queue is
  empty and more is wanted, some datagrams that are due anyway leave 2 to 4 times faster. They find a link that has
  become 60 times wider within half a second, at the cost of some ms of queue when it has not; padding is never sent.
* **Not loss** (against GCC's loss-based half, and TCP): a share of lost datagrams says nothing of the rate, for air
  time is spent on them. Loss counts in one case only: beside a full queue, what is lost beyond what was lost while
  the queue was short never was on the air, and is taken off the delivered rate.
"""
import math
import statistics
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .delay import QueueDelay, typical
from .probe import Trains

MBIT = 1e6 / 8
"""[byte/s]"""

TARGET, REFERENCE, SHAPE = 0.005, 20 * MBIT, 0.3
"""The queue to keep at a rate: TARGET * (REFERENCE / rate) ** SHAPE [s]"""

LEAST_TARGET, MOST_TARGET = 0.005, 0.04
"""[s]"""

MOST_NOISE = 0.015
"""Noise makes the queue to keep longer, by so much at most [s]."""

HORIZON = 0.2
"""What the queue has too much or lacks is to be mended in so long [s]."""

HARDEST, GENTLEST = 0.5, 1.1
"""The rate is so much of the capacity at least and at most."""

BUSY = 0.002
"""What queues for longer queued: the air was busy [s]."""

DIP, DIP_LASTS = 0.5, 0.2
"""A dip: the rate's factor, and how long [s]."""

SILENCE = 0.5
"""Without reports for so long the rate halves, again and again [s]."""

REPORTS_APART = 0.1
"""[s]"""

UNLIKELY = 0.01
"""Reports are lost like datagrams: silence is longer where it is more likely than this that all of them were."""

MOST_LOSS = 0.95
"""More is a link that is gone, as far as silence is concerned."""

FULL = 0.06
"""Beside a longer queue than this what is lost may never have been on the air [s]."""

LOSS_LASTS = 200
"""Datagrams over which loss is averaged."""

STUCK = 0.1
"""Where so much of a queue should have drained and did not, the way itself has become longer [s]."""


class Limits(NamedTuple):
    """Between which rates the estimate moves [byte/s]."""
    floor: float = 0.1 * MBIT
    """Safe: what is sent when nothing is known."""
    start: float = 0.5 * MBIT
    max_rate: float = 400 * MBIT


LIMITS = Limits()


@dataclass
class Link:
    """What is known of the link."""
    capacity: float
    """[byte/s]"""
    queue_delay: float = 0.0
    """As it will be when a rate takes effect [s]."""
    round_trip: float = math.nan
    """The least of late; NaN: unknown [s]."""
    loss: float = 0.0
    """Share of datagrams lost of late."""


def target(rate):
    """The queue to keep at a rate [s]."""
    return min(max(TARGET * (REFERENCE / rate) ** SHAPE, LEAST_TARGET), MOST_TARGET)


class Estimator:
    """Follows one link.

    :param now: by a steady clock [s]
    :param limits: Limits
    """

    def __init__(self, now, limits=LIMITS):
        self.limits = limits
        self.link = Link(min(limits.start, limits.max_rate))
        self.rate = self.link.capacity
        """What may leave now, of all streams together [byte/s]."""
        self.missing = 0
        """So often the rate was halved since reports stay away; """
        self._delay, self._trains = QueueDelay(), Trains()
        self._newest = None             # Point
        self._came = now                # when the last report came
        self._dip_ends = -math.inf
        self._dip_points = []
        self._air_loss = 0.0            # while the queue was short
        self._stood = 0.0, self.link.capacity   # the queue and the capacity since when
        self._drained = 0.0             # so much should have drained [s]

    def take(self, evidence, now, wanted=math.inf):
        """Take what a report says.

        :param evidence: report.Evidence
        :param wanted: what the streams would send if the link had room for it [byte/s]
        :return: a Train for the pacer, or None
        """
        self._came, self.missing = now, 0
        if evidence.anew:
            self._delay.base = None
            self._newest = None
        if not evidence.points:
            return None
        link, points = self.link, evidence.points
        chain = ([self._newest] if self._newest else []) + points
        self._newest = points[-1]
        self._delay.note(points, link.capacity, now)
        queue = self._delay.of(typical(points, link.capacity), link.capacity)
        link.round_trip = evidence.round_trip
        drains = max(0.0, chain[-1].sent - chain[0].sent - (chain[-1].total - chain[0].total) / link.capacity)
        before = link.capacity
        self._learn(chain, queue, self._lost(evidence, queue))
        self._check_base(points, queue, before, drains, now)
        waits = now - self._newest.sent - queue
        link.queue_delay = max(0.0, evidence.unreported / link.capacity - waits)
        self._set_rate(now)
        usual = statistics.median(self._delay.of(point, link.capacity) for point in points)
        empty = usual < self._target() / 2 + self._delay.noise and now > self._dip_ends
        return self._trains.next(link.capacity, empty, wanted > self.rate, self._newest, evidence.unreported, now)

    def poll(self, now):
        """Whether reports stay away: call it some times a second."""
        loss = min(max(self.link.loss, UNLIKELY), MOST_LOSS)
        silence = max(SILENCE, REPORTS_APART * math.log(UNLIKELY) / math.log(loss))
        while now - self._came > silence * (1 + self.missing) and self.link.capacity > self.limits.floor:
            self.missing += 1
            self.link.capacity = max(self.link.capacity / 2, self.limits.floor)
        self._set_rate(now)

    def _target(self):
        return target(self.link.capacity) + min(2 * self._delay.noise, MOST_NOISE)

    def _lost(self, evidence, queue):
        """The share of datagrams that never were on the air."""
        if not evidence.expected:
            return 0.0
        loss, weight = 1 - evidence.received / evidence.expected, min(1.0, evidence.expected / LOSS_LASTS)
        self.link.loss += weight * (loss - self.link.loss)
        if queue < FULL:
            self._air_loss += weight * (loss - self._air_loss)
            return 0.0
        return max(0.0, (loss - self._air_loss) / (1 - self._air_loss)) if self._air_loss < 1 else 0.0

    def _learn(self, chain, queue, lost):
        """The capacity, from how the chain of points came."""
        link = self.link
        carried, busy, whole = 0, 0.0, chain[-1].arrived - chain[0].arrived
        waited = [self._delay.of(point, link.capacity) > BUSY + 2 * self._delay.noise for point in chain]
        for at, (before, after) in enumerate(zip(chain, chain[1:])):
            if waited[at + 1] and (waited[at] or after.total - before.total == after.size):
                carried += after.total - before.total
                busy += after.arrived - before.arrived
        if busy > whole / 4 and busy > 0.01:
            weight = min(1.0, busy / HORIZON * 2)
            link.capacity += weight * (carried * (1 - lost) / busy - link.capacity)
        if queue < FULL:
            link.capacity = max(link.capacity, peak(chain, 2 * self._delay.noise))
            self._delay.note_noise(chain)
        link.capacity = min(max(link.capacity, self.limits.floor), self.limits.max_rate)

    def _check_base(self, points, queue, before, drains, now):
        """Measure the least delay anew where it is old, or has moved.

        :param before: the capacity that the last rate was made for [byte/s]
        :param drains: what of a queue must have drained while these points left, by that capacity [s]
        """
        link = self.link
        if queue > FULL:        # is drained anyway, and no dip is long enough
            self._dip_ends, self._dip_points = -math.inf, []
        elif now < self._dip_ends:
            self._dip_points.append(typical(points, link.capacity))
        elif self._dip_points:
            self._delay.believe(self._dip_points, link.capacity, now)
            self._dip_points = []
        elif self._delay.expired(now):
            self._dip_ends = now + DIP_LASTS
        stood = abs(queue - self._stood[0]) < STUCK / 20 + self._drained / 3
        if queue < 2 * self._target() or not stood:
            self._stood, self._drained = (queue, before), 0.0
            return
        self._drained += drains
        if self._drained > STUCK:
            link.capacity = max(link.capacity, self._stood[1])
            self._delay.believe([typical(points, link.capacity)], link.capacity, now)
            self._drained = 0.0

    def _set_rate(self, now):
        link, limits = self.link, self.limits
        factor = min(max(1 + (self._target() - link.queue_delay) / HORIZON, HARDEST), GENTLEST)
        if now < self._dip_ends:
            factor = min(factor, DIP)
        self.rate = min(max(link.capacity * factor, limits.floor), limits.max_rate)


def peak(chain, noise):
    """The fastest that some of the points are sure to have been carried [byte/s].

    :param chain: [report.Point, ...] in the order they left
    :param noise: times differ by so much for other reasons [s]
    """
    sent, arrived, total = (np.array([getattr(point, name) for point in chain])
                            for name in ('sent', 'arrived', 'total'))
    size = max(point.size for point in chain)
    first, last = np.triu_indices(len(chain), 1)
    carried = total[last] - total[first]
    took = np.maximum(sent[last] - sent[first], arrived[last] - arrived[first]) + noise
    enough = (carried >= 2 * size) & (took > 1e-4)
    return float(np.max(carried[enough] / took[enough], initial=0.0))
