# SPDX-License-Identifier: BSD-3-Clause
"""Whether numbers fall linearly: a straight line through them, and how well it fits."""
import numpy as np


def straight_line(x, y):
    """(slope, value at 0, R squared) of the least squares' line.

    :param x, y: (n,) numbers
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    slope, start = np.polyfit(x, y, 1)
    rest = y - (slope * x + start)
    return slope, start, 1 - (rest @ rest) / ((y - y.mean()) @ (y - y.mean()))
