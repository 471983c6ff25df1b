# SPDX-License-Identifier: BSD-3-Clause
"""The asking side of the clock exchange, without I/O: pairs answers with open questions."""
import collections
import math
from typing import Deque, Dict, Optional

from .clock_offset import ClockEstimate, ClockOffset

MAX_QUESTIONS = 16
"""Number of open questions: an answer that comes after this many newer questions is useless."""


PERIOD, STEADY_PERIOD, STEADY = 1.0, 4.0, 10
"""From one question to the next: until there are this many exchanges, and while a clock seems to have been set; then
[s, s, 1]."""


class EchoClient:
    """Estimates the clock of the machine that answers. Each question is answered once; other answers are refused."""

    def __init__(self) -> None:
        self._clock = ClockOffset(any_rate=True)
        self._open: Deque[int] = collections.deque(maxlen=MAX_QUESTIONS)
        self._asked = -math.inf

    def due(self, now: float) -> bool:
        """Whether a question is to be sent; to be called each PERIOD.

        :param now: by this machine's monotonic clock [s]
        """
        steady = self._clock.exchanges >= STEADY and not self._clock.doubtful
        return now - self._asked > (STEADY_PERIOD if steady else PERIOD) - PERIOD / 2

    def ask(self, asked: int, now: float) -> None:
        """A question is sent.

        :param asked: by this machine's clock [ns since its epoch]: identifies the question
        :param now: as of `due`
        """
        self._open.append(asked)
        self._asked = now

    def answer(self, asked: int, received: float, answered: float, came: float, now: float) -> bool:
        """An answer was received.

        :param asked: the question's [ns]
        :param received, answered: by the other machine's clock [s]
        :param came: by this machine's clock [s]
        :param now: by this machine's monotonic clock [s]
        :return: whether the answer is used
        """
        if asked not in self._open:
            self._clock.refused['unasked'] += 1
            return False
        self._open.remove(asked)
        return self._clock.add(1e-9 * asked, received, answered, came, now)

    def estimate(self, now: float) -> Optional[ClockEstimate]:
        """The estimate of the other clock; None without a recent answer."""
        return self._clock.estimate(now)

    @property
    def refuted(self) -> bool:
        """Whether the clock is unknown because its answers contradict each other."""
        return self._clock.refuted

    @property
    def counts(self) -> Dict[str, int]:
        """{event: how often}: clock jumps, and refused answers by reason. Unasked ones may answer other operators."""
        return {'jumps': self._clock.jumps,
                **{'refused, ' + reason: count for reason, count in self._clock.refused.items()}}
