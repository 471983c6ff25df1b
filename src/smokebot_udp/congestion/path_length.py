# SPDX-License-Identifier: BSD-3-Clause
"""How long a datagram may be that passes to an operator: some tunnels and radios drop longer ones without a word.

It is packetization-layer path MTU discovery (RFC 8899), in which most datagrams need no confirmation:

* A stream whose datagrams have one length shows that this length passes when the operator's reports count more of them.
* Lengths that are sent, but not heard of while shorter ones are, are doubtful, and so are those that nothing shows.
* A doubtful length is tested by probes: one of this length, and SHORT_PROBES short ones right behind it. The operator
  answers which ones came. The length passes with the first one that came. It does not with so many lost that this would
  be a coincidence at the loss of the short ones.
* Where a length does not pass, a usual one that is shorter is used at once, and the longest that passes is searched for
  in between. Longer ones are tried again each RECOVERY_PERIOD.

Pure: times are arguments, by a steady clock [s]. Lengths are UDP payloads [byte].
"""
import math
from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional

LENGTHS = (548, 1172, 1232, 1272, 1332, 1372, 1392, 1412, 1424, 1452, 1464, 1472)
"""What passes where the path MTU is 576 (the least of IPv4), 1200, 1260, 1300, 1360, 1400, 1420 (WireGuard), 1440,
1452, 1480, 1492 (PPPoE) and 1500 (Ethernet)."""

USUAL = LENGTHS[:2]
"""What is sent while it is searched for what passes: the longer one, unless that does not pass, either."""

SHORT, SHORT_PROBES = 64, 3
"""Length of the short probes, and their number for each long one."""

UNHEARD, UNHEARD_FOR = 8, 0.4
"""So many datagrams in a row that were not heard of, and for how long, make a length doubtful [1, s]."""

MIXED_FOR = 3.0
"""A stream counts as having its shortest datagrams of this time [s]."""

HEARD_FOR = 0.6
"""A stream of which nothing new was reported for this long is not heard of [s]."""

CONFIRMED_FOR = 10.0
"""What was not shown to pass for this long is doubtful [s]."""

COINCIDENCE, DOUBT = 5e-3, 0.05
"""The probability of what is no coincidence, and of what only makes doubtful."""

PROBE_PERIOD, SEARCH_PERIOD, ANSWER_TIME = 0.1, 0.25, 1.0
"""Between two long probes of a length that is used, of another one, and how long an answer to the last one is waited
for [s]."""

MIN_PROBES, MAX_PROBES = 4, 40
"""Lost before a length fails; sent before a test ends that nobody answers."""

REST = 2.0
"""After a test that found nothing new, before a doubt leads to the next one; doubled each time, up to CONFIRMED_FOR
[s]."""

RECOVERY_PERIOD = 3.0
"""[s]"""

ANSWER_BITS = 64
"""Probes that an answer names."""


@dataclass
class Stream:
    """What was sent of a stream, and heard of it."""
    size: int
    size_at: float
    unheard: int = 0
    """Sent since it was heard of."""
    since: float = math.inf
    """When the first of these was."""
    sent: int = 0
    heard: int = 0
    heard_at: float = -math.inf
    received: Optional[int] = None
    """As reported last."""


class LengthTest:
    """Whether a length passes.

    :param most: long probes that are sent
    """

    def __init__(self, length: int, most: int, now: float) -> None:
        self.length, self.due, self.left = length, now, most
        self._numbers: Dict[int, bool] = {}     # {number of a probe: whether it is a long one}
        self._arrived: Dict[int, bool] = {}

    def sent(self, first: int) -> None:
        """Probes were sent, a long one with this number, and short ones with the following."""
        self._numbers.update((number, number == first) for number in range(first, first + 1 + SHORT_PROBES))

    def answered(self, numbers: List[int]) -> None:
        """These probes have arrived, as far as they are of this test."""
        self._arrived.update((number, self._numbers[number]) for number in numbers if number in self._numbers)

    @property
    def passes(self) -> Optional[bool]:
        """None: that is not known yet."""
        if any(self._arrived.values()):
            return True
        newest = max(self._arrived, default=-1)     # all before it had their chance
        lost = sum(long for number, long in self._numbers.items() if number < newest)
        short = sum(not long for number, long in self._numbers.items() if number <= newest)
        if lost < MIN_PROBES or _probability(len(self._arrived), short, lost) >= COINCIDENCE:
            return None
        return False


def _probability(arrived: int, sent: int, lost: int) -> float:
    """That so many datagrams in a row are lost where `arrived` of those `sent` at the same time have come."""
    return float(max(0.0, 1 - arrived / (sent + 1)) ** lost)


class PathLength:
    """The path to one operator.

    :param longest: that both sides take
    """

    def __init__(self, longest: int, now: float) -> None:
        self.length = longest
        """What passes, as far as is known."""
        self._lengths = sorted({*(length for length in LENGTHS if length < longest), longest})
        self._passes = 0                    # the longest that is known to pass, 0: none
        self._fails = math.inf              # the shortest that is known not to
        self._confirmed = now               # when something showed that `length` passes
        self._test: Optional[LengthTest] = None
        self._next_search = self._next_doubt = now
        self._rest, self._higher = REST, False
        self._reported = -math.inf          # when the last report came
        self._streams: Dict[str, Stream] = {}

    @property
    def hole(self) -> bool:
        """Whether datagrams above `length` do not pass."""
        return self._fails < math.inf

    # -- what the streams show --------------------------------------------------------------------------

    def sent(self, stream: str, count: int, size: int, now: float) -> None:
        """Datagrams of a stream were sent to this operator, each of `size` bytes."""
        one = self._streams.setdefault(stream, Stream(size, now))
        if size <= one.size or now - one.size_at > MIXED_FOR:
            one.size, one.size_at = size, now
        one.since = min(one.since, now)
        one.unheard += count
        one.sent += count

    def reported(self, received: Mapping[str, int], now: float) -> None:
        """The operator reports how many datagrams of each stream have come."""
        for stream, one in self._streams.items():
            number = received.get(stream)
            if number is not None and one.received is not None and number > one.received:
                one.heard += number - one.received
                one.heard_at, one.unheard, one.since = now, 0, math.inf
            one.received = number if number is not None else 0
        self._reported = now
        if not self._unheard(now):
            self._confirmed = now
            if any(one.size > LENGTHS[0] for one in self._heard(now)):
                self._rest = REST

    def _heard(self, now: float) -> List[Stream]:
        return [one for one in self._streams.values() if now - one.heard_at < HEARD_FOR]

    def _unheard(self, now: float) -> List[Stream]:
        """Those of longer datagrams than all that are heard of."""
        longest = max((one.size for one in self._heard(now)), default=0)
        return [one for one in self._streams.values() if one.unheard and one.size > max(longest, LENGTHS[0])]

    def _is_doubtful(self, now: float) -> bool:
        unheard, heard = self._unheard(now), self._heard(now)
        if not unheard or now - self._reported > HEARD_FOR:
            return False
        count = sum(one.unheard for one in unheard)
        if heard and count >= UNHEARD and now - min(one.since for one in unheard) >= UNHEARD_FOR and _probability(
                sum(one.heard for one in heard), sum(one.sent for one in heard), count) < DOUBT:
            return True
        return now - self._confirmed > CONFIRMED_FOR

    # -- probes -----------------------------------------------------------------------------------------

    def probe(self, now: float) -> Optional[int]:
        """The length of the probe that is sent now, before SHORT_PROBES of SHORT; None: none is."""
        if self._test is None:
            self._test = self._new_test(now)
        test = self._test
        if test is None or now < test.due:
            return None
        if not test.left:
            self._end_test(now, RECOVERY_PERIOD)
            return None
        test.left -= 1
        period = PROBE_PERIOD if test.length == self.length else SEARCH_PERIOD
        test.due = now + (period if test.left else ANSWER_TIME)
        return test.length

    def _new_test(self, now: float) -> Optional[LengthTest]:
        if now >= self._next_doubt and self._is_doubtful(now):
            return LengthTest(self.length, MAX_PROBES, now)
        if not self.hole or now < self._next_search:
            return None
        between = [length for length in self._lengths if self._passes < length < self._fails]
        if between:
            return LengthTest(between[len(between) // 2] if self._passes else self.length, MAX_PROBES, now)
        self._higher = not self._higher     # in turns: the longest, and the next one
        longer = [length for length in self._lengths if length > self.length] or [self.length]
        return LengthTest(longer[-1 if self._higher else 0], 1, now)

    def probed(self, first: int) -> None:
        """The probes that were due have been sent, the long one with this number, the others with the following."""
        if self._test is not None:
            self._test.sent(first)

    def answered(self, newest: int, arrived: int, now: float) -> None:
        """The operator has answered.

        :param newest: number of the newest probe that came
        :param arrived: a bit for it, the lowest, and for each of the ANSWER_BITS - 1 before it
        """
        test = self._test
        if test is None:
            return
        test.answered([newest - bit for bit in range(ANSWER_BITS) if arrived >> bit & 1])
        if test.passes:
            self._pass(test.length, now)
        elif test.passes is False:
            self._fail(test.length, now)

    def _pass(self, length: int, now: float) -> None:
        if length >= self._fails:       # the hole has gone, or is smaller
            self._fails = math.inf if length == self._lengths[-1] else self._lengths[-1]
        self._passes, self._confirmed = max(self._passes, length), now
        self.length = max(self.length, length)
        self._end_test(now, 0.0)

    def _fail(self, length: int, now: float) -> None:
        self._fails = min(self._fails, length)
        if self._passes >= length:      # the path has changed
            self._passes = 0
        usual = [one for one in USUAL if one < length]
        self.length = self._passes or min(self.length, max(usual, default=self._lengths[0]))
        self._rest = REST
        self._end_test(now, 0.0)

    def _end_test(self, now: float, pause: float) -> None:
        """:param pause: before the next step of a search [s]"""
        if self._test is not None and self._test.length == self.length:
            self._next_doubt, self._rest = now + self._rest, min(2 * self._rest, CONFIRMED_FOR)
        self._test, self._next_search = None, now + pause
        for one in self._streams.values():
            one.unheard, one.since, one.sent, one.heard = 0, math.inf, 0, 0
