# SPDX-License-Identifier: BSD-3-Clause
"""How likely each layer of an image is restored: losses are independent, or come in bursts by Gilbert's model.

The channel is good or bad, and loses datagrams while it is bad (E. Gilbert, BSTJ 39, 1960).
"""
import functools
import math
from typing import Mapping, Optional, Tuple

import numpy as np

from ...arrays import Array, FloatArray
from .pieces import codes_of, most_repeated

CERTAIN = 1e-4
"""Probabilities of failure below this are not distinguished."""

RARE = 0.05
"""Where all copies of a piece are lost by less than this probability, a third of the pieces always comes."""

SURE = 0.98
"""At least one of so many datagrams comes with this probability that an image is shown."""

CACHED = 64
"""Numbers of datagrams whose probabilities are cached."""


def survival(count: int, losses: Mapping[float, float], burst: Optional[float]) -> FloatArray:
    """(length,) the probability that a layer of threshold 1, 2, ... is restored; length: of a code.

    :param count: datagrams, a multiple of codes_of(count)
    :param losses: {packet loss: its probability}
    :param burst: mean number of datagrams lost in a row; None: losses are independent
    """
    return np.array(list(losses.values())) @ _survivals(count, tuple(losses), burst)


def sure_count(loss: float, burst: Optional[float]) -> int:
    """The least number of datagrams of which one comes with the probability SURE, at least.

    By Gilbert's model all of n are lost with the probability loss * (1 - recovery)^(n - 1); independent losses: loss^n.

    :param loss: packet loss, below 1
    :param burst: as in `survival`
    """
    if loss <= 1 - SURE:
        return 1
    recovery = 1 - loss if burst is None else min(1 / burst, 1 - loss)
    # no rounding error makes it one more
    return 1 + math.ceil(math.log((1 - SURE) / loss) / math.log(1 - recovery) - 1e-9)


@functools.lru_cache(maxsize=CACHED)
def _survivals(count: int, losses: Tuple[float, ...], burst: Optional[float]) -> FloatArray:
    """(losses, length): as `survival`, for each loss."""
    loss: FloatArray = np.clip(np.array(losses, float), 1e-6, 1 - 1e-6)
    recovery: FloatArray = 1 - loss if burst is None else np.minimum(1 / burst, 1 - loss)
    codes = codes_of(count)
    length = count // codes
    if codes == 1:
        at_least = _at_least(length, loss, recovery)
    else:
        repeated = most_repeated(count)
        # copies: a piece is lost where all are
        likely = loss ** codes > RARE
        copies = np.ones((len(loss), length))
        copies[likely] = _at_least(length, loss[likely] ** codes, 1 - (1 - recovery[likely]) ** codes)
        # datagrams that take turns: runs of lost ones are shorter, and each code needs its part
        in_turns = _power(_at_least(length, loss, np.minimum(recovery * codes, 1 - loss)), codes)
        at_least = np.concatenate([copies[:, :repeated], in_turns[:, repeated:]], axis=1)
    at_least[at_least > 1 - CERTAIN] = 1.0
    at_least.setflags(write=False)
    return at_least


def _at_least(count: int, loss: FloatArray, recovery: FloatArray) -> FloatArray:
    """(losses, count): the probability that 1, 2, ... of `count` datagrams come."""
    from_most = np.cumsum(arrivals(count, loss, recovery)[:, ::-1], axis=1)
    probabilities: FloatArray = np.minimum(from_most[:, -2::-1], 1.0)
    return probabilities


def arrivals(count: int, loss: FloatArray, recovery: FloatArray) -> FloatArray:
    """How likely each number of datagrams comes by a Gilbert channel.

    :param loss: (m,) in 0..1, both excluded: how often the channel is bad
    :param recovery: (m,) probability that it is good after a datagram that was lost; 1 - loss: losses are independent
    :return: (m, count + 1)
    """
    independent: bool = np.allclose(recovery, 1 - loss, rtol=0, atol=1e-12)
    return _independent(count, loss) if independent else _in_bursts(count, loss, recovery)


def _independent(count: int, loss: FloatArray) -> FloatArray:
    """As `arrivals`: the binomial distribution."""
    came = np.arange(count + 1)
    log_factorial = np.concatenate([[0.0], np.cumsum(np.log(came[1:]))])
    log_choices = log_factorial[-1] - log_factorial - log_factorial[::-1]
    loss = loss[:, np.newaxis]
    probabilities: FloatArray = np.exp(log_choices + came * np.log(1 - loss) + (count - came) * np.log(loss))
    return probabilities


def _in_bursts(count: int, loss: FloatArray, recovery: FloatArray) -> FloatArray:
    """As `arrivals`. The generating function of the number that comes follows from the powers of a 2 x 2 matrix; a
    Fourier transform of its values on the unit circle inverts it.
    """
    length = _fast_length(count + 1)
    z = np.exp(-2j * np.pi * np.arange(length // 2 + 1) / length)
    loss, recovery = loss[:, np.newaxis], recovery[:, np.newaxis]
    memory = 1 - recovery / (1 - loss)      # the second eigenvalue of the transitions
    # sums of the probabilities of all paths, weighted by z to the number of arrivals, follow a linear recurrence
    trace = (1 - loss * (1 - memory)) * z + 1 - recovery
    determinant = memory * z
    root = np.sqrt(trace * trace - 4 * determinant)
    root[np.abs(root) < 1e-9] = 1e-9
    one, other = (trace + root) / 2, (trace - root) / 2
    one_power, other_power = _power(one, count - 1), _power(other, count - 1)
    values = (((1 - loss) * z + loss) * (one_power * one - other_power * other)
              - determinant * (one_power - other_power)) / root
    probabilities: FloatArray = np.fft.irfft(values, length, axis=1)[:, :count + 1]
    return np.maximum(probabilities, 0.0, out=probabilities)


def _fast_length(least: int) -> int:
    """The first length from `least` on that has no prime factor above 5, for fast Fourier transforms."""
    length = least
    while True:
        rest = length
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return length
        length += 1


def _power(base: Array, exponent: int) -> Array:
    """By squaring: numpy's own power is slow above 100."""
    result = np.ones_like(base)
    while exponent:
        if exponent & 1:
            result = result * base
        base, exponent = base * base, exponent >> 1
    return result
