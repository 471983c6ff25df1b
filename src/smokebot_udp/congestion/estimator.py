# SPDX-License-Identifier: BSD-3-Clause
"""The byte rate that the link carries now, from delivery rate and queueing delay.

A report is first made an Observation (path.py), then the mode follows by the table TRANSITIONS at the end of this file,
then capacity, loss and rate are updated as the mode has it. The parts:

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
* **How sure the capacity is** (capacity.py): measurements while the air was busy are averaged by their errors, and one
  that contradicts what is known counts at once (a Kalman filter).
* **A token bucket on the path** (shaper.py): it lets short trains pass at the line's speed. Its depth is learnt, and
  what it may have let pass at once is no rate. What it lets pass also leaves at once.
* **The base delay, measured again** (BBR's ProbeRTT; LEDBAT++'s slowdowns; pause.py): where nothing confirmed it for 5
  s, or for 2 s where noise may have made it short, the rate dips shortly. A queue that has become long is drained by
  all who share the air at the same time, as all see it, and all learn the true base delay then; that corrects a late
  starter who took the queue for the path. What a drain leaves of the delay is the path itself, which has become longer.
* **Packet trains** (trains.py): where the queue is empty and more is wanted, some datagrams that are due anyway leave 2
  to 4 times faster. They find a link that has become 60 times wider within 2 s, at the cost of a few ms of queue when
  it has not. Noise of delays counts neither as a queue nor against an empty one, up to 10 ms; what one's own datagrams
  wait for each other is no noise.
* **No reaction to loss as such** (unlike GCC's loss-based half, and TCP): on a lossy air the loss ratio says nothing
  about the rate, because lost datagrams use air time, too. More loss than before is a reason to check: as much less is
  sent for a moment as was lost. What is lost then the air loses (loss.py); otherwise a policer or a queue too short to
  be seen drops datagrams, and the rate stays below what it lets pass (loss_ceiling.py).
* **Marks** (ECN, RFC 3168): half of the share of marked datagrams is sent less (DCTCP, RFC 8257).
* **Beside a flow that fills the queue regardless of others**, as a TCP download does, a delay-based control would yield
  until nothing is left. There a part of what the bottleneck carries is sent (competition.py).

Limits: where the air begins to lose nearly everything at once, including reports, the rate falls for some seconds; and
much jitter looks like a queue.
"""
import enum
import math
import statistics
from dataclasses import dataclass
from typing import Any, Callable, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..units import MBIT
from .capacity import Capacity
from .competition import Competition
from .feedback import Feedback
from .loss import MAX_AIR_LOSS, Loss
from .loss_ceiling import LossCeiling
from .path import Observation, Path
from .pause import CHECK, DIP, DRAIN, FIRST, MAX_BASE_STEP, Pause
from .trains import ProbeController, Train

REFERENCE_TARGET = 0.005
"""Queueing delay to keep at REFERENCE_RATE [s]."""

REFERENCE_RATE = 20 * MBIT
"""Rate at which the queueing delay to keep is REFERENCE_TARGET [byte/s]."""

TARGET_EXPONENT = 1 / 3
"""The queueing delay to keep scales with this power of REFERENCE_RATE / rate."""

MIN_TARGET, MAX_TARGET = 0.005, 0.04
"""Bounds of the queueing delay to keep [s]."""

HORIZON = 0.2
"""The difference between queue and target is corrected over this time, and no longer without a report [s]."""

MIN_GAIN, MAX_GAIN = 0.5, 1.1
"""Rate in capacities, at least and at most."""

MAX_TRUSTED_NOISE = 0.5
"""Where noise hides more than this part of the queue that is wanted, a short queue shows no lower capacity."""

RELAXED, PROVEN = 0.7, 1.1
"""Where less than this part of the capacity is sent, and no more than was carried lately, by this factor, or not more
than start_rate, and no queue shows, what is lost the air loses. Trains alone prove no capacity: a policer lets them
pass."""

CARRIED_MEMORY = 0.99
"""With each report what was carried lately counts for this part of before."""

DOUBTFUL_COUNT, DOUBTFUL_LOSS, DOUBTFUL_RATE = 3, 0.25, 2.0
"""The first delays may be those of a full queue where DOUBTFUL_COUNT datagrams and the part DOUBTFUL_LOSS were lost
before any pause, and the capacity is at most DOUBTFUL_RATE start_rates. At 0.3 Mbit/s 40 % of start_rate are lost; with
0.1 instead of 0.25 links that lose 20 % missed a bound of test_simulated_air.py [1, 1, 1]."""

QUEUE_MEMORY = 0.5
"""A queue that was long dropped what is lost until this long after [s]."""

OUTAGE_MEMORY = 1.5
"""What was lost while the link was away is reported for this long after it: by each stream with its next datagram
[s]."""

REPORT_INTERVAL = 0.1
"""Reports are sent, and the estimator is polled, this often [s]."""

REPORT_TIMEOUT = 0.5
"""The rate is halved each time no report came for this long, where more than min_rate is sent [s]."""

STALL = 2 * REPORT_INTERVAL
"""A node that polls later than this stood still, as others had the processor: reports that came meanwhile are read only
now, so that time is no silence [s]."""

REPORT_LOSS_PROBABILITY = 0.01
"""Reports are lost like datagrams: the timeout is longer where losing all of them is more probable than this."""

RECOVERY_FACTOR = 2.0
"""When reports return after a timeout and show no long queue, the capacity is what it was before, divided by this
factor. It is not divided where hardly anything was sent, or where the loss of datagrams explains that of the
reports."""

RECOVERY_GROWTH_FACTOR = 1.2
"""After a timeout the capacity grows by this factor with each report that shows no queue, until it is what it was
before the timeout, or is measured."""

MARK_WEIGHT = 0.25
"""Weight of the newest report in the share of datagrams that congested queues marked; half of this share is sent less
(DCTCP, RFC 8257)."""

MAX_MARKED = 0.05
"""No train leaves where more than this share is marked."""

STANDING_FACTOR, STANDING_TIME = 1.5, 1.0
"""A queue longer than this many targets for this long is drained, too: less is sent all the time, so it is the path
rather than a queue [1, s]."""

IDLE = 0.25
"""A sender is idle where it sends this part of the capacity at most, and no more than min_rate."""

MAX_TRAIN_LOSS = 0.5
"""Where more than this part is lost that the air is not known to lose, trains may have overrun the path, and none
leaves."""

PROBE_HOLDOFF = 0.6
"""No train leaves this soon after a pause, nor after the queue has become empty: others have only paused [s]."""


class Mode(enum.Enum):
    """What the sender does; TRANSITIONS has when it changes."""
    FOLLOW = 'sends what the path carries, and keeps a queue of a few ms'
    DIP = 'sends less for a moment, to measure the base delay'
    DRAIN = 'sends much less, until a long queue is gone'
    FIRST = 'sends much less, until the delay no longer falls'
    COMPETE = 'sends its part beside a flow that fills the queue'
    SILENT = 'halves its rate repeatedly, as no reports come'


class Limits(NamedTuple):
    """Bounds of the estimate [byte/s]."""
    min_rate: float = 0.1 * MBIT
    """A safe rate, sent when nothing is known."""
    start_rate: float = 0.5 * MBIT
    """Rate until the first report."""
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
        self._capacity = Capacity(min(limits.start_rate, limits.max_rate))
        self.link = Link(self._capacity.value)
        self.rate = self.link.capacity
        """What may be sent now, of all streams together [byte/s]."""
        self.timeouts = 0
        """How often no report came in time since the last one."""
        self.mode = Mode.FOLLOW
        self._path, self._loss, self._probes, self._pause = Path(), Loss(), ProbeController(), Pause()
        self._ceiling, self._competition = LossCeiling(), Competition()
        self._reported = self._polled = now     # when the last report came, and poll was called
        self._at_timeout = 0.0          # capacity at the first timeout since the last report [byte/s]
        self._before_timeout = 0.0      # capacity; less once it was measured to be less [byte/s]
        self._silence = 0.0             # of a timeout; 0 once a short queue, or the capacity, was seen after it [s]
        self._marked = 0.0              # share of the datagrams that congested queues marked, smoothed
        self._carried = 0.0             # lately, at most, over a report [byte/s]
        self._was_short = True          # whether the last report showed a short queue
        self._last_short = now          # when the queue was last near its target
        self._last_long = -math.inf     # when it was long
        self._occupied = -math.inf      # when it was last seen occupied
        self._back = -math.inf          # when reports came again after a timeout

    def on_feedback(self, feedback: Feedback, now: float, wanted: float = math.inf,
                    wished: float = 0.0) -> Optional[Train]:
        """Update the estimate.

        :param feedback: of a valid report
        :param now: by a steady clock [s]
        :param wanted: what the streams would send if the link had room for it [byte/s]
        :param wished: what the link should have so that what they send is as fresh as it can be [byte/s]
        :return: a train for the packet scheduler, if one is due
        """
        if not (feedback.samples or feedback.restarted) and feedback.unreported > REPORT_TIMEOUT * self.limits.min_rate:
            self._update_loss(feedback, False)      # of all that was sent nothing has come: as if no report had
            return None
        if self.mode is Mode.SILENT:
            self._back, self._silence = now, now - self._reported
            self._ceiling.interrupt(now)
        if self.mode is Mode.SILENT or feedback.restarted:
            self._competition.end()
            self._enter(Mode.FOLLOW, now)
        self._reported, self.timeouts = now, 0
        if not feedback.samples:
            self._update_loss(feedback, False)
            self._set_rate(now)
            return None
        self.link.round_trip = feedback.round_trip
        seen = self._path.observe(feedback, self.link.capacity, now)
        self._transit(seen)
        if self.mode is Mode.COMPETE:
            return self._learn_beside_competitor(seen)
        return self._learn(seen) or self._next_probe(seen, wanted, min(wished, self.limits.max_rate))

    def expect_more(self) -> None:
        """The link may carry more from now on: probe with the next report."""
        self._probes.retry()

    def on_return(self, now: float) -> None:
        """The receiver was away: its silence says nothing about the path. As for a new one the rate is start_rate, or
        what the path carried before if that is less."""
        if self.timeouts:
            self._set_capacity(max(self.link.capacity, min(self.limits.start_rate, self._before_timeout)))
            self._reported, self.timeouts = now, 0
            self._set_rate(now)

    def planned(self, budget: float, total: float) -> float:
        """For what multiple streams are planned now, so that a train has enough to send.

        :param budget: what they are planned for without it [byte/s]
        :param total: bytes of all streams sent so far
        """
        return self._probes.planned(budget, total)

    @property
    def base_delay(self) -> Optional[float]:
        """The least delay of a short datagram, by the receiver's clock minus the sender's; None: unknown [s]."""
        base = self._path.delay.base
        return None if base is None else base.delay - base.size / self.link.capacity

    @property
    def depth(self) -> float:
        """Depth of a token bucket on the path; 0: none is known [byte]."""
        return self._path.shaper.depth

    @property
    def has_deep_bucket(self) -> bool:
        """Whether the path has a token bucket that matters to when images leave."""
        return self._path.shaper.is_deep(self.link.capacity)

    def tokens(self, total: float, now: float) -> Tuple[float, float]:
        """(depth of a token bucket on the path, tokens that are missing in it now) [byte].

        :param total: bytes sent so far
        """
        return self._path.shaper.tokens(self.link.capacity, total, now)

    def poll(self, now: float, sent: float) -> None:
        """Lower the rate where reports fail to come: to be called each REPORT_INTERVAL.

        :param sent: lately, at most [byte/s]; where that is a safe rate, silence is no sign of congestion
        """
        self._reported = min(now, self._reported + max(0.0, now - self._polled - STALL))
        self._polled = now
        loss = min(max(self.link.loss, REPORT_LOSS_PROBABILITY), MAX_AIR_LOSS)
        timeout = max(REPORT_TIMEOUT, REPORT_INTERVAL * math.log(REPORT_LOSS_PROBABILITY) / math.log(loss))
        missed = max(self.timeouts, math.ceil((now - self._reported) / timeout) - 1)
        if missed and not self.timeouts:
            self._at_timeout = self.link.capacity
            self._before_timeout = max(self._before_timeout, self._at_timeout)
            self.mode = Mode.SILENT
        self.timeouts = missed
        if missed and sent > self.limits.min_rate:
            self._capacity.forget()
            self._set_capacity(min(self.link.capacity, math.ldexp(self._at_timeout, -missed)))
        self._set_rate(now)

    # -- modes --------------------------------------------------------------------------------------

    def _transit(self, seen: Observation) -> None:
        """Look for a competitor, and at what a pause measured; then go by the table."""
        delay, now = self._path.delay, seen.now
        proof = self._competition.update(seen, self._target(), delay.base, self._pause.since(now), self._loss)
        if proof and self._competition.floor is not None:   # what a drain left is a queue, not the path
            delay.set_base(self._competition.floor, now)
        if self.mode is not Mode.COMPETE:
            self._pause.on_sample(seen.sample, seen.queue, self._target(), delay, now)
        if seen.queue < STANDING_FACTOR * self._target():
            self._last_short = now
        mode = next((mode for happens, mode in TRANSITIONS[self.mode] if happens(self, seen)), self.mode)
        if mode is not self.mode:
            self._enter(mode, now)

    def _enter(self, mode: Mode, now: float) -> None:
        if mode in PAUSES:
            self._pause.begin(PAUSES[mode], now)
        if mode is Mode.COMPETE:
            self._ceiling.interrupt(now)
            self._pause.cancel()
            self._silence = 0.0
        elif self.mode is Mode.COMPETE:
            self._before_timeout = self.limits.clamp(self._competition.bottleneck)
            self._last_short = now
            self._capacity.forget()
        self.mode = mode

    def competes(self, _: Observation) -> bool:
        """Whether a flow beside us fills the queue."""
        return self._competition.active

    def is_alone(self, _: Observation) -> bool:
        """Whether none does."""
        return not self._competition.active

    def is_queue_long(self, seen: Observation) -> bool:
        """Whether the queue is to be drained: it is long, or has been longer than wanted for some time."""
        return (seen.is_long or seen.now - self._last_short > STANDING_TIME) and not self._idle(seen)

    def is_base_doubtful(self, _: Observation) -> bool:
        """Whether much is lost at the first rates, before any pause: the delays so far may be those of a full queue."""
        return (not self._pause.ever and self._loss.lost >= DOUBTFUL_COUNT and self._loss.recent > DOUBTFUL_LOSS
                and self.link.capacity <= DOUBTFUL_RATE * self.limits.start_rate)

    def is_base_old(self, seen: Observation) -> bool:
        """Whether the base delay is to be measured again. An idle sender needs no pause for that."""
        return self._path.delay.expired(seen.now) and not self._ceiling.checking and not self._idle(seen)

    def is_pause_over(self, seen: Observation) -> bool:
        """Whether the dip or drain has ended."""
        return not self._pause.active(seen.now)

    # -- what reports show --------------------------------------------------------------------------

    def _learn_beside_competitor(self, seen: Observation) -> Optional[Train]:
        """A part of what the bottleneck carries is sent; now and then less, to see whether the competitor is there."""
        self._update_loss(seen.feedback, False)
        self._set_capacity(self._competition.rate)
        self.link.queue_delay = seen.queue
        if self._competition.check_due(seen.now):
            self._pause.begin(CHECK, seen.now)
        elif self._competition.checked:
            self._pause.cancel()
        self._set_rate(seen.now)
        return self._competition.train(seen, self._target())

    def _learn(self, seen: Observation) -> Optional[Train]:
        """Follow what the path carries and loses."""
        feedback, now, short = seen.feedback, seen.now, seen.queue < self._target()
        self._update_loss(feedback, self._shows_air_loss(seen, short))
        if feedback.expected:
            self._carried = max(CARRIED_MEMORY * self._carried, seen.offered * feedback.received / feedback.expected)
        self._was_short = short
        self._recover(seen)
        self._update_capacity(seen)
        if self._idle(seen) and self._path.delay.expired(now):
            least = min(feedback.samples, key=lambda sample: sample.delay)
            self._path.delay.raise_base(least, MAX_BASE_STEP, now)
        self._find_ceiling(seen)
        in_flight = (feedback.unreported - self._path.shaper.left) / self.link.capacity
        since_newest = now - seen.newest.sent - seen.queue      # since the newest datagram was on the air
        self.link.queue_delay = max(0.0, in_flight - since_newest)
        self._set_rate(now)
        return self._competition.train(seen, self._target())

    def _idle(self, seen: Observation) -> bool:
        """Whether so little is sent that it congests nothing."""
        return (seen.offered <= IDLE * self.link.capacity
                and seen.newest.total - seen.chain[0].total <= REPORT_INTERVAL * self.limits.min_rate)

    def _shows_air_loss(self, seen: Observation, short: bool) -> bool:
        """Whether what was lost the air lost: so little was sent that nothing else can have."""
        if not seen.is_long and self._pause.covers(seen.chain[0].sent):
            return True
        proven = max(min(RELAXED * self.link.capacity, PROVEN * self._carried), MAX_GAIN * self.limits.start_rate)
        return (short and self._was_short and not self._ceiling.checking and seen.offered < proven
                and not self._loss.exceeds_air(seen.feedback.expected, seen.feedback.lost))

    def _target(self) -> float:
        return target_delay(self.link.capacity) + self._path.delay.allowance

    def _empty(self, queue: float) -> bool:
        """Whether a queue [s] is shorter than half of what is wanted, apart from noise."""
        return queue < target_delay(self.link.capacity) / 2 + self._path.delay.allowance

    def _trust(self, seen: Observation) -> float:
        """How far a lower capacity is believed: at a short queue, less was offered, or jitter is taken for it. A token
        bucket lets most datagrams pass at once: where there is one, the longest wait in a report is the queue."""
        longest = max(seen.waits) if self.depth else seen.queue
        if longest > self._target():
            return 1.0
        noisy = self._path.delay.allowance >= MAX_TRUSTED_NOISE * target_delay(self.link.capacity)
        return 0.0 if self._empty(longest) or noisy else 0.5

    def _update_loss(self, feedback: Feedback, uncongested: bool) -> None:
        if feedback.received:
            self._marked += MARK_WEIGHT * (min(1.0, feedback.marked / feedback.received) - self._marked)
        self._loss.update(feedback, uncongested)
        self.link.loss = self._loss.recent

    def _recover(self, seen: Observation) -> None:
        """After a timeout, believe again in what the link carried before, as reports are lost like datagrams."""
        idle = self._idle(seen)
        if self._silence and (idle or seen.queue < STANDING_FACTOR * self._target()):
            chance = math.pow(seen.feedback.loss, self._silence / REPORT_INTERVAL)
            explained = idle or chance > REPORT_LOSS_PROBABILITY
            self._set_capacity(max(self.link.capacity, self._before_timeout / (1.0 if explained else RECOVERY_FACTOR)))
            self._silence = 0.0
        elif self._before_timeout > self.link.capacity and self._empty(seen.queue) and not self._loss.excess:
            self._set_capacity(min(self._before_timeout, RECOVERY_GROWTH_FACTOR * self.link.capacity))

    def _update_capacity(self, seen: Observation) -> None:
        """Correct the capacity by how datagrams arrived."""
        if seen.carried:
            dropped = self._loss.beyond_air(seen.feedback.loss) if seen.was_long else 0.0
            measured, noise = seen.carried * (1 - dropped), self._path.delay.noise
            self._capacity.measure(measured, seen.busy, len(seen.chain), noise, self._trust(seen), seen.newest.sent)
            self._path.shaper.learn(measured, self._capacity.spread)
            self._before_timeout, self._silence = min(self._before_timeout, self._capacity.value), 0.0
        elif self._empty(seen.queue):
            self._capacity.recall(seen.newest.sent)
        if not seen.is_long and not self._loss.excess:
            self._capacity.carries(min(seen.bound, self._probes.most(self.depth) if self.has_deep_bucket else math.inf))
        self._set_capacity(self._capacity.value)

    def _find_ceiling(self, seen: Observation) -> None:
        """Find the rate above which datagrams are lost without a queue to be seen; what a long queue dropped is known
        from its delay, and an outage drops everything."""
        now = seen.now
        if seen.is_long:
            self._last_long = now
        elif now - self._last_long < QUEUE_MEMORY or now - self._back < OUTAGE_MEMORY:
            self._loss.answered()
        elif not self._pause.active(now):
            self._ceiling.update(seen.feedback, seen.chain[0].sent, seen.offered, self.rate, self._loss, now)
            self._set_capacity(min(self.link.capacity, self._ceiling.known))
            self._before_timeout = min(self._before_timeout, self._ceiling.known)

    def _set_capacity(self, capacity: float) -> None:
        self.link.capacity = self._capacity.value = self.limits.clamp(capacity)

    def _set_rate(self, now: float) -> None:
        """The rate: beside a competitor its part, else what corrects the queue within HORIZON; less in a pause."""
        gain = self._pause.gain(now)
        if self.mode is not Mode.COMPETE:
            lacking = self._target() - self.link.queue_delay if now - self._reported <= HORIZON else 0.0
            follow = min(max(1 + lacking / HORIZON, MIN_GAIN), MAX_GAIN)
            gain = min(follow * (1 - self._marked / 2), gain if gain < 1 else math.inf)
        self.rate = self.limits.clamp(min(self.link.capacity * gain, self._ceiling.rate))

    def _next_probe(self, seen: Observation, wanted: float, wished: float) -> Optional[Train]:
        now = seen.now
        bounded = (self._ceiling.rate < math.inf or self._loss.excess > MAX_TRAIN_LOSS
                   or self._marked > MAX_MARKED)
        empty = self._empty(statistics.median(self._path.delay.of(sample) for sample in seen.feedback.samples))
        if not empty:
            self._occupied = now
        emptied = empty and now - self._occupied < PROBE_HOLDOFF
        if self._pause.active(now - PROBE_HOLDOFF) or emptied or bounded:
            return None
        return self._probes.next(seen, self.link.capacity, self.depth, self._path.shaper.is_sure, empty,
                                 wanted > self.rate, wished > self.rate)


Event = Callable[[Estimator, Observation], bool]

PAUSES: Mapping[Mode, Any] = {Mode.DIP: DIP, Mode.DRAIN: DRAIN, Mode.FIRST: FIRST}

TRANSITIONS: Mapping[Mode, Sequence[Tuple[Event, Mode]]] = {
    Mode.FOLLOW: [(Estimator.competes, Mode.COMPETE), (Estimator.is_queue_long, Mode.DRAIN),
                  (Estimator.is_base_doubtful, Mode.FIRST), (Estimator.is_base_old, Mode.DIP)],
    Mode.DIP: [(Estimator.competes, Mode.COMPETE), (Estimator.is_pause_over, Mode.FOLLOW)],
    Mode.DRAIN: [(Estimator.competes, Mode.COMPETE), (Estimator.is_pause_over, Mode.FOLLOW)],
    Mode.FIRST: [(Estimator.competes, Mode.COMPETE), (Estimator.is_pause_over, Mode.FOLLOW)],
    Mode.COMPETE: [(Estimator.is_alone, Mode.FOLLOW)],
}
"""{mode: [(what a report shows, mode then), ...]}: the first that holds counts. Without reports any becomes SILENT; the
first report after that makes it FOLLOW."""
