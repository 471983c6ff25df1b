# SPDX-License-Identifier: BSD-3-Clause
"""Queueing delay: how much longer a datagram takes than the least delay of the path."""
import math
from typing import List, Optional

import numpy as np

from ..arrays import FloatArray
from .feedback import PacketSample

BASE_LIFETIME = 5.0
"""A base delay that was not approached for this long has to be measured again [s]."""

NOISY_LIFETIME = 2.0
"""So has one that noise beyond CONFIRMATION_MARGIN may have made short, after this long [s]."""

CONFIRMATION_MARGIN = 0.0015
"""A delay this near to the base confirms it [s]."""

AIR_RATE_LIFETIME = 5.0
"""The air's rate is forgotten over this long [s]."""

NOISE_REPORTS = 8
"""Noise is averaged over this many reports."""

MAX_NOISE = 0.01
"""It is taken for a queue, or hides one, by this at most [s]."""

TYPICAL_WINDOW = 0.05
"""The median of the samples of this long speaks for a report: links jitter, and datagrams overtake each other [s]."""


class QueueDelay:
    """The base delay of the path, and the queueing delay on top of it.

    One-way delays contain an unknown constant, the clock offset, and the datagram's own time on the air. The latter is
    taken off, so that a long datagram does not look queued beside a short one. It is calculated with the highest
    recent capacity as the air's rate: a flow's part of a shared air is less.
    """

    def __init__(self) -> None:
        self.noise = 0.0
        """Mean deviation of delays from one datagram to the next, apart from the queue [s]."""
        self.base: Optional[PacketSample] = None
        """The sample with the least delay; None: unknown, at the start and after the receiver's clock restarted."""
        self._air_rate = 0.0        # [byte/s]
        self._least = False         # whether the base is the least delay so far, which jitter may have made short
        self._updated = -math.inf
        self._confirmed = math.inf

    @property
    def allowance(self) -> float:
        """What the noise of delays adds to a queue [s]."""
        return min(2 * self.noise, MAX_NOISE)

    def update(self, samples: List[PacketSample], capacity: float, now: float) -> None:
        """Take new samples.

        :param samples: in sending order
        :param capacity: as known [byte/s]
        """
        if self._updated > -math.inf:
            self._air_rate *= max(0.0, 1 - (now - self._updated) / AIR_RATE_LIFETIME)
        self._air_rate, self._updated = max(self._air_rate, capacity), now
        sample = typical(samples)
        beyond = self._beyond(sample, self.base) if self.base else -1.0
        if beyond < 0:
            self.base, self._least = sample, True
        if beyond < CONFIRMATION_MARGIN + self.noise:
            self._confirmed = now

    def update_noise(self, samples: List[PacketSample], capacity: float) -> None:
        """Measure noise as the mean deviation from a straight line of what one's own datagrams do not explain: between
        these the queue of others changed evenly, if at all.

        :param samples: in sending order
        :param capacity: as known [byte/s]
        """
        if len(samples) > 4:
            sent = np.array([sample.sent for sample in samples])
            delay = np.array([sample.delay for sample in samples]) - own_waits(samples, capacity)
            sent, delay = sent - sent.mean(), delay - delay.mean()
            residual = delay - sent * (sent @ delay) / max(sent @ sent, 1e-9)
            self.noise += (float(np.abs(residual).mean()) - self.noise) / NOISE_REPORTS

    def expired(self, now: float) -> bool:
        """Whether nothing confirmed the base for long."""
        short = self._least and self.noise > CONFIRMATION_MARGIN
        return now - self._confirmed > (NOISY_LIFETIME if short else BASE_LIFETIME)

    def set_base(self, sample: PacketSample, now: float) -> None:
        """Take this sample's delay as the base."""
        self.base, self._confirmed, self._least = sample, now, False

    def raise_base(self, sample: PacketSample, max_step: float, now: float) -> None:
        """Raise the base to this sample's delay, by ``max_step`` [s] at most; the first time since a least delay was
        found, by the allowance for noise, too."""
        excess = self._beyond(sample, self.base) if self.base else 0.0
        step = max_step + (self.allowance if self._least else 0.0)
        self.set_base(sample._replace(arrived=sample.arrived - max(0.0, excess - step)), now)

    def of(self, sample: PacketSample) -> float:
        """How long a datagram was queued [s]; a base must be known."""
        assert self.base is not None
        return max(0.0, self._beyond(sample, self.base))

    def _beyond(self, sample: PacketSample, base: PacketSample) -> float:
        # the air's rate may be far off: a datagram shorter than the base's must not seem queued for that
        return sample.delay - base.delay - max(0, sample.size - base.size) / self._air_rate


def own_waits(samples: List[PacketSample], capacity: float) -> FloatArray:
    """How long datagrams wait for those before them and are on the air, where nothing else is sent (Lindley's
    recursion) [s].

    :param samples: in sending order, at least one
    :param capacity: [byte/s]
    :return: (n,) float64
    """
    waits = [samples[0].size / capacity]
    for before, after in zip(samples, samples[1:]):
        between = (after.total - before.total - after.size) / capacity      # sent at unknown times
        waits.append(max(0.0, waits[-1] - (after.sent - before.sent) + between) + after.size / capacity)
    return np.array(waits)


def typical(samples: List[PacketSample]) -> PacketSample:
    """The sample of median delay among the newest.

    :param samples: in sending order, at least one
    """
    newest = samples[-1].arrived
    recent = sorted((sample for sample in samples if newest - sample.arrived <= TYPICAL_WINDOW),
                    key=lambda sample: sample.delay)
    return recent[(len(recent) - 1) // 2]
