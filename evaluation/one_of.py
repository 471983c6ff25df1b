# SPDX-License-Identifier: BSD-3-Clause
"""Percentiles that are one of the values, for any numpy: the argument `method` of numpy.percentile is new in 1.22, and
`interpolation`, which it replaced, is removed in later ones.
"""
import math
from typing import Iterable

import numpy as np


def percentile(values: Iterable[float], percent: float) -> float:
    """The value at position (n - 1) percent / 100 of the n sorted ones, or the next one; numpy's method `higher`.

    :raises ValueError: there are no values
    """
    ordered = np.sort(np.fromiter(values, np.float64))
    if not len(ordered):
        raise ValueError('there are no values')
    return float(ordered[math.ceil((len(ordered) - 1) * percent / 100)])
