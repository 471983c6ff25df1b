# SPDX-License-Identifier: BSD-3-Clause
"""The rate above which the path drops datagrams without a queue to be seen: a policer, or a queue of a few ms.

Where more is lost than the air is known to lose, either the air or such a path loses it. A *check* tells: as much less
is sent as was lost, and what the air loses is lost all the same. If it is not, that rate is the ceiling, as BBR's bw_hi
is (draft-cardwell-iccrg-bbr-congestion-control-02). From time to time a *trial* sends more: a little at first, and
twice as much more with each trial that loses nothing.

Streams that send in bursts offer less on average than the path carries, and so does their check. There the ceiling lies
between the rate of the check and that at which datagrams arrived within the bursts, which a queue took some of. Trials
*search* it there at once, each at the geometric mean, but 40 % higher at most.
"""
import enum
import math
from typing import Optional

from .feedback import Feedback
from .loss import Loss

MARGIN = 0.96
"""Part of what was carried that may be sent."""

AIR_COUNT = 300
"""What a check has shown of the air's loss weighs as much as this many datagrams."""

MIN_CHECK_GAIN = 0.5
"""A check sends at least this part of the rate before."""

MIN_EXCESS = 0.01
"""Less that is lost beyond what the air loses needs no check."""

SIGNIFICANCE = 2.5
"""Loss in a check counts as lower than before only where it is lower by this many standard deviations."""

CERTAINTY = 6.0
"""A check lasts until the loss expected of the path and that expected of the air differ by this many standard
deviations."""

MIN_CHECK_COUNT = 20
"""Number of datagrams that a check needs to end before MAX_CHECK_DURATION, and that are needed to begin one after
SUSPICION_TIME."""

SUSPICION_COUNT, SUSPICION_TIME = 100, 0.3
"""Before a check, loss is counted over SUSPICION_COUNT datagrams, or MIN_CHECK_COUNT after SUSPICION_TIME [1, s]."""

MAX_CHECK_DURATION = 1.0
"""A check ends after this long even if it has too few datagrams [s]."""

CHECK_SETTLING = 0.1
"""Datagrams sent within this time after a check began are not counted. They may have left at the rate before, or met a
full queue [s]."""

CHECK_INTERVAL = 3.0
"""Time from a check to the next one [s]."""

FIRST_STEP = 0.05
"""Part by which a first trial raises the rate."""

MAX_STEP = 0.8
"""Part by which a trial raises the rate, at most. Where such a trial loses nothing, there is no ceiling."""

MIN_HOLD, MAX_HOLD = 8.0, 64.0
"""Time before a first trial; it doubles where one fails [s]."""

TRIAL_DURATION = 1.0
"""Duration of a trial outside a search [s]."""

MIN_TRIAL_COUNT = 50
"""Datagrams in a trial, at least."""

SEARCH_INTERVAL = 0.5
"""Time of a trial in a search, and before one [s]."""

MAX_SEARCH_STEP = 0.4
"""Part by which a trial in a search raises the rate, at most."""

SEARCHED = 1.2
"""A search ends where what may carry more than the ceiling is less than this many ceilings."""

MIN_USE = 0.93
"""A trial needs streams that use this part of what they may."""


class _State(enum.Enum):
    FREE, SUSPICION, CHECK, HOLD, TRIAL = range(5)


class LossCeiling:
    """Finds the ceiling, if there is one."""

    def __init__(self) -> None:
        self.rate = math.inf
        """What may be sent, at most [byte/s]."""
        self._state = _State.FREE
        self._began = 0.0                   # the state [s]
        self._since = 0.0                   # datagrams sent from then on are counted [s]
        self._next_check = -math.inf        # not before [s]
        self._count = self._lost = 0        # of datagrams sent in this state
        self._held = math.inf               # the ceiling in use before a check or a trial [byte/s]
        self._before = self._expected = 0.0     # loss ratio before the check, and that expected of a ceiling
        self._before_count = 0                  # datagrams, and how many of them were lost
        self._before_lost = 0
        self._found = 0.0                   # loss beyond the air's when the ceiling was found
        self._most = 0.0                    # the path carries less than this [byte/s]; 0: nothing is searched
        self._step, self._hold = FIRST_STEP, MIN_HOLD

    @property
    def known(self) -> float:
        """What the path is known to carry, at most [byte/s]."""
        return self._held if self._state is _State.CHECK else self.rate

    @property
    def checking(self) -> bool:
        """Whether less is sent to learn what loses datagrams."""
        return self._state is _State.CHECK

    def update(self, feedback: Feedback, since: float, offered: float, pace: float, loss: Loss, now: float) -> None:
        """Take the counts of a report beside a short queue.

        :param since: when the first datagrams that the report counts were sent [s]
        :param offered: what was sent [byte/s]
        :param pace: at what rate datagrams left that were due [byte/s]
        :param loss: has the report's counts already
        """
        if since >= self._since:
            self._count += feedback.expected
            self._lost += feedback.lost
        if self._state is _State.CHECK:
            self._judge_check(loss, now)
        elif self._state is _State.TRIAL and loss.exceeds_air(self._count, self._lost):
            self._end_lossy_trial(loss, now)
        elif self._state is _State.SUSPICION:
            enough = MIN_CHECK_COUNT if now - self._began > SUSPICION_TIME else SUSPICION_COUNT
            if self._count >= enough:
                self._begin_check(offered, pace, loss, now)
        elif self._state is _State.HOLD and now >= self._next_check and loss.exceeds_air(self._count, self._lost):
            self._begin_check(offered, pace, loss, now)
        elif loss.suspicious and now >= self._next_check:
            self._held = self.rate
            self._enter(_State.SUSPICION, self.rate, now)
            self._since = -math.inf
        elif offered >= MIN_USE * self.rate:
            self._try_more(pace, loss, now)

    def interrupt(self, now: float) -> None:
        """The link was away: what was lost meanwhile is no matter of the rate."""
        if self._state not in (_State.FREE, _State.HOLD):
            self._settle(self._held, now)

    def _enter(self, state: _State, rate: float, now: float) -> None:
        self._state, self.rate = state, rate
        self._began = self._since = now
        self._count = self._lost = 0

    def _settle(self, rate: Optional[float], now: float) -> None:
        """Keep a ceiling [byte/s]; None: there is none."""
        self._step, self._next_check = FIRST_STEP, now + CHECK_INTERVAL
        if rate is None or rate == math.inf:
            self._enter(_State.FREE, math.inf, now)
            self._found, self._hold = 0.0, MIN_HOLD
        else:
            self._enter(_State.HOLD, rate, now)
        self._held = self.rate

    def _begin_check(self, offered: float, pace: float, loss: Loss, now: float) -> None:
        self._before_count, self._before_lost = self._count, self._lost
        self._before = self._lost / self._count
        excess = loss.beyond_air(self._before)
        if not MIN_EXCESS <= excess < 1:        # nothing arrives: that is no matter of the rate
            self._settle(self._held, now)
            return
        gain = max(MIN_CHECK_GAIN, MARGIN * (1 - excess))
        self._expected = 1 - (1 - loss.air) * min(1.0, (1 - excess) / gain)
        self._most = pace * (1 - excess)
        self._enter(_State.CHECK, gain * min(offered, self.rate), now)
        self._since = now + CHECK_SETTLING

    def _judge_check(self, loss: Loss, now: float) -> None:
        variance = loss.dispersion * self._before * (1 - self._before)      # of one datagram
        needed = variance * CERTAINTY ** 2 / (self._before - self._expected) ** 2
        waited = now - self._since >= MAX_CHECK_DURATION
        if not self._count or self._count < max(MIN_CHECK_COUNT, needed) and not waited:
            return
        ratio = self._lost / self._count
        deviation = math.sqrt(variance * (1 / self._before_count + 1 / self._count))
        if ratio >= min((self._before + self._expected) / 2, self._before - SIGNIFICANCE * deviation):
            again = self._before - loss.air >= self._found / 2      # as much loss at the ceiling as there was above it
            loss.set_air(self._count + self._before_count, self._lost + self._before_lost)
            self._settle(None if again else self._held, now)
        else:
            self._found = max(self._found, self._before - loss.air)
            carried = (1 - ratio) / (1 - loss.air)
            overrun = ratio > loss.air + (1 - MARGIN)
            if overrun:
                self._most = 0.0
            self._settle(self.rate * (MARGIN * carried if overrun else 1.0), now)
            self._next_check = now
            loss.set_air(AIR_COUNT, round(AIR_COUNT * (loss.air if overrun else ratio)))
        loss.answered()

    @property
    def _searching(self) -> bool:
        """Whether much more than the ceiling that is held may be carried, too."""
        return self._most > SEARCHED * self._held

    def _end_lossy_trial(self, loss: Loss, now: float) -> None:
        if self._searching:
            self._most = self.rate
            self._settle(MARGIN * self._held, now)
        else:
            self._hold = min(2 * self._hold, MAX_HOLD)
            self._settle(self._held * (MARGIN if self._step > FIRST_STEP else 1.0), now)
        self._next_check = now + TRIAL_DURATION
        loss.answered()

    def _try_more(self, pace: float, loss: Loss, now: float) -> None:
        """Begin a trial, or end one without loss."""
        elapsed, searching = now - self._began, self._searching
        if self._state is _State.HOLD and elapsed >= (SEARCH_INTERVAL if searching else self._hold):
            self._held = self.rate
            step = min(math.sqrt(self._most / self.rate) - 1, MAX_SEARCH_STEP) if searching else self._step
            self._enter(_State.TRIAL, self.rate * (1 + step), now)
        elif (self._state is _State.TRIAL and elapsed >= (SEARCH_INTERVAL if searching else TRIAL_DURATION)
              and self._count >= MIN_TRIAL_COUNT):
            if searching:
                self._end_search_trial(pace, loss, now)
                return
            self._hold, step = MIN_HOLD, 2 * self._step
            if step > MAX_STEP:
                self._settle(None, now)
            else:
                self._held, self._step = self.rate, step
                self._enter(_State.TRIAL, self.rate * (1 + step), now)

    def _end_search_trial(self, pace: float, loss: Loss, now: float) -> None:
        """Take what it carried. Losses before were in bursts, so less is put down to chance than elsewhere."""
        if self._lost > loss.usual(self._count) + MIN_EXCESS * self._count:
            self._end_lossy_trial(loss, now)
            return
        carried = max(self._held, min(self.rate, pace))
        if carried < MIN_USE * self.rate:       # a queue that is seen bounds the rate already
            self._most = 0.0
        self._settle(max(self._held, MARGIN * carried), now)
