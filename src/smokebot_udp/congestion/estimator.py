# SPDX-License-Identifier: BSD-3-Clause
"""The byte rate that the link carries now, from delivery rate and queueing delay.

Its parts:

* **Delivery rate** (delivery_rate.py; BBR, draft-cardwell-iccrg-bbr-congestion-control;
  draft-cheng-iccrg-delivery-rate-estimation):
  between two datagrams that arrived, the bytes sent over the longer of the sending and the arrival interval are a rate
  that the link carries at least. It never exceeds what was offered. Nor do clumped arrivals inflate it: a datagram that
  the receiver read late counts from when it can have come off the air. Where the later datagram was queued the air was
  busy in between, and bytes over the arrival interval are the capacity itself, even while sources pause: no marks for
  "application-limited" are needed.
* **A standing queue of a few ms as the target** (LEDBAT, RFC 6817; SCReAM, RFC 8298): with it the air is busy and
  the capacity is measured all the time; a rate correction proportional to what the queue lacks keeps it. LEDBAT's
  constant target is unfair to early starters and has no fixed point for the shares, so the target falls with the rate
  (Swift's flow scaling, Kumar et al., SIGCOMM 2020): of flows that share the air a fast one wants a shorter queue
  than a slow one.
* **The queue predicted for when the rate takes effect**: bytes sent since the newest report, less what the air has
  carried since (SCReAM's bytes in flight, as seconds).
* **The base delay, measured again** (BBR's ProbeRTT; LEDBAT++'s slowdowns; probe_rtt.py): where nothing confirmed it
  for 5 s, or for 2 s where noise may have made it short, the rate dips shortly. A queue that has become long is drained
  by all who share the air at the same time, as all see it, and all learn the true base delay then; that corrects a late
  starter who took the queue for the path. What a drain leaves of the delay is the path itself, which has become longer.
* **Packet trains** (probing.py): where the queue is empty and more is wanted, some datagrams that are due anyway leave
  2 to 4 times faster. They find a link that has become 60 times wider within a second, at the cost of a few ms of
  queue when it has not.
* **Assumed growth**: where the queue is empty and the capacity was not measured for 2 s, it is taken for 5 % more with
  each report, as otherwise an idle sender could never ramp up. Noise of delays counts neither as a queue nor against an
  empty one, up to 10 ms; what one's own datagrams wait for each other is no noise.
* **No reaction to loss as such** (unlike GCC's loss-based half, and TCP): on a lossy air the loss ratio says nothing
  about the rate, because lost datagrams use air time, too. More loss than before is a reason to check: as much less is
  sent for a moment as was lost. What is lost then the air loses (loss.py); otherwise a policer or a queue too short to
  be seen drops datagrams, and the rate stays below what it lets pass (loss_ceiling.py).
* **Beside a flow that fills the queue regardless of others**, as a TCP download does, a delay-based control would yield
  until nothing is left. There a part of what the bottleneck carries is sent (competition.py).

Limits: where the air begins to lose nearly everything at once, including reports, the rate falls for some seconds; and
much jitter looks like a queue.
"""
import math
import statistics
from dataclasses import dataclass
from typing import List, NamedTuple, Optional

from ..units import MBIT
from .competition import Competition
from .delay import QueueDelay, typical
from .delivery_rate import busy_period, peak_rate
from .feedback import Feedback, PacketSample, sending_rate
from .loss import MAX_AIR_LOSS, Loss
from .loss_ceiling import LossCeiling
from .probe_rtt import DRAIN_GAIN, MAX_BASE_STEP, ProbeRtt
from .probing import SUCCESS_FACTOR, ProbeController, ProbeTrain

REFERENCE_TARGET = 0.005
"""Queueing delay to keep at REFERENCE_RATE [s];"""

REFERENCE_RATE = 20 * MBIT
"""[byte/s]"""

TARGET_EXPONENT = 1 / 3
"""it scales with this power of REFERENCE_RATE / rate,"""

MIN_TARGET = 0.005
"""between this [s]"""

MAX_TARGET = 0.04
"""and this [s]."""

HORIZON = 0.2
"""The difference between queue and target is corrected over this time, and no longer without a report [s]."""

MIN_GAIN = 0.5
"""Rate in capacities, at least,"""

MAX_GAIN = 1.1
"""and at most."""

ENOUGH = 16
"""As many datagrams say for sure what the air carries: between fewer, a single one of others takes much of the time.
Beside a long queue all do: a single one of others makes none."""

MAX_MEASURED_NOISE, MAX_TRUSTED_NOISE = 0.25, 0.5
"""Where noise is less than this part of the queue that is wanted, the capacity is measured for sure; and a lower one is
believed by half at a short queue."""

RELAXED, PROVEN = 0.7, 1.1
"""Where less than this part of the capacity is sent, and no more than was carried lately, by this factor, or not more
than start_rate, and no queue shows, what is lost the air loses. Trains alone prove no capacity: a policer lets them
pass."""

CARRIED_MEMORY = 0.99
"""With each report what was carried lately counts for this part of before."""

QUEUE_MEMORY = 0.5
"""A queue that was long dropped what is lost until this long after [s]."""

OUTAGE_MEMORY = 1.5
"""What was lost while the link was away is reported for this long after it: by each stream with its next datagram
[s]."""

REPORT_INTERVAL = 0.1
"""Reports are sent, and the estimator is polled, this often [s]."""

REPORT_TIMEOUT = 0.5
"""The rate is halved each time no report came for this long, where more than min_rate is sent [s]."""

REPORT_LOSS_PROBABILITY = 0.01
"""Reports are lost like datagrams: the timeout is longer where losing all of them is more probable than this."""

RECOVERY_FACTOR = 2.0
"""When reports return and show no long queue, or hardly anything was sent, the capacity is what it was before the
timeout; over this where streams send, and the loss of datagrams does not explain that of the reports,"""

RECOVERY_GROWTH_FACTOR = 1.2
"""and this much more with each report that shows no queue, until it is what it was, or was measured."""

LONG_QUEUE = 0.06
"""A longer queue is drained; and datagrams lost beside it may never have been on the air [s]."""

STANDING_FACTOR = 1.5
"""So is a queue longer than this many targets"""

STANDING_TIME = 1.0
"""for this long: less is sent all the time, so it is the path rather than a queue [s]."""

MAX_PUSH_FACTOR = 1.1
"""A train that was faster while the air was busy may only have displaced other traffic: it counts up to this factor."""

MAX_TRAIN_LOSS = 0.5
"""Where more than this part is lost that the air is not known to lose, trains may have overrun the path, and none
leaves."""

PROBE_HOLDOFF = 0.6
"""No train leaves this soon after a pause, nor after the queue has become empty: others have only paused [s]."""

MEASURED_MEMORY = 2.0
"""The capacity is not assumed to be higher for this long after it was measured while the air was busy [s]."""

GROWTH_FACTOR = 1.05
"""Where the queue is empty because little is sent, the capacity is assumed to be this much higher with each report, as
otherwise an idle sender could never ramp up;"""

MAX_OFFERED_FACTOR, MAX_NOISY_FACTOR = 1.5, 1.3
"""up to this many times what was sent, and where noise may hide a short queue, up to this many,"""

MAX_MIN_RATE_FACTOR = 3.0
"""or this many times min_rate."""


class Limits(NamedTuple):
    """Bounds of the estimate [byte/s]."""
    min_rate: float = 0.1 * MBIT
    """A safe rate, sent when nothing is known."""
    start_rate: float = 0.5 * MBIT
    """Until the first report."""
    max_rate: float = 400 * MBIT

    def clamp(self, rate: float) -> float:
        """The rate between min_rate and max_rate."""
        return min(max(rate, self.min_rate), self.max_rate)


@dataclass
class Link:
    """What is known of the link."""
    capacity: float
    """[byte/s]"""
    queue_delay: float = 0.0
    """Predicted for when the present rate takes effect [s]."""
    round_trip: float = math.nan
    """The shortest in the last report; NaN: unknown [s]."""
    loss: float = 0.0
    """Ratio of datagrams lost lately."""


LIMITS = Limits()


def target_delay(rate: float) -> float:
    """Queueing delay to keep at a rate in byte/s [s]."""
    scaled = REFERENCE_TARGET * math.pow(REFERENCE_RATE / rate, TARGET_EXPONENT)
    return min(max(scaled, MIN_TARGET), MAX_TARGET)


class Estimator:
    """Estimates one link's capacity, and the rate to send at.

    :param now: by a steady clock [s]
    :param limits: bounds of capacity and rate
    """

    def __init__(self, now: float, limits: Limits = LIMITS) -> None:
        self.limits = limits
        self.link = Link(min(limits.start_rate, limits.max_rate))
        self.rate = self.link.capacity
        """What may be sent now, of all streams together [byte/s]."""
        self.timeouts = 0
        """How often no report came in time since the last one."""
        self._delay, self._loss, self._probes, self._probe_rtt = QueueDelay(), Loss(), ProbeController(), ProbeRtt()
        self._ceiling, self._competition = LossCeiling(), Competition()
        self._newest: Optional[PacketSample] = None
        self._reported = now            # when the last report came
        self._at_timeout = 0.0          # capacity at the first timeout since the last report [byte/s]
        self._before_timeout = 0.0      # capacity; less once it was measured to be less [byte/s]
        self._carried = 0.0             # lately, at most, over a report [byte/s]
        self._was_short = True          # whether the last report showed a short queue
        self._last_short = now          # when the queue was last near its target
        self._last_long = -math.inf     # when it was long
        self._occupied = -math.inf      # when it was last seen occupied
        self._back = -math.inf          # when reports came again after a timeout
        self._silence = 0.0             # of a timeout; 0 once a short queue, or the capacity, was seen after it [s]
        self._measured = -math.inf      # when it was last measured, by sending time; -inf: no longer believed

    def on_feedback(self, feedback: Feedback, now: float, wanted: float = math.inf,
                    wished: float = 0.0) -> Optional[ProbeTrain]:
        """Update the estimate.

        :param feedback: of a valid report
        :param now: by a steady clock [s]
        :param wanted: what the streams would send if the link had room for it [byte/s]
        :param wished: what the link should have so that what they send is as fresh as it can be [byte/s]
        :return: a train for the packet scheduler, if one is due
        """
        after_timeout = self.timeouts > 0
        if after_timeout:
            self._back, self._silence = now, now - self._reported
            self._ceiling.interrupt(now)
        self._reported, self.timeouts = now, 0
        if after_timeout or feedback.restarted:
            self._competition.end()
        if feedback.restarted:
            self._delay.base = self._newest = None
        if not feedback.samples:
            self._update_loss(feedback, False)
            self._set_rate(now)
            return None
        link, samples = self.link, feedback.samples
        chain = [self._newest, *samples] if self._newest else samples
        self._newest, link.round_trip = samples[-1], feedback.round_trip
        self._delay.update(samples, link.capacity, now)
        middle = typical(samples)
        queue = self._delay.of(middle)
        if self._compete(feedback, chain, queue, now):
            return self._competition.train(queue, self._target(), samples[-1].size, feedback.unreported, now)

        short = queue < self._target()
        paused = queue < LONG_QUEUE and self._probe_rtt.covers(chain[0].sent)
        offered = sending_rate(chain[0], chain[-1])
        relaxed = (short and self._was_short and not self._ceiling.checking and offered < max(
            min(RELAXED * link.capacity, PROVEN * self._carried), MAX_GAIN * self.limits.start_rate)
                   and not self._loss.exceeds_air(feedback.expected, feedback.lost))
        if feedback.expected:
            self._carried = max(CARRIED_MEMORY * self._carried, offered * feedback.received / feedback.expected)
        self._update_loss(feedback, relaxed or paused)
        self._was_short = short
        idle = (offered <= DRAIN_GAIN * link.capacity
                and samples[-1].total - chain[0].total <= REPORT_INTERVAL * self.limits.min_rate)
        if self._silence and (idle or queue < STANDING_FACTOR * self._target()):    # reports were lost like datagrams
            explained = idle or math.pow(feedback.loss, self._silence / REPORT_INTERVAL) > REPORT_LOSS_PROBABILITY
            link.capacity = max(link.capacity, self._before_timeout / (1.0 if explained else RECOVERY_FACTOR))
            self._silence = 0.0
        self._update_capacity(feedback, chain, queue)
        self._update_probe_rtt(samples, middle, idle, queue, now)
        self._find_ceiling(feedback, chain[0].sent, offered, queue, now)
        in_flight = feedback.unreported / link.capacity
        since_newest = now - samples[-1].sent - queue       # since the newest datagram was on the air
        link.queue_delay = max(0.0, in_flight - since_newest)
        self._set_rate(now)
        return (self._competition.train(queue, self._target(), samples[-1].size, feedback.unreported, now)
                or self._next_probe(samples, wanted, wished, feedback.unreported, now))

    def expect_more(self) -> None:
        """The link may carry more from now on: probe with the next report."""
        self._probes.retry()

    def poll(self, now: float, sent: float) -> None:
        """Lower the rate where reports fail to come: to be called each REPORT_INTERVAL.

        :param sent: lately, at most [byte/s]; where that is a safe rate, silence is no sign of congestion
        """
        loss = min(max(self.link.loss, REPORT_LOSS_PROBABILITY), MAX_AIR_LOSS)
        timeout = max(REPORT_TIMEOUT, REPORT_INTERVAL * math.log(REPORT_LOSS_PROBABILITY) / math.log(loss))
        missed = max(self.timeouts, math.ceil((now - self._reported) / timeout) - 1)
        if missed and not self.timeouts:
            self._at_timeout = self.link.capacity
            self._before_timeout = max(self._before_timeout, self._at_timeout)
        self.timeouts = missed
        if missed and sent > self.limits.min_rate:
            self._measured = -math.inf
            halved = max(math.ldexp(self._at_timeout, -missed), self.limits.min_rate)
            self.link.capacity = min(self.link.capacity, halved)
        self._set_rate(now)

    def _compete(self, feedback: Feedback, chain: List[PacketSample], queue: float, now: float) -> bool:
        """Whether a competitor fills the queue: then nothing else decides the rate."""
        link, competition = self.link, self._competition
        was, bottleneck = competition.active, competition.bottleneck
        cut = feedback.lost > self._loss.usual(feedback.expected)
        proof = competition.update(chain, queue, self._target(), self._delay.noise, self._delay.base,
                                   self._probe_rtt.draining_since(now), cut, self._loss, now)
        if proof and competition.floor is not None:     # what a drain left is a queue, not the path
            self._delay.set_base(competition.floor, now)
        if competition.active:
            if not was:
                self._ceiling.interrupt(now)
                self._probe_rtt.cancel()
                self._silence = 0.0
            self._update_loss(feedback, False)
            link.capacity, link.queue_delay = self.limits.clamp(competition.rate), queue
            self._set_rate(now)
        elif was:
            self._before_timeout = self.limits.clamp(bottleneck)
            self._last_short, self._measured = now, -math.inf
        return competition.active

    def _target(self) -> float:
        return target_delay(self.link.capacity) + self._delay.allowance

    def _empty(self, queue: float) -> bool:
        """Whether a queue [s] is shorter than half of what is wanted, apart from noise."""
        return queue < target_delay(self.link.capacity) / 2 + self._delay.allowance

    def _noisy(self, part: float) -> bool:
        """Whether noise hides this part of the queue that is wanted."""
        return self._delay.allowance >= part * target_delay(self.link.capacity)

    def _trust(self, queue: float) -> float:
        """How far a lower capacity is believed: at a short queue [s], less was offered, or jitter is taken for it."""
        if queue > self._target():
            return 1.0
        return 0.0 if self._empty(queue) or self._noisy(MAX_TRUSTED_NOISE) else 0.5

    def _update_loss(self, feedback: Feedback, uncongested: bool) -> None:
        self._loss.update(feedback, uncongested)
        self.link.loss = self._loss.recent

    def _update_capacity(self, feedback: Feedback, chain: List[PacketSample], queue: float) -> None:
        """Correct the capacity by how datagrams arrived.

        :param feedback: counts what was lost between these datagrams
        :param chain: the new samples after the newest known before
        :param queue: queueing delay of the report [s]
        """
        link = self.link
        waits = [self._delay.of(sample) for sample in chain]
        carried, busy = busy_period(chain, waits, self._delay.allowance, link.capacity)
        duration = chain[-1].arrived - chain[0].arrived
        if busy > duration / 4 and busy > 0.01:
            dropped = self._loss.beyond_air(feedback.loss) if queue > LONG_QUEUE else 0.0
            certainty = 1.0 if queue > LONG_QUEUE else (len(chain) - 1) / ENOUGH
            weight = min(1.0, 2 * busy / HORIZON, certainty)
            step = weight * (carried * (1 - dropped) / busy - link.capacity)
            if step < 0:
                step *= self._trust(queue)
            if not self._noisy(MAX_MEASURED_NOISE):
                self._measured, self._silence = chain[-1].sent, 0.0
            if step:
                link.capacity += step
                self._before_timeout = min(self._before_timeout, math.inf if step > 0 else link.capacity)
        if queue < LONG_QUEUE and not self._loss.excess:
            # what was sent beside a long queue was not all carried
            since = max((at + 1 for at, wait in enumerate(waits) if wait > LONG_QUEUE), default=0)
            cleared = chain[since:]
            ceiling = math.inf if busy < duration * 3 / 4 else MAX_PUSH_FACTOR * link.capacity
            peak = min(ceiling, peak_rate(cleared, waits[since:], self._delay.allowance))
            if peak > SUCCESS_FACTOR * link.capacity:       # the link has become wider: it was measured before that
                self._measured = -math.inf
            link.capacity = max(link.capacity, peak)
            self._delay.update_noise(cleared, link.capacity)
            if chain[-1].sent - self._measured > MEASURED_MEMORY:
                if queue < self._target() / 2:
                    self._grow(chain, MAX_OFFERED_FACTOR)
                elif feedback.loss <= self._loss.air and self._empty(queue):    # a queue of a few ms would drop
                    self._grow(chain, MAX_NOISY_FACTOR)
        link.capacity = self.limits.clamp(link.capacity)

    def _grow(self, chain: List[PacketSample], most: float) -> None:
        """Assume somewhat more capacity than is used, up to this many times what was sent."""
        link = self.link
        offered = sending_rate(chain[0], chain[-1])
        ceiling = max(MAX_MIN_RATE_FACTOR * self.limits.min_rate, most * offered)
        link.capacity = max(link.capacity, min(ceiling, link.capacity * GROWTH_FACTOR),
                            min(self._before_timeout, link.capacity * RECOVERY_GROWTH_FACTOR))

    def _update_probe_rtt(self, samples: List[PacketSample], middle: PacketSample, idle: bool, queue: float,
                          now: float) -> None:
        """End a pause and use what it measured; begin one where there is a reason. An idle sender needs none."""
        self._probe_rtt.on_sample(middle, queue, self._target(), self._delay, now)
        if queue < STANDING_FACTOR * self._target():
            self._last_short = now
        queue_long = queue > LONG_QUEUE or now - self._last_short > STANDING_TIME
        expired = self._delay.expired(now)
        if not idle:
            self._probe_rtt.begin(expired and not self._ceiling.checking, queue_long, now)
        elif expired:
            self._delay.raise_base(min(samples, key=lambda sample: sample.delay), MAX_BASE_STEP, now)

    def _find_ceiling(self, feedback: Feedback, since: float, offered: float, queue: float, now: float) -> None:
        """Find the rate above which datagrams are lost without a queue to be seen; what a long queue dropped is known
        from its delay, and an outage drops everything.

        :param since: when the first datagrams that the report counts were sent [s]
        :param offered: what was sent [byte/s]
        """
        if queue > LONG_QUEUE:
            self._last_long = now
        elif now - self._last_long < QUEUE_MEMORY or now - self._back < OUTAGE_MEMORY:
            self._loss.answered()
        elif not self._probe_rtt.active(now):
            self._ceiling.update(feedback, since, offered, self.rate, self._loss, now)
            self.link.capacity = self.limits.clamp(min(self.link.capacity, self._ceiling.known))
            self._before_timeout = min(self._before_timeout, self._ceiling.known)

    def _set_rate(self, now: float) -> None:
        link = self.link
        if self._competition.active:
            self.rate = self.limits.clamp(link.capacity * self._competition.gain)
            return
        lacking = self._target() - link.queue_delay if now - self._reported <= HORIZON else 0.0
        gain = min(max(1 + lacking / HORIZON, MIN_GAIN), MAX_GAIN)
        self.rate = self.limits.clamp(min(link.capacity * min(gain, self._probe_rtt.gain(now)), self._ceiling.rate))

    def _next_probe(self, samples: List[PacketSample], wanted: float, wished: float, unreported: int,
                    now: float) -> Optional[ProbeTrain]:
        bounded = self._ceiling.rate < math.inf or self._loss.excess > MAX_TRAIN_LOSS
        empty = self._empty(statistics.median(self._delay.of(sample) for sample in samples))
        if not empty:
            self._occupied = now
        emptied = empty and now - self._occupied < PROBE_HOLDOFF
        if self._probe_rtt.active(now - PROBE_HOLDOFF) or emptied or bounded:
            return None
        wished = min(wished, self.limits.max_rate)
        return self._probes.next(self.link.capacity, empty, wanted > self.rate, samples[-1], unreported, now,
                                 wished > self.rate)
