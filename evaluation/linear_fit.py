# SPDX-License-Identifier: BSD-3-Clause
"""A least-squares line, and how well it fits."""
from typing import Sequence, Tuple

import numpy as np


def linear_fit(x: Sequence[float], y: Sequence[float]) -> Tuple[float, float, float]:
    """Fit a line to points.

    :param x, y: (n,) coordinates
    :return: (slope, intercept, R²)
    """
    slope, intercept = np.polyfit(x, y, 1)
    return float(slope), float(intercept), float(np.corrcoef(x, y)[0, 1] ** 2)
