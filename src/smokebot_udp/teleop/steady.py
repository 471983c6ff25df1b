# SPDX-License-Identifier: BSD-3-Clause
"""Steady clocks, as threads read them."""

STEP = 0.05
"""A time that is less than this before the latest one is no fault of the clock: threads read it in another order than
they use what they read [s]."""
