# SPDX-License-Identifier: BSD-3-Clause
"""A token bucket on the path, as the kernel's tbf: how much passes at once, however slow the path is.

A shaper of rate r and depth b lets b + r T pass in a window T (its arrival curve: Le Boudec, Thiran: "Network
Calculus", Springer 2001). A short train passes at the line's speed, and shows nothing about r before it exceeds the
tokens. The depth is learnt where a queue begins: it is the most that was sent until then beyond r T, less the queue.
"""
import collections
import math
import statistics
from typing import Deque, List, NamedTuple, Optional, Tuple

from .feedback import PacketSample

HISTORY = 3.0
"""Datagrams that have passed since a queue was last seen are remembered for this long [s]."""

THINNED = 0.03
"""At most two of the remembered datagrams are this close together, the first and the last in this time [s]."""

MAX_DEPTH = 65536.0
"""More that was sent beyond the rate shows that the rate has changed: Linux and routers are set to less [byte]."""

MIN_DURATION = 0.02
"""A bucket is deep where it lets pass at once more than the path carries in this time [s]."""

MAX_DURATION = 0.12
"""What passes at once is thought to be no more than the path carries in this time, as a mistake becomes a queue [s]."""

QUEUES, AGREE = 12, 2
"""The depth is the greatest that AGREE of the last QUEUES queues have shown. A queue that begins while the bucket is
not full shows a smaller one. Where there is no bucket, jitter or the pauses of others delay a queue now and then, which
shows one: a single queue is not enough. In experiments supervisor_simulation 98 % of 5 Mbit/s are used beside jitter of
10 ms instead of 87, and the queue has 18 ms instead of 40. With three to agree a link whose receiver pauses is believed
to be more than twice as fast for 6 % of the time."""

DATAGRAMS = 1.1
"""A bucket is deeper than this many of the datagrams that passed before the queue."""

SAME_RATE, RATES = 0.3, 3
"""The path has changed where the median of the last RATES measured rates differs by this part from the rate at which
depths are learnt. The present queue began at the old rate, and shows no depth. The depth that was known while rates
agreed with that one counts as if AGREE queues had shown it: it is a number of bytes, which tbf keeps while its rate
changes. What queues showed since they did not is no depth, but what the path carried beyond the old rate [1, 1]."""

ALIKE, SURE = 0.75, 4
"""A depth counts as sure if at least half of the last QUEUES queues, and at least SURE of them, have shown this part of
it or more. Where there is no bucket, they show depths that differ [1, 1]."""

SPENDS = 0.25
"""Where this part of the datagrams of a report met no queue, they spent tokens, or nothing else fills the queue."""


class Passed(NamedTuple):
    """A datagram that passed the path."""
    sample: PacketSample
    wait: float
    """Queueing delay [s]."""
    tokens: float
    """What could pass at once after it [byte]."""


class Shaper:
    """The depth and the tokens of a token bucket on the path, if there is one."""

    def __init__(self) -> None:
        self.depth = 0.0
        """0: no bucket is known [byte]."""
        self.level = 0.0
        """Tokens that are missing after the newest sample; more than `depth`: a queue waits for them [byte]."""
        self._newest: Optional[PacketSample] = None
        self._clear: Deque[Passed] = collections.deque()    # since a queue was seen last
        self._onset: Optional[Passed] = None                # where the present queue began,
        self._before: List[Passed] = []                     # what passed since the queue before it,
        self._spends = False                                # whether datagrams of the last report spent tokens
        self._depths: Deque[float] = collections.deque(maxlen=QUEUES)
        self._rates: Deque[float] = collections.deque(maxlen=RATES)     # measured last,
        self._rate = 0.0                                                # and since when depths are learnt [byte/s]
        self._settled = 0.0                                 # the depth when one was measured last that agreed
        self._learnt: Optional[PacketSample] = None         # beginning of the queue that the last one is of
        self._full = self._was_full = False                 # whether the bucket was full since a queue, and then

    def restart(self) -> None:
        """The receiver's clock restarted: samples before and after are not comparable."""
        self._clear.clear()
        self._onset = self._newest = None

    def follow(self, chain: List[PacketSample], waits: List[float], rate: float, noise: float) -> List[Passed]:
        """Follow the bucket.

        :param chain: samples in sending order, after the newest one known before
        :param waits: queueing delay of each [s]
        :param rate: of the path, as known [byte/s]
        :param noise: shorter waits are no queue [s]
        :return: these, after those of earlier reports since which no queue was seen
        """
        known = [] if waits[0] > noise else [one for one in self._clear if one.sample.sent < chain[0].sent]
        self._newest = chain[-1]
        clear = sum(wait <= noise for wait in waits)
        self._spends = clear >= SPENDS * len(waits)
        passed = [self._pass(before, sample, wait, rate, noise)
                  for before, sample, wait in zip([chain[0], *chain], chain, waits)]
        return known + passed

    def _pass(self, before: PacketSample, sample: PacketSample, wait: float, rate: float, noise: float) -> Passed:
        if sample is not before:
            # no sample says when other bytes between the two left: they count as sent evenly
            since = sample.total - before.total
            together = min(max(sample.size, sample.together), since)
            self.level = max(0.0, self.level + since - together - rate * (sample.sent - before.sent))
            self._full |= self.level == 0
            self.level += together
        if wait > noise:
            self.level = self.depth + wait * rate
            if self._onset is None and self._clear:
                self._onset = Passed(sample, wait, 0.0)
                self._before, self._was_full = list(self._clear), self._full
                if self.depth and self._is_same(rate):
                    self._note_depth(self._rate, self._rate)
            self._clear.clear()
            self._full = False
        else:
            self.level, self._onset = min(self.level, self.depth), None
        passed = Passed(sample, wait, max(0.0, self.depth - self.level))
        if wait <= noise:
            if len(self._clear) > 1 and sample.sent < self._clear[-2].sample.sent + THINNED:
                self._clear.pop()
            self._clear.append(passed)
            while self._clear[0].sample.sent < sample.sent - HISTORY:
                self._clear.popleft()
        return passed

    def is_deep(self, rate: float) -> bool:
        """Whether the bucket lets pass at once what the path carries in MIN_DURATION at a rate [byte/s]."""
        return self.depth > MIN_DURATION * rate

    @property
    def is_sure(self) -> bool:
        """Whether there is a bucket for sure: jitter, or the queue of others, shows depths that differ."""
        return self._settled > 0

    @property
    def left(self) -> float:
        """Tokens after the newest sample [byte]."""
        return max(0.0, self.depth - self.level)

    def tokens(self, rate: float, total: float, now: float) -> Tuple[float, float]:
        """(depth, tokens that are missing now) of a bucket that may be spent at once [byte]: beside a queue that stays,
        a burst would take the place of others.

        :param rate: of the path, as known [byte/s]
        :param total: bytes sent so far
        """
        if self._newest is None or not self._spends:
            return 0.0, 0.0
        usable, sent = min(self.depth, MAX_DURATION * rate), total - self._newest.total
        missing = self.level + sent - rate * (now - self._newest.sent)
        return usable, max(0.0, missing - (self.depth - usable))

    def learn(self, rate: float, error: float) -> None:
        """The rate was measured beside the present queue.

        :param rate: [byte/s]
        :param error: its relative standard deviation: what is explained by it shows no token bucket
        """
        if self._onset is None:
            return
        self._rates.append(rate)
        usual = statistics.median(self._rates)
        if not self._rate:
            self._rate = usual
        elif not self._is_same(usual):
            self._rate, self.depth, self._onset = usual, self._settled, None
            self._depths.clear()
            self._depths.extend([self.depth] * AGREE if self.depth else [])
            return
        self._note_depth(rate, (1 + error) * rate)
        if self._is_same(rate):
            alike = sum(depth > ALIKE * self.depth for depth in self._depths)
            self._settled = self.depth if alike >= max(SURE, len(self._depths) / 2) else 0.0

    def _is_same(self, rate: float) -> bool:
        """Whether a rate is that at which depths are learnt."""
        return abs(rate - self._rate) <= SAME_RATE * self._rate

    def _note_depth(self, rate: float, most: float) -> None:
        """The present queue shows a depth.

        :param rate: [byte/s]
        :param most: what the path carried at most [byte/s]
        """
        assert self._onset is not None
        onset, excess = self._onset.sample, self._excess(rate, most)
        if excess <= MAX_DEPTH and (excess > self.depth or self._was_full):
            if self._learnt is not onset:
                self._depths.append(0.0)
            self._learnt, self._depths[-1] = onset, max(0.0, excess)
            deepest = sorted(self._depths)[-AGREE:][0]
            # without a bucket, too, a path lets one datagram pass at once
            longest = max(passed.sample.size for passed in (*self._before, self._onset))
            self.depth = deepest if deepest > DATAGRAMS * longest else 0.0

    def _excess(self, rate: float, most: float) -> float:
        """What passed at once at most, before the present queue or until it began [byte]."""
        assert self._onset is not None
        excess, least = 0.0, math.inf
        for sample, wait, _ in (*self._before, self._onset):
            least = min(least, sample.total - sample.size - most * sample.sent)
            excess = max(excess, sample.total - most * sample.sent - least - wait * rate)
        return excess
