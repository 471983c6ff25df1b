# SPDX-License-Identifier: BSD-3-Clause
"""The byte rate that the link carries now, from the rate at which datagrams arrive and from how long they queue.

What it rests on, and where that is from:

* **Delivered rate** (BBR, draft-cardwell-iccrg-bbr-congestion-control, and draft-cheng-iccrg-delivery-rate-estimation):
  between two datagrams that came, the bytes that left over the longer of the times in which they left and came are a
  rate that the link carries at the least; it never exceeds what was offered, so clumped arrivals do not push it up.
  Where the later one had to queue, the air was busy between both, and bytes over the time in which they came are the
  capacity itself, even while sources pause: no "application-limited" marks are needed.
* **A standing queue of a few ms as the target** (LEDBAT, RFC 6817; SCReAM, RFC 8298): while it is there the air is busy
  and the capacity is measured all the time; a rate in proportion to what the queue lacks keeps it. LEDBAT's constant
  target is unfair to who came earlier and has no fixed shares, so the target falls with the rate (as Swift's flow
  scaling, Kumar et al., SIGCOMM 2020): of those who share an air the fast wants a shorter queue than the slow.
* **The queue as it will be** when the rate takes effect: what left since the newest report, less what the air has
  carried since (SCReAM's bytes in flight, as seconds).
* **The least delay, measured anew** (BBR's ProbeRTT; LEDBAT++'s slowdowns): where nothing confirmed it for 5 s the rate
  dips shortly. A queue that has become long is drained by all who share the air at the same time, for all see it, and
  all learn the true least delay then; so who comes late, and takes a queue for the way, is put right. What a drain
  leaves of a delay is the way itself, which has become longer.
* **Trains** (GCC's probe clusters, draft-ietf-rmcat-gcc-02; packet dispersion, Dovrolis 2001): where the queue is empty
  and more is wanted, some datagrams that are due anyway leave 2 to 4 times faster. They find a link that has become
  60 times wider within a second, at the cost of some ms of queue when it has not; padding is never sent.
* **Not loss** (against GCC's loss-based half, and TCP): a share of lost datagrams says nothing of the rate, for air
  time is spent on them. More loss than before is a reason to ask: the rate is halved for a moment. What is lost then,
  too, the air loses (loss.py); what is not was dropped by a queue too short to be seen, and the rate goes down by it.

Where it ends: a queue of 10 ms, which drops before it is seen, is overrun by some 40 % in spite of that; where the air
begins to lose nearly all at once, reports too, the rate falls for some seconds; and as all that go by delay it is no
match for a flow that fills the queue whatever others do.
"""
import math
import statistics
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .delay import QueueDelay, typical
from .loss import MOST, Loss
from .probe_rtt import Quiet
from .probing import Trains

MBIT = 1e6 / 8
"""[byte/s]"""

TARGET, REFERENCE, SHAPE = 0.005, 20 * MBIT, 0.25
"""The queue to keep at a rate: TARGET * (REFERENCE / rate) ** SHAPE [s]"""

LEAST_TARGET, MOST_TARGET = 0.005, 0.04
"""[s]"""

MOST_NOISE = 0.01
"""Noise makes the queue to keep longer, by so much at most [s]."""

HORIZON = 0.2
"""What the queue has too much or lacks is to be mended in so long [s]."""

HARDEST, GENTLEST = 0.5, 1.1
"""The rate is so much of the capacity at least and at most."""

BUSY = 0.002
"""What waits longer queued: the air was busy [s]."""

SILENCE = 0.5
"""Without reports for so long the rate halves, again and again [s]."""

COMES_BACK = 2.0
"""When reports come again, and show no queue, the capacity is this part of what it was before they stayed away."""

REPORTS_APART = 0.1
"""Reports are made so often, and polls [s]."""

UNLIKELY = 0.01
"""Reports are lost like datagrams: silence is longer where it is more likely than this that all of them were."""

FULL = 0.06
"""A queue as long as this is drained; what is lost beside it may never have been on the air [s]."""

LONG, STANDS = 1.5, 1.0
"""So is one longer than it is to be by this factor for so long [s]: less is sent all the time, so it is none."""

PUSHES = 1.25
"""Beside a queue, a train that came faster may only have pushed others aside: it counts up to this factor."""

AFTER_QUIET = 0.6
"""No train leaves for so long after a quiet moment: others have only been quiet, too [s]."""

GROWS, REACHES, HOPES = 1.05, 1.5, 3.0
"""Where the queue is empty because little is sent, the capacity is supposed to be so much more from report to report,
up to so much more than was sent, or so many times the floor: else who has nothing to send would never be allowed to."""


class Limits(NamedTuple):
    """Between which rates the estimate moves [byte/s]."""
    floor: float = 0.1 * MBIT
    """Safe: what is sent when nothing is known."""
    start: float = 0.5 * MBIT
    max_rate: float = 400 * MBIT


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


LIMITS = Limits()


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
        """So often the rate was halved since reports stay away."""
        self._delay, self._loss, self._trains, self._quiet = QueueDelay(), Loss(), Trains(), Quiet()
        self._newest = None     # Point
        self._came = now        # when the last report came
        self._before = 0.0      # the capacity before they stayed away
        self._empty = True      # whether the last report showed a short queue
        self._short = now       # when the queue was last as short as it is to be

    def take(self, evidence, now, wanted=math.inf):
        """Take what a report says.

        :param evidence: report.Evidence
        :param wanted: what the streams would send if the link had room for it [byte/s]
        :return: a Train for the pace, or None
        """
        self._came, missed, self.missing = now, self.missing, 0
        if evidence.anew:
            self._delay.base = self._newest = None
        if not evidence.points:
            self._loss.note(evidence, False)
            self.link.loss = self._loss.told
            self._set_rate(now)
            return None
        link, points = self.link, evidence.points
        chain = ([self._newest] if self._newest else []) + points
        self._newest, link.round_trip = points[-1], evidence.round_trip
        self._delay.note(points, link.capacity, now)
        middle = typical(points)
        queue = self._delay.of(middle)
        # what left while the queue was short the air lost, if anything
        short = queue < self._target()
        self._loss.note(evidence, short and self._empty or queue < FULL and self._quiet.holds(chain[0].sent))
        self._empty = short
        link.loss = self._loss.told
        if missed and short:    # reports were lost, as all else
            link.capacity = max(link.capacity, self._before / COMES_BACK)
        self._learn(chain, queue)
        if self._quiet.go_on(self._delay, middle, queue, self._target(), now):
            self._loss.settle()
        if self._loss.excess and queue < FULL and self._quiet.asked(now):
            link.capacity = max(link.capacity * max(HARDEST, 1 - self._loss.excess), self.limits.floor)
            self._loss.settle()
        if queue < LONG * self._target():
            self._short = now
        long = queue > FULL or now - self._short > STANDS
        self._quiet.begin(self._delay.expired(now), long, self._loss.excess > 0, link.loss, now)
        passed = now - self._newest.sent - queue    # since the newest datagram was on the air
        link.queue_delay = max(0.0, evidence.unreported / link.capacity - passed)
        self._set_rate(now)
        return self._train(points, wanted, evidence.unreported, now)

    def poll(self, now):
        """Go on without a report: call it some times a second."""
        loss = min(max(self.link.loss, UNLIKELY), MOST)
        silence = max(SILENCE, REPORTS_APART * math.log(UNLIKELY) / math.log(loss))
        while now - self._came > silence * (1 + self.missing) and self.link.capacity > self.limits.floor:
            self._before = self._before if self.missing else self.link.capacity
            self.missing += 1
            self.link.capacity = max(self.link.capacity / 2, self.limits.floor)
        self._set_rate(now)

    def _target(self):
        return target(self.link.capacity) + min(2 * self._delay.noise, MOST_NOISE)

    def _learn(self, chain, queue):
        """The capacity, from how the chain of points came."""
        link, lost = self.link, self._loss.excess if queue > FULL else 0.0
        waits, least = [self._delay.of(point) for point in chain], BUSY + 2 * self._delay.noise
        carried, busy, whole = 0, 0.0, chain[-1].arrived - chain[0].arrived
        for at, (before, after) in enumerate(zip(chain, chain[1:])):
            # the later one came to a queue; and the earlier one was in it still, or nothing left between them
            if waits[at + 1] > least and (after.sent - before.sent < waits[at] or
                                          after.total - before.total == after.size):
                carried += after.total - before.total
                busy += after.arrived - before.arrived
        if busy > whole / 4 and busy > 0.01:
            more = min(1.0, 2 * busy / HORIZON) * (carried * (1 - lost) / busy - link.capacity)
            if more > 0 or queue > self._target() / 2:      # without a queue less was offered, not carried
                link.capacity += more
        if queue < FULL and not self._loss.excess:
            most = math.inf if busy < whole * 3 / 4 else PUSHES * link.capacity
            # beside a full queue what left was not all carried
            short = max((at + 1 for at, wait in enumerate(waits) if wait > FULL), default=0)
            link.capacity = max(link.capacity, min(most, peak(chain[short:], 2 * self._delay.noise)))
            self._delay.note_noise(chain[short:])
            if queue < self._target() / 2:
                offered = (chain[-1].total - chain[0].total) / max(chain[-1].sent - chain[0].sent, 1e-3)
                reach = max(HOPES * self.limits.floor, REACHES * offered)
                link.capacity = max(link.capacity, min(reach, link.capacity * GROWS))
        link.capacity = min(max(link.capacity, self.limits.floor), self.limits.max_rate)

    def _set_rate(self, now):
        link, limits = self.link, self.limits
        factor = min(max(1 + (self._target() - link.queue_delay) / HORIZON, HARDEST), GENTLEST)
        self.rate = min(max(link.capacity * min(factor, self._quiet.most(now)), limits.floor), limits.max_rate)

    def _train(self, points, wanted, unreported, now):
        if self._quiet.lasts(now - AFTER_QUIET) or self._loss.excess:
            return None
        capacity = self.link.capacity
        usual = statistics.median(self._delay.of(point) for point in points)
        empty = usual < self._target() / 2
        return self._trains.next(capacity, empty, wanted > self.rate, self._newest, unreported, now)


def peak(chain, noise):
    """The fastest that some of the points are sure to have been carried [byte/s].

    :param chain: [report.Point, ...] in the order they left
    :param noise: times differ by so much for other reasons [s]
    """
    sent, arrived, total = (np.array([getattr(point, name) for point in chain])
                            for name in ('sent', 'arrived', 'total'))
    size = max((point.size for point in chain), default=0)
    first, last = np.triu_indices(len(chain), 1)
    carried = total[last] - total[first]
    took = np.maximum(sent[last] - sent[first], arrived[last] - arrived[first]) + noise
    enough = (carried >= 2 * size) & (took > 1e-4)
    return float(np.max(carried[enough] / took[enough], initial=0.0))
