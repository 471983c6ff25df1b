# SPDX-License-Identifier: BSD-3-Clause
"""How often something is sent so that it arrives, by the packet loss that is expected. Pure."""
import math

LEAST_LOSS, MOST_LOSS = 1e-3, 0.95
"""Losses outside are not believed."""


def believed(loss: float) -> float:
    """The part that is lost, for those who plan, 0..1 both exclusive.

    :param loss: as measured, 0..1
    """
    return min(max(loss, LEAST_LOSS), MOST_LOSS)


def copies(loss: float, residual: float, most: float = math.inf) -> int:
    """How many copies are sent so that all of them are lost with a probability of `residual` at most; at least one.

    :param loss: of each, independent of the others, 0..1
    :param residual: 0..1, both exclusive
    :param most: of them, whatever the loss is
    """
    return int(max(1, min(most, math.ceil(math.log(residual) / math.log(believed(loss)) - 1e-9))))
