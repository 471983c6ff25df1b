# SPDX-License-Identifier: BSD-3-Clause
"""The paths by which one operator gets what is sent: one, or two at once, which are one link to the plan.

* Each path has an estimate of its own, made of reports of its own: what goes by the other one was never sent on it
  (operator_share.py). Estimates are remembered by what identifies the path.
* Capacities and rates add up, and the loss is their mixture by what each carries.
* What leaves together goes by one path: the one on which it has left first, if each path sends at its rate. So paths
  that are paced together are used in proportion to their rates.
* It goes by another path where that one delivers all that waits before this one would deliver it: the end of an image
  does not wait for a slow path. What is sent at once goes by the path on which it arrives first.
* What a slow path does not carry therefore is no capacity, and the other one is not paced faster for it.
* A packet train goes by the path that it is to measure.
* A path whose bytes cost is used beside another one only while that one does not carry the cheapest images, and for no
  more than these take.
* All goes by the late one of two paths where that carries far more than both, loss taken off.
* While a first path is quiet, all goes by the second one, unless that is an early one which was left.
"""
import math
from dataclasses import replace
from typing import Any, List, Optional, Sequence, Tuple

from ..monitoring.stats import PathRates
from ..monitoring.windows import Rate
from ..newest import Newest
from ..paths import PathPolicy, PathUse
from ..pauses import Pauses
from .estimator import Estimator, Limits, Link
from .feedback import Feedback, FeedbackReader
from .sent_history import SentHistory
from .trains import Train

MAX_ESTIMATES = 4
"""Paths to one operator whose estimates are remembered."""

SENT_WINDOW = 1.0
"""Window over which the send rate is measured [s]."""

MAX_LEAD = 0.02
"""What a path could have sent meanwhile counts for its share, as far as it takes this long [s]."""

SILENCE, MAX_SILENCE = 0.35, 1.0
"""A second path carries nothing after this time in which neither a probe came from it nor anything that was sent by it
was reported. Both come each 0.1 s: at 20 % loss three in a row are lost once in 13 s, six never. It is longer where the
path pauses, or the first one, which carries the reports, takes long: see Pauses [s]."""

LATE = 0.05
"""A path that delivers a datagram later than the other one by this time adds no capacity, by half of this time half of
its own. With 0.1 s images over 0.4 and 0.2 Mbit/s are 0.1 dB sharper and 29 ms older, and the screen is 0.3 dB worse
(`bench paths`) [s]."""

WORTH = 0.5
"""The early one of two paths is left for the late one where it carries less than this part of it, loss taken off, and
is used again when it carries as much. The screen is the same by 2 Mbit/s of which 60 % are lost and by 1 Mbit/s that
takes 150 ms (`experiments two_paths`) [1]."""

ASK, ASK_LOSSY, LOSSY = 1.0, 5.0, 0.1
"""So often something goes by an early path that is left, so that reports say what it carries now. Where it loses more
than LOSSY, images that are predicted from what is lost freeze: it is asked seldom, and no train measures it [s, s, 1].
"""

FELL = 0.8
"""A path is missed where the others carry less than this part of what all did."""

ENOUGH = 1.5
"""A path that costs is left once the other one carries the cheapest images this many times: estimates vary."""

TRICKLE = 1.0
"""What a path that costs carries where it is not needed [byte/s]."""

LONG_DATAGRAM = 1472
"""Those of images are as long [byte]."""


class _Estimate:
    """What is remembered of a path."""

    def __init__(self, now: float, limits: Limits) -> None:
        self.estimator = Estimator(now, limits)
        self.total: Optional[int] = None
        """Bytes sent until it was left, as its estimator has counted them; None: it was never used."""
        self.pauses = Pauses(SILENCE, MAX_SILENCE, -math.inf)


class _Path:
    """One path that is used now."""

    def __init__(self, key: Any, reader: FeedbackReader, known: _Estimate, since: float) -> None:
        self.key, self.reader, self.known, self.estimator = key, reader, known, known.estimator
        self._shift = 0 if known.total is None else known.total - reader.sent.total
        self.name = ''
        """The interface, or the operator's host."""
        self.since = since
        """What was sent earlier says nothing about it; -inf: all says something [s]."""
        self.policy = PathPolicy()
        """How it may be used; of a path that costs, with the maximum rate that holds now."""
        self.busy = -math.inf
        """Until when what it was given takes at its rate [s]."""
        self._sent = Rate(SENT_WINDOW)

    @property
    def rate(self) -> float:
        """What may be sent by it now [byte/s]."""
        return self.policy.limited(self.estimator.rate)

    @property
    def capacity(self) -> float:
        """What streams may take of it [byte/s]."""
        return self.policy.limited(self.estimator.link.capacity)

    @property
    def total(self) -> int:
        """Bytes sent by it so far: what went by another path while it was not used does not count."""
        return self.reader.sent.total + self._shift

    def poll(self, now: float) -> None:
        """See Estimator.poll."""
        self._sent.read(self.total, now)
        self.estimator.poll(now, self.sent)

    @property
    def sent(self) -> float:
        """What was sent by it lately, where there are two [byte/s]."""
        return self._sent.per_second or 0.0

    def read(self, report: Any, now: float) -> Optional[Feedback]:
        """What a report says about the path; None: nothing, or it is not believed."""
        feedback = self.reader.read(report, now)
        if feedback is None:
            return None
        samples = [sample._replace(total=sample.total + self._shift) for sample in feedback.samples]
        if samples:
            self.known.pauses.hear(samples[-1].sent, now)
        if self.since == -math.inf:
            return feedback._replace(samples=samples)
        samples = [sample for sample in samples if sample.sent >= self.since]
        if not samples:
            return None
        self.since = -math.inf      # from the next report on all is of this path
        return feedback._replace(samples=samples, expected=0, received=0, marked=0, arrivals=())

    def virtual_finish(self, size: float, now: float) -> float:
        """When bytes that are given to it now would have left, if it had begun as early as it could [s]."""
        return max(self.busy, now - MAX_LEAD) + size / self.rate

    @property
    def idle_delay(self) -> float:
        """What a long datagram takes while nothing else is sent, by the receiver's clock; NaN: unknown [s]."""
        delay = self.estimator.base_delay
        return math.nan if delay is None else delay + LONG_DATAGRAM / self.capacity

    def delivers(self, size: float, now: float) -> float:
        """When bytes that are given to it now have arrived, by the receiver's clock; NaN: unknown [s]."""
        delay = self.estimator.base_delay
        return math.nan if delay is None else max(self.busy, now) + size / self.rate + delay


class Bundle:
    """The paths to one operator.

    :param history: of what is sent to all operators
    :param limits: of each path's estimate, and of all together
    :param now: by a steady clock [s]
    """

    def __init__(self, history: SentHistory, limits: Limits, now: float) -> None:
        self._history, self._limits = history, limits
        self._known: Newest[Any, _Estimate] = Newest(MAX_ESTIMATES)
        self._paths = [_Path(None, FeedbackReader(history), _Estimate(now, limits), -math.inf)]
        self._train, self._train_left = 0, 0.0      # the path that is measured, and what of its train has not left
        self._has_two = False       # whether there were two since it joined
        self.base = 0.0
        """What the cheapest images of all streams take, and what is protected [byte/s]."""
        self._avoids_first = False      # as it is quiet
        self._alone: Optional[int] = 0  # index of the path that carries all; None: both carry something
        self._asked = -math.inf         # when something went by the path that is left
        self.only = ''
        """The path by which it is reached, where there were two: its interface, or the operator's host there."""

    # -- which paths there are, and what they get -----------------------------------------------------

    def follow(self, used: Sequence[PathUse], now: float) -> bool:
        """Use these paths from now on, one or two; the second one where it is not silent.

        :return: whether they carry far less than those before
        """
        before, has_left_second = self.capacity, self._left_early == 1
        alone = len(used) == 1 or self._pauses_of(used[1], now).is_cut(now)
        self._has_two |= not alone
        self.only = used[0].name if self._has_two and alone else ''
        used = [used[0], *(one for one in used[1:2] if self._is_useful(one, used[0], now))]
        first = self._paths[0]
        if first.key is None:
            first.key = used[0].key
            self._known[first.key] = first.known
        for path in self._paths:
            path.known.total = path.total
        if first.key != used[0].key:
            self._paths[0] = self._path(used[0].key, first.reader, now)
        if [path.key for path in self._paths[1:]] != [one.key for one in used[1:]]:
            self._paths[1:] = [self._path(one.key, FeedbackReader(self._history), now) for one in used[1:]]
            self._train_left = 0.0
        for path, one in zip(self._paths, used):
            path.name, path.policy = one.name, one.policy
            if one.policy.metered and len(used) > 1 and not used[0].is_quiet:
                needed = self.base if self._lacks(used[0] if path is self._paths[1] else used[1]) else TRICKLE
                path.policy = one.policy._replace(max_rate=min(one.policy.max_rate, needed))
        if len(self._paths) > 1:
            for path in self._paths:
                path.reader.is_shared = True
        self._avoids_first = used[0].is_quiet and len(self._paths) > 1 and not has_left_second
        self._alone = self._find_alone()
        return self.capacity < FELL * before

    @property
    def _carrying(self) -> List[_Path]:
        """The paths by which something is sent now."""
        return self._paths if self._alone is None else [self._paths[self._alone]]

    def _lacks(self, use: PathUse) -> bool:
        """Whether a path does not carry the cheapest images."""
        known = self._known.get(use.key)
        if known is None:
            return False
        return use.policy.limited(known.estimator.link.capacity) < (ENOUGH if len(self._paths) > 1 else 1.0) * self.base

    def _is_useful(self, second: PathUse, first: PathUse, now: float) -> bool:
        """Whether something goes by a second path: it is alive, and if it costs, it is needed."""
        needed = first.policy.metered or first.is_quiet or self._lacks(first)
        if second.policy.metered and not needed:
            return False
        return not self._pauses_of(second, now).is_cut(now)

    def _pauses_of(self, use: PathUse, now: float) -> Pauses:
        """Those of a path, from which probes may have come."""
        pauses = self._estimate_of(use.key, now).pauses
        if now - use.silence > pauses.heard:
            pauses.hear(now - use.silence, now)
        return pauses

    def _estimate_of(self, key: Any, now: float) -> _Estimate:
        return self._known.of(key, lambda: _Estimate(now, self._limits))

    def _path(self, key: Any, reader: FeedbackReader, now: float) -> _Path:
        return _Path(key, reader, self._estimate_of(key, now), now)

    def choose(self, size: int, waiting: float, now: float) -> Tuple[int, float]:
        """(index of the path by which some bytes leave now, what is withheld from the other one for it [byte]).

        :param size: of all of them [byte]
        :param waiting: of all that waits, these included [byte]
        """
        if self._train_left > 0 and not self._avoids_first:
            return self._train, 0.0
        if self._alone is None:
            return self._by_arrival(size, waiting, now)
        left = self._left_early
        if left is not None and now >= self._asked + (ASK_LOSSY if self._is_lossy(left) else ASK):
            self._asked = now
            return left, 0.0
        return self._alone, 0.0

    def _is_lossy(self, index: int) -> bool:
        return self._paths[index].estimator.link.loss >= LOSSY

    def _by_arrival(self, size: int, waiting: float, now: float) -> Tuple[int, float]:
        """As `choose`."""
        first, second = self._paths
        by_second = second.virtual_finish(size, now) < first.virtual_finish(size, now)
        chosen, other = (second, first) if by_second else (first, second)
        if chosen.delivers(size, now) > other.delivers(waiting, now):
            return int(not by_second), size * chosen.rate / other.rate if waiting > size else 0.0
        return int(by_second), 0.0

    def sent(self, stream: str, seq: int, count: int, number: int, size: int, now: float, chosen: int) -> None:
        """Datagrams were added to the history.

        :param count: of them
        :param number: how many of them, the first ones, went to this operator
        :param size: of each [byte]
        :param chosen: the path's index
        """
        for index, path in enumerate(self._paths):
            went = number if index == chosen else 0
            if went < count:
                path.reader.sent.leave_out(stream, seq + went, count - went, size, now)
            if went and len(self._paths) > 1:
                path.busy = path.virtual_finish(went * size, now)
        self._train_left -= number * size

    # -- what is known of them ------------------------------------------------------------------------

    @property
    def readers(self) -> List[FeedbackReader]:
        """Readers of the reports of each path."""
        return [path.reader for path in self._paths]

    @property
    def rate(self) -> float:
        """What may be sent now, by all paths together [byte/s]."""
        return min(math.fsum(path.rate for path in self._carrying), self._limits.max_rate)

    @property
    def capacity(self) -> float:
        """Capacity of all paths together, as far as it is useful [byte/s]."""
        return min(math.fsum(self._useful()), self._limits.max_rate)

    def _useful(self) -> List[float]:
        """What streams may take of each path, as far as it arrives in time [byte/s]."""
        capacities = [path.capacity for path in self._paths]
        if self._alone is not None:
            return [capacity if index == self._alone else 0.0 for index, capacity in enumerate(capacities)]
        later, unused = self._later()
        capacities[later] *= 1 - unused
        return capacities

    def _later(self) -> Tuple[int, float]:
        """(index of the path on which the other one does not wait, the part of it that is not used therefore)."""
        behind = self._paths[1].idle_delay - self._paths[0].idle_delay
        return int(behind > 0), min(abs(behind) / LATE, 1.0) if behind == behind else 0.0   # NaN: unknown

    @property
    def _left_early(self) -> Optional[int]:
        """Index of an early path that is left for a late one; None: there is none."""
        return None if self._avoids_first or self._alone is None or len(self._paths) == 1 else 1 - self._alone

    def _find_alone(self) -> Optional[int]:
        """The path that carries all: a late one that is far more than both together. None: both carry something."""
        if self._avoids_first or len(self._paths) == 1:
            return len(self._paths) - 1
        later, unused = self._later()
        early, late = (path.capacity * (1 - path.estimator.link.loss) for path in (
            self._paths[1 - later], self._paths[later]))
        enough = late * (1.0 if self._alone == later else WORTH)
        return later if early + (1 - unused) * late < enough else None

    @property
    def link(self) -> Link:
        """All paths together as one link; the round trip is the first one's, the queue the longest."""
        links = [path.estimator.link for path in self._carrying]
        if len(links) == 1:
            return replace(links[0], capacity=self.capacity)
        shares = self._useful()
        loss = sum(link.loss * share for link, share in zip(links, shares)) / sum(shares)
        return replace(links[0], capacity=self.capacity, loss=loss, queue_delay=max(link.queue_delay for link in links))

    def shares(self, sent: float) -> List[PathRates]:
        """What is known of each path; empty: there was always one.

        :param sent: by all together [byte/s]
        """
        if not self._has_two:
            return []
        alone = len(self._paths) == 1
        links = [path.estimator.link for path in self._paths]
        return [PathRates(path.name, sent if alone else path.sent, path.capacity, link.loss, link.queue_delay)
                for path, link in zip(self._paths, links)]

    @property
    def timed_out(self) -> bool:
        """Whether no path is reported about in time."""
        return all(path.estimator.timeouts > 0 for path in self._paths)

    @property
    def has_deep_bucket(self) -> bool:
        """See Estimator."""
        return len(self._paths) == 1 and self._paths[0].estimator.has_deep_bucket

    def tokens(self, now: float) -> Tuple[float, float]:
        """See Estimator; of two paths none are known, as each has its own."""
        if len(self._paths) > 1:
            return 0.0, 0.0
        return self._paths[0].estimator.tokens(self._paths[0].total, now)

    def planned(self, budget: float) -> float:
        """For what multiple streams are planned now, so that a train has enough to send.

        :param budget: what they are planned for without it [byte/s]
        """
        paths = self._carrying
        if len(paths) == 1:
            return paths[0].estimator.planned(budget, paths[0].total)
        shares = [path.capacity / self.capacity for path in paths]
        return max(1.0, *(share * path.estimator.planned(share * budget, path.total)
                          for share, path in zip(shares, paths)))

    # -- what changes it ------------------------------------------------------------------------------

    def poll(self, now: float, sent: float) -> None:
        """See Estimator.

        :param sent: lately, at most [byte/s]
        """
        if len(self._paths) == 1:
            self._paths[0].estimator.poll(now, sent)
            return
        for path in self._paths:
            path.poll(now)

    def expect_more(self) -> None:
        """See Estimator."""
        for path in self._paths:
            path.estimator.expect_more()

    def on_return(self, now: float) -> None:
        """See Estimator. It may have fewer paths now."""
        self._has_two = False
        for path in self._paths:
            path.estimator.on_return(now)

    def read(self, report: Any, index: int, now: float) -> Optional[Feedback]:
        """What a report says about one path; None: nothing, or it is not believed."""
        return self._paths[index].read(report, now) if index < len(self._paths) else None

    def on_feedback(self, index: int, feedback: Feedback, now: float, wanted: float, wished: float) -> Optional[Train]:
        """See Estimator; what the other path carries is not wanted of this one."""
        others = self.rate_beside(index)
        if index == self._left_early:
            others = math.inf if self._is_lossy(index) else 0.0
        train = self._paths[index].estimator.on_feedback(feedback, now, wanted - others, max(0.0, wished - others))
        if train is not None:
            self._train, self._train_left = index, train.size
        return train

    def rate_beside(self, index: int) -> float:
        """What the paths but one carry [byte/s]."""
        return math.fsum(path.rate for path in self._carrying if path is not self._paths[index])
