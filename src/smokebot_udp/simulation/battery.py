# SPDX-License-Identifier: BSD-3-Clause
"""The robot's battery: six lithium cells that last two hours and are then replaced."""
RUN_TIME = 7200.0
"""[s]"""

CAPACITY = 12.0
"""[Ah]"""

CURRENT = CAPACITY / RUN_TIME * 3600
"""Discharge current [A]."""

EMPTY, FULL = 6 * 3.5, 6 * 4.2
"""[V]"""


def state_of_charge(time: float) -> float:
    """State of charge, 0..1, at a time [s]."""
    return 1.0 - time % RUN_TIME / RUN_TIME


def voltage(charge: float) -> float:
    """Voltage [V] at a state of charge, 0..1."""
    return EMPTY + (FULL - EMPTY) * charge
