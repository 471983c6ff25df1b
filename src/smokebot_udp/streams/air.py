# SPDX-License-Identifier: BSD-3-Clause
"""What a link is expected to do to the next image, from what reports say about the last seconds.

The packet loss is a hidden Markov process on a grid of loss ratios (L. Rabiner, Proc. IEEE 77(2), 1989). It drifts, and
now and then jumps. A report counts how many of the datagrams that were sent arrived. Where losses come in bursts, a
count says as much as that of fewer independent datagrams; the variance of the counts tells how much fewer.

A plan for exactly one loss fails at any other one: heavier losses are always mixed in (doc/protection.md says how much
that costs).
"""
import math
from typing import Mapping, NamedTuple, Optional, Sequence

import numpy as np

from ..arrays import FloatArray

LOSSES: FloatArray = np.array([
    0.001, 0.005, 0.012, 0.022, 0.035, 0.05, 0.07, 0.095, 0.125, 0.16, 0.2, 0.25, 0.3, 0.36, 0.43, 0.5, 0.58, 0.66,
    0.74, 0.82, 0.89, 0.95])
"""The grid of packet-loss ratios."""

TIMEOUT, FORGOTTEN = 1.0, 10.0
"""Without reports for this long the link may have become another one: what is known and UNKNOWN are equally likely, as
where much is lost, reports are, too. After the other time nothing is known [s]."""

UNKNOWN_LOSS = 0.7
"""Where nothing is known, all losses up to this one are equally likely."""

UNKNOWN_TAIL: Mapping[float, float] = {0.82: 0.04, 0.89: 0.04, 0.95: 0.04}
"""{heavy loss: its weight}: what is rare, but for which a small part of an image is protected so that any of its
datagrams shows it."""

DRIFT = 0.1
"""The probability that the loss moves to a neighbouring value of the grid [1/s]."""

JUMPS = 0.05
"""The probability that it jumps [1/s]: to where it was in the last seconds, or anywhere."""

MEMORY = 4.0
"""Where the loss was, and how much counts vary, is averaged over this long (time constant) [s]."""

HORIZON = 0.2
"""An image is lost or not this long after the newest report, at least [s]."""

INDEPENDENT, MAX_DISPERSION = 1.5, 20.0
"""Below this ratio of the counts' variance to that of independent losses they are thought to be; more is not believed.
"""

PRIOR_VARIANCE = 3.0
"""The prior that losses are independent weighs as much as counts of this variance in total."""

IMPOSSIBLE = 1e-12
"""No loss becomes less likely: otherwise sudden contradictions could not be believed."""

HEAVIER, HEAVIER_BY, HEAVIER_LEAST = 0.12, 0.16, 0.35
"""A heavier loss is expected, too, with the weight HEAVIER. It takes the part HEAVIER_BY of what would arrive
otherwise, and is at least HEAVIER_LEAST."""

TAIL: Mapping[float, float] = {0.82: 0.01}
"""{heavy loss: its weight}, expected besides HEAVIER."""

MIXED: Mapping[float, float] = {0.0: 0.1, 0.04: 1.0, 0.1: 0.7}
"""{packet loss: the part of the weights HEAVIER and TAIL that is mixed in}, linear in between. A link that loses
nothing stays so for longer, and the plan for a lossier one is less sensitive."""

BEST_WEIGHT = 0.6
"""Weight of the operator who loses least, where there are several. The others share the rest."""


class Air(NamedTuple):
    """What a link is expected to do to the next image."""
    losses: Mapping[float, float]
    """{packet loss: its probability}, all of LOSSES"""
    burst: Optional[float]
    """Mean number of datagrams lost in a row; None: losses are independent, or nothing is known."""
    known: bool
    """Whether reports say so."""

    @property
    def loss(self) -> float:
        """The expected packet loss."""
        return math.fsum(loss * probability for loss, probability in self.losses.items())


class LossBeliefs:
    """What reports on a stream, or on all streams of an operator, say about its packet loss."""

    def __init__(self) -> None:
        self._heard = -math.inf     # when the newest report came [s]
        # probabilities of LOSSES by the newest report, and on average
        self._probabilities: FloatArray = _ANY
        self._usual: FloatArray = _ANY
        # variances of the counts: if losses were independent, and as measured
        self._independent = self._measured = 0.0

    def add(self, expected: int, received: int, now: float) -> None:
        """Take the counts of a report.

        :param expected: datagrams sent since the last report that could have arrived; may be 0
        :param received: those that did; more than expected count as all
        :param now: when the report came, by a steady clock [s]
        """
        passed = now - self._heard
        if not 0 <= passed <= FORGOTTEN:
            self._forget()
            passed = 0.0
        self._heard = now
        before = self._ahead(passed)
        lost = max(0, expected - received)
        likelihood = lost * np.log(LOSSES) + (expected - lost) * np.log(1 - LOSSES)
        weighted = np.maximum(before * np.exp((likelihood - likelihood.max()) / self._dispersion), IMPOSSIBLE)
        self._probabilities = weighted / weighted.sum()
        keep = math.exp(-passed / MEMORY)
        self._usual = keep * self._usual + (1 - keep) * self._probabilities
        loss = float(self._probabilities @ LOSSES)
        self._independent = keep * self._independent + expected * loss * (1 - loss)
        self._measured = keep * self._measured + (lost - expected * loss) ** 2

    def air(self, now: float) -> Air:
        """What to expect of an image that is sent now [s]."""
        passed = now - self._heard
        if not 0 <= passed <= FORGOTTEN:
            return UNKNOWN
        ahead = self._ahead(passed + HORIZON)
        burst, dispersion = None, self._dispersion
        if dispersion >= INDEPENDENT:
            # of a Gilbert channel's long counts: (1 + m) / (1 - m) with memory m; recovery is (1 - loss) (1 - m)
            burst = _rounded((dispersion + 1) / 2 / (1 - float(ahead @ LOSSES)))
        expected: FloatArray = ahead @ _MIXTURE
        if passed > TIMEOUT:
            return _air((expected + list(UNKNOWN.losses.values())) / 2, burst, False)
        return _air(expected, burst, True)

    def _forget(self) -> None:
        self._probabilities = self._usual = _ANY
        self._independent = self._measured = 0.0

    @property
    def _dispersion(self) -> float:
        """The counts' variance in terms of that of independent losses, at least 1."""
        ratio: float = (self._measured + PRIOR_VARIANCE) / (self._independent + PRIOR_VARIANCE)
        return min(max(ratio, 1.0), MAX_DISPERSION)

    def _ahead(self, passed: float) -> FloatArray:
        """(losses,) probabilities so long after the newest report [s]."""
        drift, jump = 1 - math.exp(-DRIFT * passed), 1 - math.exp(-JUMPS * passed)
        drifted = (1 - drift) * self._probabilities + drift * (self._probabilities @ _NEIGHBOURS)
        ahead: FloatArray = (1 - jump) * drifted + jump * (self._usual + _ANY) / 2
        return ahead


def merged(airs: Sequence[Air]) -> Air:
    """What to expect of an image that several operators get: for the worse ones without ruining the best.

    Operators whose losses are unknown count only where all are.
    """
    known = sorted([air for air in airs if air.known] or airs, key=lambda air: air.loss)
    if len(known) < 2:
        return known[0] if known else UNKNOWN
    losses = np.array([list(air.losses.values()) for air in known])
    bursts = [air.burst for air in known if air.burst is not None]
    return _air(BEST_WEIGHT * losses[0] + (1 - BEST_WEIGHT) * losses[1:].mean(axis=0), max(bursts, default=None),
                known[0].known)


def _air(probabilities: FloatArray, burst: Optional[float], known: bool) -> Air:
    return Air(dict(zip(LOSSES.tolist(), (probabilities / probabilities.sum()).tolist())), burst, known)


def _rounded(burst: float) -> float:
    """To a power of the root of 2: the planner caches what it computes of few values."""
    return math.pow(2.0, round(2 * math.log2(burst)) / 2)


def _spread(weights: Mapping[float, float]) -> FloatArray:
    """(losses,) probabilities of a few losses on the grid, those between two of its values divided."""
    result = np.zeros(len(LOSSES))
    for loss, weight in weights.items():
        place = float(np.interp(loss, LOSSES, np.arange(len(LOSSES))))
        low = min(int(place), len(LOSSES) - 2)
        result[low] += weight * (low + 1 - place)
        result[low + 1] += weight * (place - low)
    return result


def _with_heavier(loss: float) -> FloatArray:
    """(losses,) what is planned for at this loss."""
    part = float(np.interp(loss, list(MIXED), list(MIXED.values())))
    heavier_loss = max(loss + HEAVIER_BY * (1 - loss), HEAVIER_LEAST)
    heavier = part * (HEAVIER * _spread({heavier_loss: 1.0}) + _spread(TAIL))
    mixed: FloatArray = (1 - heavier.sum()) * _spread({loss: 1.0}) + heavier
    return mixed


_MIXTURE: FloatArray = np.array([_with_heavier(loss) for loss in LOSSES.tolist()])
_ANY: FloatArray = np.gradient(LOSSES) / np.gradient(LOSSES).sum()
_STEPS: FloatArray = np.eye(len(LOSSES))
_NEIGHBOURS: FloatArray = (_STEPS[np.r_[0, :len(LOSSES) - 1]] + _STEPS[np.r_[1:len(LOSSES), len(LOSSES) - 1]]) / 2
_UP_TO: FloatArray = np.where(LOSSES <= UNKNOWN_LOSS, _ANY, 0.0)
UNKNOWN = _air((1 - sum(UNKNOWN_TAIL.values())) * _UP_TO / _UP_TO.sum() + _spread(UNKNOWN_TAIL), None, False)
"""Without reports."""
