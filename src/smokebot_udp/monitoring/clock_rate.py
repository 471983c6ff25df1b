# SPDX-License-Identifier: BSD-3-Clause
"""The offset of a clock that runs at another rate, such as a simulation's: a line through the last exchanges.

Exchanges over a queue that grows look like such a clock, but a constant offset explains them as well, within half of
their round trips: then there is no line.
"""
from typing import NamedTuple, Optional, Sequence

import numpy as np

EXCHANGES, LEAST = 5, 4
"""As many of the last ones make a line, and as few."""

LEAST_SPAN, MOST_SPAN = 2.0, 30.0
"""From the first of them to the last [s]."""

GRAIN = 0.1
"""A simulation's clock may advance in steps of this [s]."""

SLACK = 1e-3
"""Clocks are read late [s]."""


class Sample(NamedTuple):
    """An offset that was measured."""
    at: float
    """By this machine's steady clock [s]."""
    offset: float
    """[s]"""
    error: float
    """Its maximum error: half of the round trip [s]."""


class ClockLine(NamedTuple):
    """The offset over time."""
    newest: float
    """When the last sample was taken [s]."""
    offset: float
    """The offset at the time of the last sample [s]."""
    rate: float
    """Growth of the offset per second [s/s]."""
    error: float
    """Maximum error of the offset at the time of the last sample [s]."""
    span: float
    """Time from the first to the last sample [s]."""

    def offset_at(self, now: float) -> float:
        """The offset at a time [s]."""
        return self.offset + self.rate * (now - self.newest)

    def error_at(self, now: float) -> float:
        """Maximum error of the offset at a time. It grows with the time since the last sample [s]."""
        return self.error * (1 + 2 * max(0.0, now - self.newest) / self.span)


def clock_line(samples: Sequence[Sample]) -> Optional[ClockLine]:
    """The line through the last samples; None: there is none, or a constant offset explains them.

    :param samples: of one clock, in the order of their times
    """
    last = list(samples)[-EXCHANGES:]
    if len(last) < LEAST:
        return None
    at, offset, error = np.array(last).T
    span = float(at[-1] - at[0])
    if not LEAST_SPAN <= span <= MOST_SPAN:
        return None
    rate = float(np.polyfit(at - at[-1], offset, 1)[0])
    along = offset - rate * (at - at[-1])
    middle = float(along.max() + along.min()) / 2
    residuals = np.abs(along - middle)
    grain = GRAIN if (residuals > error + SLACK).any() else 0.0
    constant = (offset - error).max() <= (offset + error).min() + grain + SLACK
    if constant or (residuals > error + grain + SLACK).any() or residuals.max() > abs(rate) * span / 5:
        return None
    return ClockLine(float(at[-1]), middle, rate, float((residuals + error).max()), span)
