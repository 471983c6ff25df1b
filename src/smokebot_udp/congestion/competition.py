# SPDX-License-Identifier: BSD-3-Clause
"""A share of the link beside flows that keep its queue full, as TCP downloads do.

A delay-based control yields to them until nothing is left. So where one is there, the rate is a part of what the
bottleneck carries, whatever the delay; a download is elastic and takes the rest (two modes: Copa, Arun and
Balakrishnan, NSDI 2018; cross traffic measured by pulses: Nimbus, Goyal et al., SIGCOMM 2022).

* **Evidence**: in a drain (probe_rtt.py) all who react to the delay send little, and the queue gets shorter. Where it
  does not, a *test* is sent: a packet train, slower than the path has carried lately. A path that has only become
  longer carries it as it was sent. Where others share the bottleneck it arrives spread. That begins the mode.
* **What the bottleneck carries**: while it carries C and others send X, what is sent at a rate r within a time T
  arrives within T' = T (r + X) / C. A train and what was sent before it are two rates, which show both C and X. A link
  that has only become slower has X = 0. C is no more than the path has carried.
* **The end**: in the mode, too, less is sent from time to time, and a test renews the evidence or takes it back. Where
  the queue is empty, or much more is lost than the air loses, as beside too many others, the mode ends at once.

Limits: where more than 30 s pass before there is evidence, or the download was there first, C is not known.
"""
import collections
import math
import statistics
from typing import Deque, List, NamedTuple, Optional

from .feedback import PacketSample, sending_rate
from .loss import Loss
from .path import Observation
from .trains import OnTheWay, Train, TrainTracker

SHARE = 0.43
"""Part of what the bottleneck carries that is sent."""

MIN_SHARE = 0.28
"""Where loss reduces it to less the mode ends."""

SHARE_GROWTH = 0.05
"""After a reduction the share grows by this each second [1/s]."""

REDUCTION_INTERVAL = 1.0
"""It is reduced once in this time [s]."""

AIR_COUNT = 300
"""What the air lost before the competitor came weighs as much as this many datagrams."""

MIN_QUEUE = 0.012
"""A shorter queue is no competitor's [s]."""

MIN_STRETCH, STRETCH_TIME = 0.8, 0.08
"""A queue stays where what was sent in this time [s] takes at least this part of it to arrive."""

TEST_DURATION, MIN_PACKETS = 0.04, 5
"""A test takes this long [s], or less (DUE_TIME); a train has at least this number of datagrams."""

TEST_PART, MAX_TEST_GAIN = 0.75, 4.0
"""Its rate is this part of the highest rate that was carried, but at most this multiple of the present one; in the
mode, this part of what the bottleneck carries: much more than the share, as others' single datagrams spread it, too."""

DUE_TIME = 0.1
"""A test is no longer than what was carried in this time: streams do not have more to send at once [s]."""

MAX_TESTS = 2
"""Number of tests in one drain, at most."""

TRAIN_DURATION, TRAIN_INTERVAL = 0.02, 0.5
"""In the mode other trains are as fast as the bottleneck for this long, at this interval [s]."""

TRAIN_TIMEOUT = 1.0
"""A train that was not reported after this long is lost [s]."""

WINDOW = 0.3
"""A train is compared with what was sent in this time before it; the carried rate is measured over this time [s]."""

PEAK_LIFETIME = 30.0
"""The most that was carried is remembered for this long [s]."""

MIN_SPREAD = 0.002
"""A train that spreads by less may have met nobody [s]."""

MIN_OTHERS = 0.3
"""Part of the bottleneck that others use, at least, where there is a competitor."""

MAX_BOTTLENECK = 1.6
"""A train that shows a bottleneck of more than this multiple of the highest carried rate is no evidence."""

MEASURED = 5
"""Number of trains whose median bottleneck counts."""

EMPTY_TIME = 0.8
"""The queue is empty for this long: the competitor has ended. BBR's pause to measure the path is shorter [s]."""

SETTLING = 0.2
"""In a check of the mode, the test leaves this long after the check began [s]."""

CHECK_INTERVAL = 0.0, 1.0, 6.0
"""Time from the last evidence to the next check of the mode: without evidence, with it once, and several times [s]."""

RETRY_INTERVAL = 1.0
"""Time from the end of a drain or check to the next check of the mode, at least [s]."""

LIFETIME = 0.0, 8.0, 16.0
"""Time from the last evidence to the end of the mode: without evidence, with it once, and several times [s]."""

MAX_EVIDENCE = 2

HOLDOFF, LOSS_HOLDOFF = 2.5, 20.0
"""After a test that took the evidence back, and after too much loss, the mode does not begin for this long [s]."""


class _Seen(NamedTuple):
    """What a train shows."""
    bottleneck: float
    """What it carries for all [byte/s]; infinite: the train did not spread."""
    others: float
    """Part of it that others use."""


class _Carried(NamedTuple):
    """What one report shows of the path."""
    now: float
    rate: float
    """What the path carried [byte/s]."""
    air: float
    """Loss ratio that was attributed to the air."""


class Competition:
    """Whether a flow beside us fills the queue, and what is sent then."""

    def __init__(self) -> None:
        self.rate = math.inf
        """What is sent beside a competitor [byte/s]; infinite: there is none."""
        self.floor: Optional[PacketSample] = None
        """The sample of least delay when the drain that found the competitor began."""
        self._samples: Deque[PacketSample] = collections.deque()
        self._carried: Deque[_Carried] = collections.deque()
        self._evidence, self._proven = 0, -math.inf     # how often there was, at most MAX_EVIDENCE; when last [s]
        self._drain: Optional[float] = None     # since when less is sent [s]
        self._drained = -math.inf               # when the last check ended [s]
        self._test_rate = self._test_size = 0.0     # of this pause [byte/s], [byte]
        self._tests = 0                             # sent in it
        self._trains, self._testing = TrainTracker(), False     # whether the train on the way is a test
        self._next_train = -math.inf
        self._bottlenecks: Deque[float] = collections.deque(maxlen=MEASURED)
        self._limit = math.inf                  # of the bottleneck [byte/s]
        self._share, self._updated, self._reduced = SHARE, -math.inf, -math.inf
        self._occupied = -math.inf              # when the queue was last not empty [s]
        self._not_before = -math.inf            # the mode [s]

    @property
    def active(self) -> bool:
        """Whether there is a competitor."""
        return self.rate < math.inf

    @property
    def bottleneck(self) -> float:
        """What the bottleneck carries for all [byte/s]; 0: unknown."""
        return min(self._limit, statistics.median(self._bottlenecks)) if self._bottlenecks else 0.0

    def end(self) -> None:
        """There is no competitor, or it is not known."""
        self.rate, self._evidence, self._trains, self._drain = math.inf, 0, TrainTracker(), None
        self._bottlenecks.clear()
        self._samples.clear()

    def update(self, seen: Observation, short: float, base: Optional[PacketSample], pause: Optional[float],
               loss: Loss) -> bool:
        """Take a report.

        :param short: where the queue is shorter it is empty [s]
        :param base: the sample of least delay
        :param pause: since when a drain or a check is in progress [s]; None: there is none
        :param loss: lately
        :return: whether it is evidence of a competitor
        """
        now = seen.now
        self._remember(seen.chain, loss.air, now)
        self._follow_pause(pause, base, now)
        if seen.queue > short:
            self._occupied = now
        # where more is lost than the air loses, a train may have been cut off
        proof = self._take_train(seen.noise, seen.feedback.lost > loss.usual(seen.feedback.expected), now)
        begins = proof and not self.active
        if begins:
            self._begin(loss, now)
        elif self.active and not self._evidence:
            self._not_before = now + HOLDOFF
            self.end()
        elif self.active and (now - self._occupied > EMPTY_TIME or now - self._proven > LIFETIME[self._evidence]):
            self.end()
        if self.active or begins:
            self._set_rate(loss, now)
        return proof

    def check_due(self, now: float) -> bool:
        """Whether less is to be sent now, to see whether the competitor is still there."""
        return self.active and self._drain is None and now > max(
            self._drained + RETRY_INTERVAL, self._proven + CHECK_INTERVAL[self._evidence])

    @property
    def checked(self) -> bool:
        """Whether the test of a check was judged."""
        return self.active and self._tests > 0 and self._trains.on_the_way is None

    def train(self, seen: Observation, short: float) -> Optional[Train]:
        """The train that leaves now, if any.

        :param short: where the queue is shorter it is empty [s]
        """
        if self._trains.on_the_way is not None:
            return None
        now, size, testing = seen.now, seen.newest.size, self._drain is not None
        if testing:
            if (self._tests == MAX_TESTS or now < self._not_before or seen.queue < max(MIN_QUEUE, short)
                    or not self._has_stayed()):
                return None
            self._tests += 1
            rate, least = self._test_rate, self._test_size
        elif self.active and now >= self._next_train:
            self._next_train = now + TRAIN_INTERVAL
            rate, least = self.bottleneck, self.bottleneck * TRAIN_DURATION
        else:
            return None
        train, self._testing = Train(rate, max(MIN_PACKETS * size, least)), testing
        self._trains.leave(train, seen.newest, seen.feedback.unreported, now, TRAIN_TIMEOUT)
        return train

    def _remember(self, chain: List[PacketSample], air: float, now: float) -> None:
        self._samples.extend(one for one in chain if not self._samples or one.total > self._samples[-1].total)
        newest = self._samples[-1]
        while self._samples[0].sent < newest.sent - 2 * TRAIN_TIMEOUT:
            self._samples.popleft()
        first = next(one for one in self._samples if newest.sent - one.sent < WINDOW)
        duration = max(newest.sent - first.sent, newest.arrived - first.arrived, 1e-3)
        self._carried.append(_Carried(now, (newest.total - first.total) / duration, air))
        while self._carried[0].now < now - PEAK_LIFETIME:
            self._carried.popleft()

    def _peak(self) -> float:
        """The most that was carried [byte/s]."""
        return max(one.rate for one in self._carried)

    def _follow_pause(self, pause: Optional[float], base: Optional[PacketSample], now: float) -> None:
        """Notice that a pause began or ended."""
        if pause is None and self._drain is not None:
            self._drained = now
        if pause is not None and pause != self._drain:
            self._tests, carried = 0, self._carried[-1].rate
            if self.active:
                self._test_rate = TEST_PART * self.bottleneck
            else:
                self._test_rate = min(TEST_PART * self._peak(), MAX_TEST_GAIN * carried)
                self.floor = base
            self._test_size = min(TEST_DURATION * self._test_rate, DUE_TIME * carried)
        self._drain = pause

    def _has_stayed(self) -> bool:
        """Whether the queue does not get shorter in this drain."""
        assert self._drain is not None
        within = [sample for sample in self._samples if sample.sent >= self._drain]
        if not within or self.active:
            return bool(within) and within[-1].sent > self._drain + SETTLING
        return within[-1].sent - within[0].sent > STRETCH_TIME and _stretch(within[0], within[-1]) > MIN_STRETCH

    def _take_train(self, noise: float, cut: bool, now: float) -> bool:
        """Judge a train that was reported; return whether it is evidence."""
        whole = not cut and self._trains.arrived(self._samples[-1])
        train = self._trains.ended(self._samples[-1], now, cut)
        if train is None or not whole:
            return False
        seen = self._judge(train, noise)
        if seen is None:
            return False
        most = MAX_BOTTLENECK * (self._limit if self.active else self._peak())
        competes = seen.others > MIN_OTHERS and seen.bottleneck < most
        if competes or self.active and seen.bottleneck < math.inf:
            self._bottlenecks.append(seen.bottleneck)
        if self._testing and competes:
            self._evidence, self._proven = min(MAX_EVIDENCE, self._evidence + 1), now
        elif self._testing:
            self._evidence = max(0, self._evidence - 1)
        return self._testing and competes

    def _judge(self, train: OnTheWay, noise: float) -> Optional[_Seen]:
        """What a train shows; None: too little of it arrived."""
        during = [sample for sample in self._samples if train.begins < sample.total <= train.ends]
        if len(during) < 2:
            return None
        since = during[0].sent - WINDOW
        if self._testing and self._drain is not None:
            since = max(since, self._drain + (SETTLING / 2 if self.active else 0.0))
        before = [sample for sample in self._samples if sample.total <= train.begins and sample.sent > since]
        if len(before) < 2:
            return None
        usual, fast = sending_rate(before[0], during[0]), sending_rate(during[0], during[-1])
        stretch, stretched = _stretch(before[0], during[0]), _stretch(during[0], during[-1])
        spread = (stretched - stretch) * (during[-1].sent - during[0].sent)
        if spread < MIN_SPREAD + noise or fast <= usual:
            return _Seen(math.inf, 0.0)
        bottleneck = (fast - usual) / (stretched - stretch)
        return _Seen(bottleneck, stretch - usual / bottleneck)

    def _begin(self, loss: Loss, now: float) -> None:
        self._share, self._reduced, self._updated, self._next_train = SHARE, now, now, now
        self._drain = None      # another test so soon after this one would show little
        self._limit = self._peak()
        # what was lost beside the competitor the air did not lose
        loss.set_air(AIR_COUNT, round(AIR_COUNT * min(one.air for one in self._carried)))
        loss.answered()

    def _set_rate(self, loss: Loss, now: float) -> None:
        """Set the rate; end the mode where too much is lost."""
        excess = loss.excess
        if excess and now - self._reduced > REDUCTION_INTERVAL:
            self._share, self._reduced = self._share * (1 - excess), now
            loss.answered()
            if self._share < MIN_SHARE:
                self._not_before = now + LOSS_HOLDOFF
                self.end()
                return
        elif not excess:
            self._share = min(SHARE, self._share + SHARE_GROWTH * (now - self._updated))
        self._updated = now
        self.rate = self._share * self.bottleneck


def _stretch(first: PacketSample, last: PacketSample) -> float:
    """How much longer it took to arrive than to send."""
    return (last.arrived - first.arrived) / max(last.sent - first.sent, 1e-4)
