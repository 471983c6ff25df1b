# SPDX-License-Identifier: BSD-3-Clause
"""The robot's battery: six lithium cells that last for two hours, and are then exchanged."""
LASTS = 7200.0
"""[s]"""

CAPACITY = 12.0
"""[Ah]"""

CURRENT = CAPACITY / LASTS * 3600
"""What is drawn [A]."""

EMPTY, FULL = 6 * 3.5, 6 * 4.2
"""[V]"""


def share_left(time):
    """Of the charge, 0..1, at a time [s]."""
    return 1.0 - time % LASTS / LASTS


def voltage(share):
    """[V] with this share of the charge left."""
    return EMPTY + (FULL - EMPTY) * share
