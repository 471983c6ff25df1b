# SPDX-License-Identifier: BSD-3-Clause
"""Units of bitrates, in byte/s."""

KBIT = 1e3 / 8
"""[byte/s]"""

MBIT = 1e6 / 8
"""[byte/s]"""
